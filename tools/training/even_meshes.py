# SPDX-License-Identifier: GPL-3.0-or-later
"""Even meshes with relief, as from displacement, for training both creases and denoising."""

from __future__ import annotations

import numpy as np
import scipy.ndimage
from distances import norm
from meshings import mean_edge
from scipy.spatial import ConvexHull
from shock_filter import core
from shock_filter.core.mesh.calculus import average_to_vertices


def even(rng):
    """Make a mesh of even faces: vertices, faces, vertex normals, and the mean edge length."""
    v, f = _shape(rng)
    mesh = core.TriangleMesh(v, f)
    n = average_to_vertices(mesh, mesh.normals)
    return v, f, n / norm(n)[:, None], mean_edge(v, f)


def heights(rng, v, edge, *which):
    """Return the heights, at vertices, of relief as from `wavy`, everywhere or in places."""
    relief = wavy(rng, edge, *which)
    if rng.random() < 0.3:
        one, other = relief, wavy(rng, edge, *which)
        relief = lambda p: 0.7 * (one(p) + other(p))  # noqa: E731
    high = relief(v)
    if rng.random() < 0.4:
        where, off = rng.normal(size=3) * rng.uniform(1, 4), rng.uniform(0, 6.3)
        high = high * np.clip(0.5 + 2 * np.sin(v @ where + off), 0, 1)
    return high[:, None]


def wavy(rng, h, shortest, longest=40, kinds=5, slopes=(0.12, 1), highest=3):
    """Make relief for a mesh of edge length `h`: a function from points to heights.

    Its wavelength is `shortest` to `longest` edge lengths, its slope in the range `slopes`, and its
    height at most `highest` edge lengths. It is one of the first `kinds` kinds: 5 are waves, 7 add
    clouds and cells, and turn half of all relief upside down.
    """
    length = np.exp(rng.uniform(np.log(shortest), np.log(longest)))
    steep = np.exp(rng.uniform(*np.log(slopes)))
    high = h * np.clip(steep * length / (2 * np.pi), 0.2, highest)
    kind, off = rng.integers(0, kinds), rng.uniform(0, 6.3, 8)
    k = rng.normal(size=(8, 3))
    k *= (2 * np.pi / (length * h) * rng.uniform(0.7, 1.3, 8) / norm(k))[:, None]
    q, _ = np.linalg.qr(k[:3].T)
    octaves = min(1 + int(np.log2(length / shortest)), 3)
    lattice = rng.normal(size=(3, 16, 16, 16)) if kinds > 5 else None

    def wave(p):
        if kind == 0:  # waves from all directions
            return np.sin(p @ k.T + off).mean(1) * 4
        if kind == 1:  # bumps in rows
            rows = [np.sin(p @ (norm(k)[i] * q[:, i]) + off[i]) for i in (0, 1)]
            return 2 * rows[0] * rows[1]
        if kind == 2:  # ridges
            return np.tanh(off[2] * 0.6 * np.sin(p @ k[0] + off[0])) * 1.4
        if kind == 3:  # lumps with narrow grooves
            return 2.6 - 3.5 * abs(np.sin(0.5 * p @ k[:3].T + off[:3])).max(1) ** 3
        if kind == 4:  # coarse and fine
            return sum(np.sin(g * p @ k[:4].T + off[:4]).mean(1) * 2.8 / g for g in (1, 2.3))
        p = p / (length * h) + off[:3]
        if kind == 5:  # clouds, or the same with sharp valleys
            each = [_noise(lattice[i], 2 ** (i + 1) * p) / 2**i for i in range(octaves)]
            return 2 * sum(each if off[3] > 2.5 else map(abs, each))
        d = _to_nearest(lattice, p)  # cells, or separate bumps and dimples
        return 3 * d if off[3] < 2 else 2 * np.sqrt(np.maximum(1 - (d / 0.45) ** 2, 0))

    sign = rng.choice([-1, 1]) if kinds > 5 else 1
    return lambda p: sign * high * wave(p)


def _noise(lattice, p):
    # Smoothly interpolates random values at lattice points.
    return scipy.ndimage.map_coordinates(lattice, p.T, order=2, mode="grid-wrap")


def _to_nearest(lattice, p):
    # Distances to the nearest of random points, one in each cell.
    cell, nearest = np.floor(p).astype(int), np.full(len(p), np.inf)
    for step in np.ndindex(3, 3, 3):
        at = cell + np.array(step) - 1
        point = at + 0.5 + 0.2 * lattice[:, *(at % 16).T].T
        nearest = np.minimum(nearest, norm(p - point))
    return nearest


def _shape(rng):
    # A ball, a sheet, a pipe or a ring of even faces.
    kind = rng.integers(0, 5)
    if kind == 0:  # a ball from a polyhedron whose faces are divided
        v, f = _polyhedron(rng)
        for _ in range(rng.integers(4, 6)):
            v, f = halved(v, f)
        v = v / norm(v)[:, None]
        return v * rng.uniform(0.6, 1.4, 3), f
    rows = int(np.exp(rng.uniform(*np.log((40, 140)))))
    columns = int(rows * rng.uniform(0.5, 1.5))
    closed = kind != 4
    a = np.arange(columns) * 2 * np.pi / (columns if closed else 2 * columns)
    t = np.linspace(0, 1, rows)
    if kind == 1:  # a ball with poles
        r, z = np.sin(np.pi * (t * 0.96 + 0.02)), -np.cos(np.pi * (t * 0.96 + 0.02))
    elif kind == 2:  # a pipe
        r, z = np.full(rows, 0.5), rng.uniform(1, 3) * t
    else:
        r, z = 1 + 0.4 * np.cos(2 * np.pi * t), 0.4 * np.sin(2 * np.pi * t)
    x, y, z = r[:, None] * np.cos(a), r[:, None] * np.sin(a), np.repeat(z[:, None], columns, 1)
    v = np.stack([x, y, z], -1)
    if kind == 4:  # a sheet, bent or flat
        x, y = np.meshgrid(np.linspace(-1, 1, columns), np.linspace(-1, 1, rows))
        v = np.stack([x, y, rng.uniform(0, 0.4) * np.sin(2 * x + y)], -1)
    return _quads(rng, v, closed)


def _quads(rng, v, closed):
    # Splits the quads of a vertex grid into triangles, by equal or alternating diagonals.
    rows, columns = v.shape[:2]
    i, j = np.mgrid[: rows - 1, : columns - (not closed)]
    at = lambda x, y: (x * columns + y % columns).reshape(-1)  # noqa: E731
    a, b, c, d = at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)
    odd = ((i + j) % 2 == 1).reshape(-1, 1) & (rng.random() < 0.3)
    one = np.where(odd, np.stack([a, b, d], 1), np.stack([a, b, c], 1))
    two = np.where(odd, np.stack([b, c, d], 1), np.stack([a, c, d], 1))
    return v.reshape(-1, 3), np.ascontiguousarray(np.concatenate([one, two]), np.int32)


def _polyhedron(rng):
    # An octahedron or an icosahedron.
    if rng.random() < 0.4:
        v = np.concatenate([np.eye(3), -np.eye(3)])
    else:
        long = (1 + np.sqrt(5)) / 2
        ends = np.array([(0.0, x, y * long) for x in (-1, 1) for y in (-1, 1)])
        v = np.concatenate([np.roll(ends, k, axis=1) for k in range(3)])
    f = ConvexHull(v).simplices
    outward = np.linalg.det(v[f]) > 0
    return v, np.where(outward[:, None], f, f[:, ::-1]).astype(np.int32)


def halved(v, f):
    """Divide each face into four at the midpoints of its edges; vertices do not move."""
    ends = np.sort(f[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    used, index = np.unique(ends, axis=0, return_inverse=True)
    a, b, c = (index.reshape(-1, 3) + len(v)).T
    v = np.concatenate([v, v[used].mean(1)])
    corners = (f[:, 0], a, c), (a, f[:, 1], b), (c, b, f[:, 2]), (a, b, c)
    f = np.concatenate([np.stack(each, 1) for each in corners])
    return v, np.ascontiguousarray(f, np.int32)
