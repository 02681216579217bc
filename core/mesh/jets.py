# SPDX-License-Identifier: GPL-3.0-or-later
"""Polynomials of degree three that fit the surface, and signals on it, around each vertex."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.checks import Floats
from ..base.parallel import kernel, run
from .calculus import lumped_mass, mean_normals, smooth_vertices, unit_vectors
from .triangle_mesh import TriangleMesh

TERMS = 6
"""Coefficients that are kept: of 1, x, y, x^2, x y and y^2."""

_UNKNOWNS = 10

_RADIUS = 2.5
"""Automatic radius in root mean squares of the lengths of edges around a vertex."""

_REACH = 1.25
"""Least radius in lengths of the longest edge around a vertex."""

_PASSES = 2
"""Smoothing passes of these lengths, so that neighbours have nearly the same radius."""

_FIRM, _LOOSE = 1e-9, 1e-6
"""Regularization of the terms up to degree two, and of those of degree three."""


class Frames:
    """A frame at each vertex: tangents `one` and `two`, and a normal, (n, 3) each."""

    def __init__(self, mesh: TriangleMesh) -> None:
        self.normal = unit_vectors(mean_normals(mesh))
        off = np.zeros_like(self.normal)
        off[np.arange(len(off)), np.argmin(np.abs(self.normal), axis=1)] = 1.0
        self.one = unit_vectors(np.cross(self.normal, off))
        self.two = np.cross(self.normal, self.one)


def radii_of(mesh: TriangleMesh, radius: float) -> Floats:
    """Return the radius of each vertex's neighbourhood, in mean edge lengths: (n,).

    Parameters
    ----------
    mesh : TriangleMesh
    radius : float
        In units of the mesh; 0 takes 2.5 times the length of the edges nearby. Everywhere it is at
        least what reaches over the one-ring.
    """
    start, ring = mesh.neighbours
    lengths = np.zeros((mesh.vertex_count, 2))
    run(_measure, mesh.vertex_count, mesh.scaled_vertices, start, ring, lengths)
    size = float(np.linalg.norm(np.ptp(mesh.scaled_vertices, axis=0)))
    wanted = np.full(mesh.vertex_count, min(radius / mesh.mean_edge_length, size))
    if radius == 0:
        wanted = _RADIUS * smooth_vertices(mesh, lengths[:, :1], _PASSES)[:, 0]
    found: Floats = np.maximum(wanted, _REACH * lengths[:, 1])
    return found


def fitted(
    mesh: TriangleMesh,
    frames: Frames,
    radii: Floats,
    signals: Floats,
) -> Floats:
    """Fit cubics to the height of the surface over tangent planes, and to signals.

    Parameters
    ----------
    mesh : TriangleMesh
    frames : Frames
    radii : (n,) float64
        From `radii_of`.
    signals : (n, c) float64

    Returns
    -------
    (n, 6, 1 + c) float64
        Coefficients up to degree two of the height (first) and of the signals, lengths in mean
        edge lengths. Zero at vertices without faces.

    Notes
    -----
    The weight of a vertex is the product of its share of the area, a smooth function of its
    distance that vanishes at the radius, and the fourth power of the cosine between the normals. So
    a fit beside a crease is that of its own side. Only vertices that are connected to the centre by
    edges among vertices with a weight are used, so that the other side of a thin wall is not.
    """
    start, ring = mesh.neighbours
    out = np.zeros((mesh.vertex_count, TERMS, 1 + signals.shape[1]))
    masses = lumped_mass(mesh)
    run(_fit, mesh.vertex_count, mesh.scaled_vertices, frames.normal, frames.one, frames.two,
        masses, start, ring, radii, np.ascontiguousarray(signals), out)  # fmt: skip
    return out


def gradients_of(
    mesh: TriangleMesh, frames: Frames, radii: Floats, signals: Floats
) -> npt.NDArray[np.float64]:
    """Fit the gradients of signals (n, c) at the vertices: (n, c, 3), per mean edge length."""
    terms = fitted(mesh, frames, radii, signals)[:, :, 1:]
    along: Floats = terms[:, 1, :, None] * frames.one[:, None]
    return along + terms[:, 2, :, None] * frames.two[:, None]


@kernel
def _measure(start, stop, vertices, ring_start, ring, lengths):
    # The root mean square of the lengths around each vertex, and the greatest.
    for v in range(start, stop):
        total = 0.0
        for i in range(ring_start[v], ring_start[v + 1]):
            square = 0.0
            for x in range(3):
                square += (vertices[ring[i], x] - vertices[v, x]) ** 2
            total += square
            lengths[v, 1] = max(lengths[v, 1], np.sqrt(square))
        lengths[v, 0] = np.sqrt(total / max(ring_start[v + 1] - ring_start[v], 1))


@kernel
def _fit(start, stop, vertices, normals, ones, twos, masses, ring_start, ring, radii, signals, out):
    count, columns = vertices.shape[0], out.shape[2]
    stamps = np.full(count, -1, np.int32)
    queue = np.empty(count, np.int32)
    matrix = np.empty((_UNKNOWNS, _UNKNOWNS))
    sides = np.empty((_UNKNOWNS, columns))
    base = np.empty(_UNKNOWNS)
    for v in range(start, stop):
        radius = radii[v]
        if ring_start[v] == ring_start[v + 1] or radius <= 0:
            continue
        matrix[:] = 0.0
        sides[:] = 0.0
        stamps[v] = v
        queue[0] = v
        first, last = 0, 1
        while first < last:
            u = queue[first]
            first += 1
            x, y, z, square, agrees = 0.0, 0.0, 0.0, 0.0, 0.0
            for a in range(3):
                d = (vertices[u, a] - vertices[v, a]) / radius
                x += d * ones[v, a]
                y += d * twos[v, a]
                z += d * normals[v, a]
                square += d * d
                agrees += normals[u, a] * normals[v, a]
            if u != v and (square >= 1.0 or agrees <= 0.0):
                continue
            weight = (1.0 - square) ** 2 * agrees**4 * masses[u]
            base[0] = 1.0
            base[1], base[2] = x, y
            base[3], base[4], base[5] = x * x, x * y, y * y
            base[6], base[7], base[8], base[9] = x * x * x, x * x * y, x * y * y, y * y * y
            for i in range(_UNKNOWNS):
                share = weight * base[i]
                for j in range(i + 1):
                    matrix[i, j] += share * base[j]
                sides[i, 0] += share * z
                for c in range(1, columns):
                    sides[i, c] += share * signals[u, c - 1]
            for i in range(ring_start[u], ring_start[u + 1]):
                other = ring[i]
                if stamps[other] != v:
                    stamps[other] = v
                    queue[last] = other
                    last += 1
        total = matrix[0, 0]
        if total <= 0:
            continue
        for i in range(_UNKNOWNS):
            matrix[i, i] += total * (_FIRM if i < TERMS else _LOOSE)
        _solve(matrix, sides)
        for i in range(TERMS):
            scale = 1.0 if i == 0 else 1.0 / radius if i < 3 else 1.0 / (radius * radius)
            out[v, i, 0] = radius * scale * sides[i, 0]
            for c in range(1, columns):
                out[v, i, c] = scale * sides[i, c]


@kernel
def _solve(matrix, sides):
    # Cholesky factors in the lower triangle, in place; the solutions replace the right-hand sides.
    size, columns = sides.shape
    for i in range(size):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            if i == j:
                matrix[i, i] = np.sqrt(max(total, 1e-300))
            else:
                matrix[i, j] = total / matrix[j, j]
    for c in range(columns):
        for i in range(size):
            total = sides[i, c]
            for k in range(i):
                total -= matrix[i, k] * sides[k, c]
            sides[i, c] = total / matrix[i, i]
        for i in range(size - 1, -1, -1):
            total = sides[i, c]
            for k in range(i + 1, size):
                total -= matrix[k, i] * sides[k, c]
            sides[i, c] = total / matrix[i, i]
