# SPDX-License-Identifier: GPL-3.0-or-later
"""Weighted means over meshes: the short-time kernel and the bilateral one."""

from __future__ import annotations

import math

import numpy as np

from ...base.parallel import chunk_size, kernel, run
from ...mesh.geodesics import ALL, Stencils, march, new_front, squared_distance
from ...mesh.triangle_mesh import HUB, Floats
from ...settings import BeltramiMeshSettings

_MOST_AROUND = 4.0
"""Near hubs, most vertices that count, by those that count where the mesh is regular."""

_REACHED = 500_000
"""About how many vertices a chunk's marches reach: tenths of a second between cancel points."""


def smooth_graph(
    graph: Stencils,
    embedding: Floats,
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
    embedding : (n, k) float64
        Where these lie on the surface that distances are measured on; the first three coordinates
        are the place in space.
    mass : (n,) float64
        How much each counts. Those without mass keep their values.
    values : (n, d) float64
        What is averaged.
    settings : BeltramiMeshSettings
        `time` greater than 0.
    has_hubs : bool
        Whether the mesh has hubs (see `TriangleMesh`). Then a mean is over the nearest few
        hundred (or, with straight distances, over some of those near), not over all.

    Returns
    -------
    (n, d) float64
    """
    count = len(mass)
    limit = math.sqrt(-4.0 * settings.time * math.log(settings.threshold))
    around = min(2.0 * math.pi * limit**2 + 1.0, count)
    most = ALL
    if has_hubs:
        most = int(max(_MOST_AROUND * around, HUB))
        around = 2 * most  # at a hub, as many are looked at
    chunk = min(max(int(_REACHED / around), 1), chunk_size(count))
    out = np.empty_like(values)
    if settings.distance == "geodesic":
        run(_geodesic_means, count, settings.time, limit, most, graph, mass, values, out,
            chunk=chunk)  # fmt: skip
    else:
        run(_euclidean_means, count, settings.time, limit, most, graph, embedding, mass, values,
            out, chunk=chunk)  # fmt: skip
    return out


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
