# SPDX-License-Identifier: GPL-3.0-or-later
"""Weighted means over meshes: the short-time kernel."""

from __future__ import annotations

import math

import numpy as np

from ..base.parallel import chunk_size, kernel, run
from ..base.progress import aside
from ..mesh.calculus import make_unit
from ..mesh.geodesics import (
    ALL,
    Stencils,
    face_steps,
    march,
    new_front,
    new_search,
    search,
)
from ..mesh.triangle_mesh import HUB, Floats, TriangleMesh
from ..settings import BeltramiMeshSettings

_MOST_AROUND = 4.0
"""Near hubs, most vertices that count, by those that count where the mesh is regular."""

_REACHED = 500_000
"""About how many vertices a chunk's marches reach: tenths of a second between cancel points."""


def smooth_graph(
    graph: Stencils,
    mass: Floats,
    values: Floats,
    settings: BeltramiMeshSettings,
    has_hubs: bool,
) -> Floats:
    """Apply the kernel once.

    Parameters
    ----------
    graph : Stencils
        How distances travel between the vertices, or between the faces, of a mesh.
    mass : (n,) float64
        How much each counts. Those without mass keep their values.
    values : (n, d) float64
        What is averaged.
    settings : BeltramiMeshSettings
        `time` greater than 0.
    has_hubs : bool
        Whether the mesh has hubs (see `TriangleMesh`). Then a mean is over the nearest few
        hundred, not over all.

    Returns
    -------
    (n, d) float64
    """
    count = len(mass)
    limit, most, chunk = _extent(settings, count, has_hubs)
    out = np.empty_like(values)
    run(_geodesic_means, count, settings.time, limit, most, graph, mass, values, out, chunk=chunk)
    return out


def smooth_faces(
    mesh: TriangleMesh,
    centres: Floats,
    guide: Floats,
    beta: float,
    normals: Floats,
    settings: BeltramiMeshSettings,
) -> Floats:
    """Apply the kernel once to the normals of the faces, which lie at (centres, beta guide).

    Distances run straight from centre to centre. The result is made of unit vectors, (m, 3).
    """
    count = mesh.face_count
    limit, most, chunk = _extent(settings, count, mesh.has_hubs)
    with aside("Denoising"):
        steps = face_steps(mesh, centres, guide, beta)
    out = np.empty_like(normals)
    run(_face_means, count, settings.time, limit, most, *steps, mesh.areas, normals, out,
        chunk=chunk)  # fmt: skip
    return out


def _extent(settings: BeltramiMeshSettings, count: int, has_hubs: bool) -> tuple[float, int, int]:
    # How far the kernel reaches, how many it reaches at most, and how many marches make a chunk.
    limit = math.sqrt(settings.limit)
    around = min(2.0 * math.pi * limit**2 + 1.0, count)
    most = ALL
    if has_hubs:
        most = int(max(_MOST_AROUND * around, HUB))
        around = 2 * most  # at a hub, as many are looked at
    return limit, most, min(max(int(_REACHED / around), 1), chunk_size(count))


@kernel
def decay(x):
    """Compute exp(x) for x <= 0, to a ten-thousandth where it matters, faster than exp."""
    y = max(x / 64.0, -1.0)
    y = 1.0 + y * (1.0 + y * (0.5 + y / 6.0))
    for _ in range(6):
        y *= y
    return y


@kernel
def _face_means(start, stop, time, limit, most, targets, lengths, areas, normals, out):
    reached, left = new_search(areas.shape[0])
    limit = max(np.float32(limit), np.float32(1e-30))  # a face is always near itself
    rate = -0.25 / time
    for f in range(start, stop):
        out[f] = normals[f]
        if areas[f] == 0:
            continue
        count = search(f, limit, most, targets, lengths, reached, left)
        x = y = z = 0.0
        for i in range(count):
            g = reached[i]
            if left[g] > 0:  # or it was counted before
                away = float(limit - left[g])
                left[g] = 0.0
                weight = areas[g] * decay(rate * away * away)
                x += weight * normals[g, 0]
                y += weight * normals[g, 1]
                z += weight * normals[g, 2]
        out[f, 0], out[f, 1], out[f, 2] = x, y, z
        make_unit(out[f])


@kernel
def _geodesic_means(start, stop, time, limit, most, graph, mass, values, out):
    front = new_front(mass.shape[0])
    reached, squares = front.reached, front.squares
    for v in range(start, stop):
        if mass[v] == 0:
            out[v] = values[v]
            continue
        count = march(v, v - start + 1, limit, most, graph, front)
        out[v] = 0.0
        total = 0.0
        for i in range(count):
            w = reached[i]
            weight = mass[w] * np.exp(-squares[w] / (4 * time))
            total += weight
            for j in range(values.shape[1]):
                out[v, j] += weight * values[w, j]
        for j in range(values.shape[1]):
            out[v, j] /= total
