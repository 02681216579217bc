# SPDX-License-Identifier: GPL-3.0-or-later
"""Variants from the papers that the core does not offer, patched into it temporarily.

Of paper C, straight distances instead of geodesic ones (a bilateral filter), and pixels that count
by their area on the surface; of paper D, its function that sharpens dye, and steps of first order.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from typing import Any

import numpy as np
import numpy.typing as npt
from shock_filter import core
from shock_filter.core import settings as settings_module
from shock_filter.core.advection import dye
from shock_filter.core.base.parallel import kernel, run
from shock_filter.core.beltrami import grid_smoothing, mesh_smoothing
from shock_filter.core.color import image_smoothing
from shock_filter.core.grid.geodesics import chord
from shock_filter.core.mesh.geodesics import Stencils, squared_distance, stencils
from shock_filter.core.shape import noise


@contextmanager
def replaced(module: Any, **values: Any) -> Iterator[None]:
    """Replace what a module names."""
    before = {name: getattr(module, name) for name in values}
    vars(module).update(values)
    try:
        yield
    finally:
        vars(module).update(before)


def distances(kind: str) -> Any:
    """Select the distances of denoising: "geodesic", as in the core, or "euclidean"."""
    return nullcontext() if kind == "geodesic" else _straight()


def cutoff(part: float) -> Any:
    """Have the kernel end where weights are less than this part of the largest one."""
    return replaced(settings_module, CUTOFF=part)


@contextmanager
def _straight() -> Iterator[None]:
    with ExitStack() as stack:
        stack.enter_context(replaced(grid_smoothing, smooth_rows=_bilateral_rows))
        stack.enter_context(
            replaced(mesh_smoothing, stencils=_with_points, smooth_graph=_smooth_graph)
        )
        stack.enter_context(replaced(noise, smooth_faces=_smooth_faces))
        yield


def by_surface() -> Any:
    """Have pixels count by their area on the surface that the values make."""

    def smooth_grid(signal: Any, guide: Any, flat: bool, _: Any, settings: Any) -> npt.NDArray:
        down, across = np.gradient(guide.astype(np.float64), axis=(0, 1))
        g_yy, g_xx, g_xy = ((a * b).sum(axis=2) for a, b in
                            ((down, down), (across, across), (down, across)))  # fmt: skip
        areas = np.sqrt((flat + g_yy) * (flat + g_xx) - g_xy**2).astype(np.float32)
        return grid_smoothing.smooth_grid(signal, guide, flat, areas, settings)

    return replaced(image_smoothing, smooth_grid=smooth_grid)


def rational_dye() -> Any:
    """Have dye sharpened by the function of paper D, 5.3."""

    def sharpen_dye(shares: npt.NDArray, settings: core.DyeSettings, _: Any) -> npt.NDArray:
        centered = 2 * np.minimum(shares, 1) - 1
        below = 1 - np.float32(settings.sharpness) * (1 - abs(centered))
        return (0.5 + 0.5 * centered / np.where(below > 0, below, np.inf)).astype(np.float32)

    return replaced(dye, sharpen_dye=sharpen_dye)


def first_order_dye() -> Any:
    """Have dye carried by the velocity at the end of each step."""
    return replaced(dye, _find_midpoint=_take_the_end)


@kernel
def _take_the_end(start, stop, right, down, right_halfway, down_halfway, joined, back):
    back[start:stop, :, 0] = right[start:stop]
    back[start:stop, :, 1] = down[start:stop]


@kernel
def _bilateral_rows(
    start, stop, signal, guide, spacing, areas, limit, rate, half_window, rows, unsplit, wanted, out
):
    reach = int(np.sqrt(limit))
    total = np.empty(signal.shape[2])
    for y in range(start, stop):
        for x in range(guide.shape[1]):
            total[:] = 0.0
            weight = 0.0
            for down in range(rows[y, 0], rows[y, 1]):
                for right in range(max(x - reach, 0), min(x + reach + 1, guide.shape[1])):
                    square = chord(guide, spacing, y, x, down, right)
                    if not square <= limit:  # nor NaN
                        continue
                    share = areas[down, right] * np.exp(-rate * square)
                    weight += share
                    for c in range(total.size):
                        total[c] += np.float64(share) * signal[down, right, c]
            for c in range(total.size):
                out[y, x, c] = total[c] / weight if weight > 0 else signal[y, x, c]


def _with_points(mesh: core.TriangleMesh, embedding: npt.NDArray) -> tuple[Stencils, npt.NDArray]:
    return stencils(mesh, embedding), embedding


def _smooth_graph(
    both: tuple[Stencils, npt.NDArray], mass: Any, values: Any, settings: Any, has_hubs: bool
) -> npt.NDArray:
    graph, embedding = both
    limit, most, chunk = mesh_smoothing._extent(settings, len(mass), has_hubs)
    out = np.empty_like(values)
    run(_euclidean_means, len(mass), settings.time, limit, most, graph, embedding, mass, values,
        out, chunk=chunk)  # fmt: skip
    return out


def _smooth_faces(
    mesh: core.TriangleMesh, centres: Any, guide: Any, beta: float, normals: Any, settings: Any
) -> npt.NDArray:
    face, k = np.nonzero(mesh.twins >= 0)
    counts = np.bincount(face, minlength=mesh.face_count)
    ring = mesh.twins[face, k] // 3
    graph = Stencils(np.concatenate([[0], np.cumsum(counts)]), ring, ring, np.zeros((0, 3), "f4"))
    embedding = np.concatenate([centres, beta * guide], axis=1)
    out = _smooth_graph((graph, embedding), mesh.areas, normals, settings, mesh.has_hubs)
    length = np.linalg.norm(out, axis=1, keepdims=True)
    return np.where(length > 0, out / np.maximum(length, 1e-300), normals)


@kernel
def _euclidean_means(start, stop, time, limit, most, graph, embedding, mass, values, out):
    # All that is connected within the limit in space counts; a bilateral filter.
    row_start, ring = graph.start, graph.targets
    count = mass.shape[0]
    found = np.empty(count, np.int32)
    stamps = np.full(count, -1, np.int32)
    for v in range(start, stop):
        if mass[v] == 0:
            out[v] = values[v]
            continue
        out[v] = 0.0
        total = 0.0
        found[0] = v
        stamps[v] = v
        seen, size = 0, 1
        while seen < min(size, most):
            w = found[seen]
            seen += 1
            square = squared_distance(embedding, w, v)
            if square <= limit * limit:
                weight = mass[w] * np.exp(-square / (4 * time))
                total += weight
                for j in range(values.shape[1]):
                    out[v, j] += weight * values[w, j]
            row = row_start[w + 1] - row_start[w]
            stride = 1 if row <= most else 1 + row // most
            for i in range(row_start[w], row_start[w + 1], stride):
                u = ring[i]
                if stamps[u] == v:
                    continue
                stamps[u] = v
                square = 0.0
                for j in range(3):
                    square += (embedding[u, j] - embedding[v, j]) ** 2
                if square <= limit * limit:
                    found[size] = u
                    size += 1
        for j in range(values.shape[1]):
            out[v, j] /= total
