# SPDX-License-Identifier: GPL-3.0-or-later
"""Weighted means over meshes: the short-time kernel.

A signal I painted on a mesh makes a surface of its own, with the vertices at (X, beta I): X in
mean edge lengths, I in [0, 1]. Each value becomes the mean of the values around it, weighted by
``exp(-d^2 / 4 t)`` with d the geodesic distance on that surface (paper C, equations 20 to 22; the
constant H0 is what makes the weights sum to one).

The paper integrates over the surface and leaves open how a vertex is weighted. Here its weight is a
third of the area around it, so that dense vertices do not count more.
"""

from __future__ import annotations

import math

import numpy as np

from ..base.parallel import chunk_size, kernel, run
from ..base.progress import aside, phase
from ..mesh.calculus import lumped_mass, make_unit
from ..mesh.geodesics import (
    ALL,
    Stencils,
    face_steps,
    march,
    new_front,
    new_search,
    search,
    stencils,
)
from ..mesh.triangle_mesh import HUB, Floats, TriangleMesh
from ..settings import BeltramiMeshSettings

_MOST_AROUND = 4.0
"""Most vertices averaged near hubs, relative to the number on a regular mesh."""

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
        Triangles over which distances between vertices, or between faces, are marched.
    mass : (n,) float64
        Weights. Values of mass 0 stay.
    values : (n, d) float64
        Values to average.
    settings : BeltramiMeshSettings
        `time` greater than 0.
    has_hubs : bool
        Whether the mesh has hubs (see `TriangleMesh`). Means are then over the few hundred nearest
        vertices only.

    Returns
    -------
    (n, d) float64
    """
    count = len(mass)
    limit, most, chunk = _extent(settings, count, has_hubs)
    out = np.empty_like(values)
    run(_geodesic_means, count, settings.time, limit, most, graph, mass, values, out, chunk=chunk)
    return out


def smooth_painted(
    mesh: TriangleMesh, values: Floats, settings: BeltramiMeshSettings, *, moves: bool = False
) -> tuple[Floats, Floats]:
    """Apply the kernel to a signal that is painted on a mesh, as often as the settings say.

    Parameters
    ----------
    mesh : TriangleMesh
    values : (n, d) float64
    settings : BeltramiMeshSettings
        `time` greater than 0.
    moves : bool
        Whether the vertices are also smoothed, with the same weights.

    Returns
    -------
    points : (n, 3) float64
        The vertices, in mean edge lengths.
    values : (n, d) float64
        Within the range of the input.
    """
    # Lengths and areas remain those of the given mesh, so that all iterations use the same units.
    # Clipping removes only rounding errors.
    with aside("Denoising"):
        mass = lumped_mass(mesh)
    points, beta = mesh.scaled_vertices, settings.beta
    low, high = values.min(axis=0), values.max(axis=0)
    for iteration in range(settings.iterations):
        start, stop = iteration / settings.iterations, (iteration + 1) / settings.iterations
        with phase(start, stop, "Denoising"):
            embedding = np.concatenate([points, beta * values], axis=1)
            with aside("Denoising"):
                graph = stencils(mesh, embedding)
            signal = np.concatenate([points, values], axis=1) if moves else values
            means = smooth_graph(graph, mass, signal, settings, mesh.has_hubs)
            if moves:
                points, means = np.split(means, [3], axis=1)
            values = np.clip(means, low, high)
    return points, values


def smooth_faces(
    mesh: TriangleMesh,
    centres: Floats,
    guide: Floats,
    beta: float,
    normals: Floats,
    settings: BeltramiMeshSettings,
) -> Floats:
    """Apply the kernel once to the normals of the faces, at the points (centres, beta guide).

    Distances are those along the straight lines between neighboring centres. Returns (m, 3) unit
    vectors.
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
    # The radius of the kernel, the most faces that it reaches, and the number of marches per chunk.
    limit = math.sqrt(settings.limit)
    around = min(2.0 * math.pi * limit**2 + 1.0, count)
    most = ALL
    if has_hubs:
        most = int(max(_MOST_AROUND * around, HUB))
        around = 2 * most  # as many are visited at a hub
    return limit, most, min(max(int(_REACHED / around), 1), chunk_size(count))


@kernel
def decay(x):
    """Approximate exp(x) for x <= 0, faster than exp, to 1e-4 where weights matter."""
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
            if left[g] > 0:  # 0 if it was counted before
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
