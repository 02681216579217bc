# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes with small details on large faces, as design programs export them."""

from __future__ import annotations

import numpy as np
from distances import norm, turn
from scipy.spatial import Delaunay

SHARES = {"raised": 0.45, "coiled": 0.4, "toothed": 0.15}
"""Shares of the kinds of exports."""


def exported(rng) -> tuple[np.ndarray, np.ndarray]:
    """Make a plate with raised signs; a spring, thread or bent tube; or a toothed wheel."""
    kind = rng.choice(list(SHARES), p=list(SHARES.values()))
    v, f = {"raised": _raised, "coiled": _coiled, "toothed": _toothed}[str(kind)](rng)
    return v @ turn(rng), np.ascontiguousarray(f, np.int32)


def _raised(rng):
    # Signs raised above a plate or sunk into it.
    step, wide = 0.1 * np.exp(rng.uniform(np.log(0.5), np.log(2))), rng.uniform(0.1, 0.3)
    count = int(rng.integers(2, 9))
    outlines = [line + (1.6 * k, 0.0) for k in range(count) for line in _sign(rng, step, wide)]
    long, tall = 1.6 * count * rng.uniform(1.05, 4), rng.uniform(1.3, 12)
    left = -1 - 0.1 * long
    right = left + long + 2
    corners = np.array([[left, -tall], [right, -tall], [right, tall], [left, tall]])
    points = np.concatenate([corners, *outlines])
    points = points + rng.normal(size=points.shape) * 1e-5
    f = _triangles(points)
    inside = np.zeros(len(f), bool)
    for line in outlines:
        inside ^= _encloses(line, points[f].mean(1))
    high = rng.choice([-1, 1], p=[0.3, 0.7]) * rng.uniform(0.5, 4) * step
    rows = int(rng.integers(1, 4))
    beside = {tuple(e) for e in _ends(f[~inside]).tolist()}
    rim = [e for e in _ends(f[inside]).tolist() if (e[1], e[0]) in beside]
    top = f[inside] + rows * len(points)
    return _levels(points, high, rows, [f[~inside], top, *_walls(rim, len(points), rows)])


def _toothed(rng):
    # A wheel with teeth and a hole, extruded.
    teeth = int(rng.integers(5, 60))
    high = rng.uniform(0.03, 0.3)
    shape = np.sort(rng.random(int(rng.integers(4, 9))))
    level = np.clip(0.5 + 1.5 * np.sin(2 * np.pi * shape), 0, 1) * high
    angle = 2 * np.pi * (np.arange(teeth)[:, None] + shape).reshape(-1) / teeth
    outer = (1 + np.tile(level, teeth))[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1)
    n = int(rng.integers(6, 40))
    a = np.arange(n) * 2 * np.pi / n
    inner = rng.uniform(0.1, 0.6) * np.stack([np.cos(a), np.sin(a)], 1)
    far = 40.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    points = np.concatenate([far, outer, inner])
    points = points + rng.normal(size=points.shape) * 1e-6
    f = _triangles(points)
    middle = points[f].mean(1)
    f = f[_encloses(outer, middle) & ~_encloses(inner, middle)]
    rows, high = int(rng.integers(1, 4)), rng.uniform(0.05, 1.0)
    ends = _ends(f)
    known = {tuple(e) for e in ends.tolist()}
    rim = [e for e in ends.tolist() if (e[1], e[0]) not in known]
    top = f + rows * len(points)
    return _levels(points, high, rows, [f[:, ::-1], top, *_walls(rim, len(points), rows)])


def _coiled(rng):
    # A section swept along a helix or a bend: springs, threads, tubes.
    sides = int(rng.integers(3, 15))
    steps = int(np.exp(rng.uniform(np.log(6), np.log(40))))  # in a turn
    turns = rng.uniform(0.3, 8)
    rows = max(int(steps * turns), 3)
    t = 2 * np.pi * turns * np.arange(rows + 1) / rows
    r = 1 + rng.choice([0, rng.uniform(-0.1, 0.1)]) * t / t[-1]
    angle = 2 * np.pi * (np.arange(sides) + rng.random()) / sides
    size = rng.uniform(0.04, 0.3) * np.exp(rng.uniform(-0.5, 0.5, 2))
    out, up = size[0] * np.cos(angle), size[1] * np.sin(angle)
    rise = 2 * size[1] * rng.uniform(1.05, 3) / (2 * np.pi)
    radius = r[:, None] + out
    v = np.stack([radius * np.cos(t)[:, None], radius * np.sin(t)[:, None],
                  rise * t[:, None] + up], -1)  # fmt: skip
    i, j = np.mgrid[:rows, :sides]
    at = lambda row, side: (row * sides + side % sides).reshape(-1)  # noqa: E731
    a, b, c, d = at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)
    k, last = np.arange(1, sides - 1), rows * sides
    caps = [np.stack([0 * k, k, k + 1], 1), np.stack([0 * k + last, k + 1 + last, k + last], 1)]
    f = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1), *caps])
    return v.reshape(-1, 3), f


def _sign(rng, step, wide):
    # Outlines of a sign in a box of size 2: a bent stroke, a ring or ellipse, or a polygon.
    kind = rng.random()
    if kind < 0.5:
        line = rng.uniform(-0.75, 0.75, (int(rng.integers(2, 5)), 2))
        if rng.random() < 0.6:  # an arc
            first, last = rng.uniform(0, 6.3), rng.uniform(1, 5)
            angle = np.linspace(first, first + last, 24)
            line = 0.7 * np.stack([np.cos(angle), np.sin(angle)], 1) * rng.uniform(0.4, 1, 2)
        line = _resampled(line, step)
        along = np.gradient(line, axis=0)
        side = np.stack([-along[:, 1], along[:, 0]], 1)
        side *= 0.5 * wide / np.maximum(norm(side), 1e-9)[:, None]
        return [np.concatenate([line + side, (line - side)[::-1]])]
    size = rng.uniform(0.4, 0.75, 2)
    if kind < 0.8:
        most = max(int(6.3 * size.mean() / step), 8)
        angle = np.arange(most) * 2 * np.pi / most
        ring = size * np.stack([np.cos(angle), np.sin(angle)], 1)
        inner = ring * (1 - wide / size) if (size > 1.5 * wide).all() else ring * 0.5
        return [ring, inner] if rng.random() < 0.6 else [ring]
    n = int(rng.integers(3, 7))
    angle = 2 * np.pi * (np.arange(n + 1) + rng.random()) / n
    return [_resampled(size * np.stack([np.cos(angle), np.sin(angle)], 1), step)[:-1]]


def _resampled(line, step):
    lengths = np.concatenate([[0], np.cumsum(norm(np.diff(line, axis=0)))])
    t = np.linspace(0, lengths[-1], max(int(lengths[-1] / step), 3) + 1)
    return np.stack([np.interp(t, lengths, x) for x in line.T], 1)


def _triangles(points):
    # A triangulation of points in the plane, counterclockwise.
    f = Delaunay(points).simplices
    a, b, c = (points[f[:, k]] for k in range(3))
    wound = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    return np.where((wound < 0)[:, None], f[:, ::-1], f)[abs(wound) > 1e-12]


def _encloses(line, points):
    # Whether a closed polygon encloses points, by the number of its crossings.
    found = np.zeros(len(points), bool)
    x, y = points.T
    for (ax, ay), (bx, by) in zip(line, np.roll(line, -1, 0), strict=True):
        crosses = (ay > y) != (by > y)
        found ^= crosses & (x < ax + (y - ay) * (bx - ax) / (by - ay if by != ay else 1.0))
    return found


def _ends(f):
    return np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]])


def _walls(rim, count, rows):
    # Faces above the edges `rim`, in several rows; a level has `count` vertices.
    a, b = np.array(rim, int).reshape(-1, 2).T
    walls = []
    for first in range(0, rows * count, count):
        one, two = a + first, b + first
        walls += [
            np.stack([one, two, two + count], 1),
            np.stack([one, two + count, one + count], 1),
        ]
    return walls


def _levels(points, high, rows, faces):
    # Puts the points at the heights of all rows, and drops those that no face uses.
    heights = np.linspace(0, high, rows + 1)
    v = np.concatenate([np.column_stack([points, np.full(len(points), z)]) for z in heights])
    used, f = np.unique(np.concatenate(faces), return_inverse=True)
    return v[used], f.reshape(-1, 3)
