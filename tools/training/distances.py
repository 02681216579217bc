# SPDX-License-Identifier: GPL-3.0-or-later
"""Approximate signed distance functions of solids: of points (k, 3), negative inside."""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Solid = Callable[[Floats], Floats]


def norm(x: Floats, axis: int = 1) -> Floats:
    """Return the lengths of short rows, faster than `numpy.linalg.norm`."""
    return np.sqrt(sum(c * c for c in np.moveaxis(x, axis, 0)))


def greatest(x: Floats) -> Floats:
    """Return the greatest value of each short row."""
    return reduce(np.maximum, x.T)


def turn(rng: np.random.Generator) -> Floats:
    """Return a random rotation matrix."""
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def box(centre: npt.ArrayLike, half: npt.ArrayLike) -> Solid:
    c, h = np.array(centre, float), np.array(half, float)

    def distance(p):
        q = abs(p - c) - h
        return norm(np.maximum(q, 0)) + np.minimum(greatest(q), 0)

    return distance


def cylinder(centre, radius, half, axis=2, slope=0.0) -> Solid:
    """A cylinder; with a slope, a truncated cone."""
    k, c = [i for i in range(3) if i != axis], np.array(centre, float)

    def distance(p):
        q = p - c
        side = (norm(q[:, k]) - radius + slope * q[:, axis]) / np.hypot(1, slope)
        e = np.stack([side, abs(q[:, axis]) - half], 1)
        return norm(np.maximum(e, 0)) + np.minimum(greatest(e), 0)

    return distance


def prism(rng, radius, half, axis=2) -> Solid:
    n = int(rng.integers(3, 8))
    a = rng.uniform(0, 6.3) + (np.arange(n) + rng.uniform(-0.2, 0.2, n)) * 2 * np.pi / n
    ways = np.zeros((n, 3))
    ways[:, (axis + 1) % 3], ways[:, (axis + 2) % 3] = np.cos(a), np.sin(a)
    heights = radius * rng.uniform(0.6, 1.0, n)
    return lambda p: np.maximum(greatest(p @ ways.T - heights), abs(p[:, axis]) - half)


def polytope(rng, radius) -> Solid:
    ways = rng.normal(size=(rng.integers(6, 14), 3))
    ways /= norm(ways)[:, None]
    heights = rng.uniform(0.5, 1.0, len(ways)) * radius
    return lambda p: np.maximum(greatest(p @ ways.T - heights), norm(p) - 1.3 * radius)


def ball(centre, radius) -> Solid:
    return lambda p: norm(p - np.array(centre, float)) - radius


def ellipsoid(centre, radii) -> Solid:
    r = np.array(radii, float)

    def distance(p):
        q = p - np.array(centre, float)
        k, g = norm(q / r), norm(q / r**2)
        return k * (k - 1) / np.maximum(g, 1e-9)

    return distance


def torus(centre, large, small, axis=2) -> Solid:
    k = [i for i in range(3) if i != axis]

    def distance(p):
        q = p - np.array(centre, float)
        return np.hypot(norm(q[:, k]) - large, q[:, axis]) - small

    return distance


def union(*solids: Solid) -> Solid:
    return lambda p: reduce(np.minimum, (s(p) for s in solids))


def minus(a: Solid, *solids: Solid) -> Solid:
    return lambda p: reduce(np.maximum, (-s(p) for s in solids), a(p))


def joined(first: Solid, *others: Solid) -> Solid:
    """The union of solids, with exact inner distances at concave edges of 90 degrees.

    Their minimum is too short there, so that voxel edges would be crossed at wrong points.
    """

    def distance(p):
        d = first(p)
        for other in others:
            x = other(p)
            d = np.minimum(d, x) * _longer(-d, -x)
        return d

    return distance


def cut(first: Solid, *others: Solid) -> Solid:
    """The first solid minus the others, with exact outer distances at edges of 90 degrees."""

    def distance(p):
        d = first(p)
        for other in others:
            x = -other(p)
            d = np.maximum(d, x) * _longer(d, x)
        return d

    return distance


def _longer(x, y):
    # sqrt(x^2 + y^2) / max(x, y) where both are positive, else 1.
    less, more = np.maximum(np.minimum(x, y), 0), np.maximum(np.maximum(x, y), 1e-12)
    return np.sqrt(1 + (less / more) ** 2)


def profile(corners: Floats) -> Solid:
    """A polygon in the plane, a function of points (k, 2); the order of corners is free."""
    begin, end = corners, np.roll(corners, -1, axis=0)
    along = end - begin
    squared = np.maximum((along**2).sum(1), 1e-30)

    def distance(p):
        nearest, inside = np.full(len(p), np.inf), np.zeros(len(p), bool)
        for a, b, u, s in zip(begin, end, along, squared, strict=True):
            w = p - a
            off = w - np.clip(w @ u / s, 0, 1)[:, None] * u
            nearest = np.minimum(nearest, (off**2).sum(1))
            across = (a[1] <= p[:, 1]) != (b[1] <= p[:, 1])
            inside ^= across & ((w[:, 0] * u[1] < w[:, 1] * u[0]) != (u[1] < 0))
        return np.where(inside, -1, 1) * np.sqrt(nearest)

    return distance


def extruded(outline: Solid, half: float, axis: int = 2) -> Solid:
    """A plane outline, extruded along an axis by `half` to either side."""
    k = [i for i in range(3) if i != axis]

    def distance(p):
        e = np.stack([outline(p[:, k]), abs(p[:, axis]) - half], 1)
        return norm(np.maximum(e, 0)) + np.minimum(greatest(e), 0)

    return distance


def turned(outline: Solid, axis: int = 2) -> Solid:
    """The solid of revolution of an outline, whose points are (radius, height)."""
    k = [i for i in range(3) if i != axis]
    return lambda p: outline(np.stack([norm(p[:, k]), p[:, axis]], 1))


def both(*solids: Solid) -> Solid:
    return lambda p: reduce(np.maximum, (s(p) for s in solids))


def grown(s: Solid, radius: float) -> Solid:
    return lambda p: s(p) - radius


def placed(s: Solid, at, rotation) -> Solid:
    return lambda p: s((p - at) @ rotation)


def blend(a: Solid, b: Solid, width: float) -> Solid:
    def distance(p):
        x, y = a(p), b(p)
        h = np.clip(0.5 + 0.5 * (y - x) / width, 0, 1)
        return y * (1 - h) + x * h - width * h * (1 - h)

    return distance


def round_union(a: Solid, b: Solid, radius: float) -> Solid:
    """A union with a fillet of this radius at the seam; needs exact distances."""

    def distance(p):
        x, y = a(p), b(p)
        inner = norm(np.maximum(np.stack([radius - x, radius - y], 1), 0))
        return np.maximum(radius, np.minimum(x, y)) - inner

    return distance


def waved(s: Solid, rng, high, frequency) -> Solid:
    """Add relief whose amplitude falls with frequency."""
    ways = rng.normal(size=(6, 3))
    ways *= (frequency * rng.uniform(0.5, 2.0, 6) / norm(ways))[:, None]
    start, share = rng.uniform(0, 6.3, 6), frequency / norm(ways)
    return lambda p: (s(p) + high * (np.sin(p @ ways.T + start) * share).sum(1) / 3) * 0.8


def bumpy(centre, radius, rng, high, frequency) -> Solid:
    """A ball of varying radius."""
    w, o = frequency * rng.uniform(0.7, 1.3, 3), rng.uniform(0, 6.3, 3)

    def distance(p):
        q = p - np.array(centre, float)
        length = norm(q)
        q = q / np.maximum(length, 1e-9)[:, None]
        return (length - radius - high * np.sin(q * w + o).prod(1)) * 0.8

    return distance


def gradient(s: Solid, p: Floats, step: float = 1e-4) -> Floats:
    """Return the unit normals of the level sets."""
    g = np.stack([s(p + step * a) - s(p - step * a) for a in np.eye(3)], 1)
    return g / np.maximum(norm(g), 1e-12)[:, None]


def nearest(s: Solid, p: Floats, most: float, rounds: int = 4) -> Floats:
    """Project points onto the surface by Newton steps that use distances up to `most`."""
    for _ in range(rounds):
        n = np.stack([s(p + 2e-4 * a) - s(p - 2e-4 * a) for a in np.eye(3)], 1) / 4e-4
        p = p - (np.clip(s(p), -most, most) / np.maximum((n * n).sum(1), 0.3))[:, None] * n
    return p


STRIP = 15.0
"""Faces whose normals are more degrees off are in the slanted strip that a remesher left."""

ACROSS = (0.1, 15.0), (0.25, 40.0), (0.4, 40.0)
"""Distances, in edge lengths, within which a crease counts, and its least angle in degrees. All
but the first are for faces in strips."""


def truths(
    s: Solid, centres: Floats, normals: Floats, edge: float, most: float
) -> tuple[Floats, Floats]:
    """Return the normals at the points nearest to faces, and those across creases beside them.

    Where there is no crease, both are the same. A strip along a crease is about an edge wide and
    its faces zigzag across the crease: if only the nearer side counted, so would the targets.
    """
    c = nearest(s, centres, most)
    first = gradient(s, c)
    u = np.cross(first, np.eye(3)[np.argmin(abs(first), 1)])
    u /= np.maximum(norm(u), 1e-12)[:, None]
    w = np.cross(first, u)
    in_strip = (normals * first).sum(1) < np.cos(np.radians(STRIP))
    second, asked = first.copy(), np.ones(len(c), bool)
    for width, angle in ACROSS:
        limit = np.cos(np.radians(angle))
        least = np.full(len(c), limit)
        for way in np.arange(8) * np.pi / 4:
            n = gradient(s, c + width * edge * (np.cos(way) * u + np.sin(way) * w))
            cos = (n * first).sum(1)
            better = asked & (cos < least)
            second[better], least[better] = n[better], cos[better]
        asked &= in_strip & (least == limit)
    return first, second
