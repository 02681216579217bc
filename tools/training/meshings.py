# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes solids from voxel grids, as remeshers do."""

from __future__ import annotations

from itertools import product

import numpy as np
from distances import Floats, Solid, norm

EXTENT = 1.5
"""Solids lie within this distance of the origin along each axis."""


def sampled(solid: Solid, n: int) -> Floats:
    """Sample distances on a grid of n^3 points; far from the surface at every other point only.

    All points are sampled in coarse cells with a distance below 4.2 steps. This is more than the
    diagonal of a coarse cell, 3.5 steps, to allow for inexact distances.
    """
    line = np.linspace(-EXTENT, EXTENT, n)
    spacing = line[1] - line[0]
    d = np.empty((n, n, n))
    rough = line[::2]
    m = len(rough)
    coarse = _evaluated(solid, _points(rough, rough, rough)).reshape(m, m, m)
    near = abs(coarse) < 4.2 * spacing
    for axis in range(3):  # and the coarse points next to those
        for shift in (1, -1):
            near = near | (np.roll(near, shift, axis) & _inner(near.shape, axis, shift))
    index = np.minimum(np.arange(n) // 2, m - 1)
    d = coarse[np.ix_(index, index, index)]
    asked = np.argwhere(near[np.ix_(index, index, index)])
    d[tuple(asked.T)] = _evaluated(solid, line[asked])
    return d


def _inner(shape, axis, shift):
    # False where `roll` wraps around the border.
    keep = np.ones(shape, bool)
    border = [slice(None)] * 3
    border[axis] = slice(0, 1) if shift == 1 else slice(-1, None)
    keep[tuple(border)] = False
    return keep


def _points(x, y, z):
    return np.stack(np.meshgrid(x, y, z, indexing="ij"), -1).reshape(-1, 3)


def _evaluated(solid, points):
    pieces = np.array_split(points, max(len(points) // 50000, 1))
    return np.concatenate([solid(x) for x in pieces])


def renormalized(d: Floats, spacing: float) -> Floats:
    """Change distances as the voxel remesh of OpenVDB, used by Blender, does before meshing.

    They are lowered by 0.8 voxels, and one upwind step towards |grad d| = 1 is taken, which is kept
    where it makes them smaller. It doubles the width of the slanted strips along concave creases.
    """
    level = d / spacing - 0.8
    squares = np.zeros_like(level)
    for axis in range(3):
        steps = np.diff(level, axis=axis)
        none = np.zeros_like(np.take(level, [0], axis))
        back = np.concatenate([none, steps], axis)
        ahead = np.concatenate([steps, none], axis)
        sign = np.where(level > 0, 1.0, -1.0)
        squares += np.maximum(np.maximum(sign * back, 0), np.maximum(-sign * ahead, 0)) ** 2
    step = level / np.sqrt(level**2 + squares) * (np.sqrt(squares) - 1)
    return spacing * (np.minimum(level, level - step) + 0.8)


def surface_nets(d: Floats) -> tuple[Floats, np.ndarray]:
    """Mesh a grid with one vertex per cell, at the mean of the surface's crossings of its edges.

    Quads are split along the shorter diagonal.
    """
    n = len(d)
    inside = d < 0
    corners = [inside[tuple(slice(k, k + n - 1) for k in c)] for c in product((0, 1), repeat=3)]
    used = np.logical_or.reduce(corners) & ~np.logical_and.reduce(corners)
    cells = np.argwhere(used)
    count, total = np.zeros(len(cells)), np.zeros((len(cells), 3))
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        for i, j in product((0, 1), (0, 1)):
            lo, hi = [0, 0, 0], [0, 0, 0]
            lo[others[0]] = hi[others[0]] = i
            lo[others[1]] = hi[others[1]] = j
            hi[axis] = 1
            one, two = (d[tuple((cells + c).T)] for c in (lo, hi))
            crossed = (one < 0) != (two < 0)
            place = np.tile(np.array(lo, float), (len(cells), 1))
            place[:, axis] = np.where(crossed, one / np.where(crossed, one - two, 1), 0)
            count += crossed
            total += place * crossed[:, None]
    number = np.full((n - 1,) * 3, -1)
    number[used] = np.arange(len(cells))
    v = cells + total / count[:, None]
    quads = []
    for axis in range(3):
        a, b = np.eye(3, dtype=int)[(axis + 1) % 3], np.eye(3, dtype=int)[(axis + 2) % 3]
        lo = tuple(slice(0, -1) if k == axis else slice(1, -1) for k in range(3))
        hi = tuple(slice(1, None) if k == axis else slice(1, -1) for k in range(3))
        at = np.argwhere(inside[lo] != inside[hi]) + 1 - np.eye(3, dtype=int)[axis]
        quad = np.stack([number[tuple((at - s).T)] for s in (a + b, b, 0 * a, a)], 1)
        out = inside[tuple(at.T)]
        quad[~out] = quad[~out][:, ::-1]
        quads.append(quad)
    q = np.concatenate(quads)
    short = norm(v[q[:, 0]] - v[q[:, 2]]) <= norm(v[q[:, 1]] - v[q[:, 3]])
    halves = np.where(short[:, None, None], [[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]])
    f = np.take_along_axis(q, halves.reshape(-1, 6), 1).reshape(-1, 3)
    return v, np.ascontiguousarray(f, np.int32)


def marching_cubes(d: Floats) -> tuple[Floats, np.ndarray]:
    from skimage.measure import marching_cubes as march

    v, f, _, _ = march(d, 0.0)
    return v.astype(float), np.ascontiguousarray(f, np.int32)


def umbrella(v: Floats, f: np.ndarray, passes: int, share: float = 1.0) -> Floats:
    """Move vertices, or other vertex values, by a share of the way to the mean of neighbours."""
    ends = np.concatenate([f, f[:, [1, 2, 0]], f[:, [2, 0, 1]]])
    count = np.maximum(np.bincount(ends[:, 0], minlength=len(v)) * 2.0, 1)
    for _ in range(passes):
        sums = [np.bincount(ends[:, 0], x[ends[:, 1]] + x[ends[:, 2]], len(v)) for x in v.T]
        v = v + share * (np.stack(sums, 1) / count[:, None] - v)
    return v


RAISED = 0.3
"""With *Preserve Volume*, on by default, Blender's voxel remesh first meshes the level set at this
distance outside the surface, in voxels."""


def preserved(solid: Solid, v: Floats, f: np.ndarray, h: float) -> Floats:
    """Move vertices along their normals onto the solid, as *Preserve Volume* does in the end.

    At creases they come closer to the edge than the nearest points of the solid are.
    """
    ways = np.zeros_like(v)
    edges = v[f[:, [1, 2, 0]]] - v[f]
    normals = np.cross(edges[:, 0], edges[:, 1])
    normals /= np.maximum(norm(normals), 1e-12)[:, None]
    for k in range(3):
        one, two = edges[:, k], -edges[:, k - 1]
        cosines = (one * two).sum(1) / np.maximum(norm(one) * norm(two), 1e-12)
        angle = np.arccos(np.clip(cosines, -1, 1))
        for x in range(3):
            ways[:, x] += np.bincount(f[:, k], angle * normals[:, x], len(v))
    ways /= np.maximum(norm(ways), 1e-12)[:, None]
    moved = v
    for _ in range(16):
        moved = moved - solid(moved)[:, None] * ways
    missed = (abs(solid(moved)) > 0.02 * h) | (norm(moved - v) > 5 * h)
    return np.where(missed[:, None], v, moved)


def mean_edge(v: Floats, f: np.ndarray) -> float:
    return float(norm(v[f] - v[f[:, [1, 2, 0]]], 2).mean())
