# SPDX-License-Identifier: GPL-3.0-or-later
"""Random solids like those that people remesh: machine parts, fillets, statues, thin walls."""

from __future__ import annotations

import numpy as np
from distances import (
    Solid,
    ball,
    blend,
    both,
    box,
    bumpy,
    cut,
    cylinder,
    ellipsoid,
    extruded,
    greatest,
    grown,
    joined,
    minus,
    norm,
    placed,
    polytope,
    prism,
    profile,
    round_union,
    torus,
    turn,
    turned,
    union,
    waved,
)

KINDS = "part", "filleted", "plinth", "statue", "thin", "smooth", "mixed"
SHARES = 0.30, 0.22, 0.16, 0.11, 0.08, 0.06, 0.07


def solid(rng, kind: str, h: float) -> Solid:
    """Make a solid within |coordinates| < 1.38, for a grid of voxels of width h."""
    shape = _MAKE[kind](rng, h)
    if rng.random() < 0.6:
        whole, q = shape, turn(rng)
        shape = lambda p: whole(p @ q)  # noqa: E731
    # Cuts at the border of the grid are creases too.
    inside = shape
    return lambda p: np.maximum(inside(p), greatest(abs(p)) - 1.38)


def simple(rng, size) -> Solid:
    """Make one convex, crisp part around the origin."""
    a, b, c = rng.uniform(0.25, 0.7, 3) * size
    kind = rng.integers(0, 9)
    if kind <= 3:
        return box((0, 0, 0), (a, b, c))
    if kind <= 5:
        slope = rng.choice([0.0, 0.0, rng.uniform(-0.4, 0.4)])
        return cylinder((0, 0, 0), a, b, int(rng.integers(0, 3)), slope)
    if kind == 6:
        return prism(rng, max(a, 0.35 * size), b, int(rng.integers(0, 3)))
    if kind == 7:
        return polytope(rng, 0.6 * size)
    return both(ball((0, 0, -0.3 * a), 1.1 * a), lambda p: -0.4 * a - p[:, 2])


def part(rng, count=None, union=union, minus=minus) -> Solid:
    """Make a machine part from simple parts, joined or cut away, holes, slots and rows."""
    shape = simple(rng, rng.uniform(1.3, 1.9))
    for _ in range(rng.integers(0, 6) if count is None else count):
        at, kind = rng.uniform(-0.7, 0.7, 3), rng.random()
        q = turn(rng) if rng.random() < 0.25 else np.eye(3)
        if kind < 0.35:
            shape = union(shape, placed(simple(rng, rng.uniform(0.4, 1.2)), at, q))
        elif kind < 0.55:
            shape = minus(shape, placed(simple(rng, rng.uniform(0.4, 1.1)), at, q))
        elif kind < 0.75:
            hole = cylinder((0, 0, 0), rng.uniform(0.06, 0.35), 3, int(rng.integers(0, 3)))
            shape = minus(shape, placed(hole, at, q))
        elif kind < 0.85:
            h = np.array([3, rng.uniform(0.05, 0.3), rng.uniform(0.1, 0.4)])[rng.permutation(3)]
            shape = minus(shape, box(at, h))
        else:
            n, step = int(rng.integers(3, 7)), rng.uniform(0.2, 0.4)
            h = np.array([step * rng.uniform(0.2, 0.38), *rng.uniform((0.05, 0.1), (0.8, 0.6))])
            way, mix = np.zeros(3), rng.permutation(3)
            way[np.argsort(mix)[0]] = step
            row = [box(at + (i - n / 2) * way, h[mix]) for i in range(n)]
            shape = union(shape, *row) if rng.random() < 0.6 else minus(shape, *row)
    return shape


def statue(rng, at, size) -> Solid:
    """Blend ellipsoids and tori, with relief, to a shape without creases."""
    if rng.random() < 0.4:
        return bumpy(at, 0.75 * size, rng, size * rng.uniform(0.02, 0.38), rng.uniform(4, 12))
    shape = ellipsoid(at, size * rng.uniform(0.4, 0.9, 3))
    for _ in range(rng.integers(1, 6)):
        c, s = at + size * rng.uniform(-0.6, 0.6, 3), size * rng.uniform(0.15, 0.55)
        other = (
            torus(c, s, 0.35 * s, int(rng.integers(0, 3)))
            if rng.random() < 0.2
            else ellipsoid(c, s * rng.uniform(0.4, 1.2, 3))
        )
        shape = blend(shape, other, rng.uniform(0.1, 0.4) * size)
    if rng.random() < 0.8:
        f = np.exp(rng.uniform(np.log(4), np.log(22)))
        shape = waved(shape, rng, rng.uniform(0.1, 0.9) / f, f)
    return shape


def filleted(rng, h, voxels=(0.5, 9.0)) -> Solid:
    """Make a rounded body with crisp holes, slots and parts; `voxels` is the range of radii."""
    r = h * np.exp(rng.uniform(*np.log(voxels)))
    a = np.maximum(rng.uniform(0.4, 0.95, 3), r + 0.1)
    kind = rng.integers(0, 4)
    if kind <= 1:
        shape = grown(box((0, 0, 0), a - r), r)
    elif kind == 2:
        shape = grown(cylinder((0, 0, 0), a[0] - r, a[1] - r, int(rng.integers(0, 3))), r)
    else:
        other = box((rng.uniform(-0.3, 0.3), 0, a[2] + 0.1), rng.uniform(0.2, 0.5, 3))
        shape = round_union(box((0, 0, -0.2), a * (1, 1, 0.6)), other, r)
    for _ in range(rng.integers(0, 5)):
        at = rng.uniform(-0.6, 0.6, 3)
        if rng.random() < 0.5:
            hole = cylinder(at, rng.uniform(0.1, 0.35), 3, int(rng.integers(0, 3)))
            shape = minus(shape, hole)
        elif rng.random() < 0.6:
            half = np.array([3, rng.uniform(0.08, 0.3), rng.uniform(0.1, 0.4)])
            shape = minus(shape, box(at, half[rng.permutation(3)]))
        else:
            shape = union(shape, placed(simple(rng, rng.uniform(0.4, 1.0)), at, np.eye(3)))
    return shape


def plinth(rng, h) -> Solid:
    """Make a statue on, or partly in, a machine part."""
    low = rng.uniform(0.2, 0.45)
    half = np.array([rng.uniform(0.5, 0.95), rng.uniform(0.5, 0.95), low])
    kind = rng.integers(0, 5)
    if kind <= 1:
        base = box((0, 0, 0), half)
    elif kind == 2:
        base = cylinder((0, 0, 0), half[0], low)
    else:
        base = prism(rng, 1.15 * half[0], low) if kind == 3 else part(rng, 2)
    at = np.array([*rng.uniform(-0.25, 0.25, 2), 0.4 + rng.uniform(0.0, 0.35)])
    on = statue(rng, at, rng.uniform(0.5, 0.9))
    return union(placed(base, np.array([0, 0, -0.6]), np.eye(3)), on)


def thin(rng, h) -> Solid:
    """Make walls, ribs and pins, 1 to 5 voxels thick."""
    t = h * rng.uniform(0.5, 2.5)
    if rng.integers(0, 4) == 0:
        s, top = part(rng, 1), rng.uniform(-0.2, 0.3)
        return both(lambda p: abs(s(p)) - t, lambda p: p[:, 2] - top)
    shape = box((0, 0, -0.5), (0.9, 0.8, max(t, 0.1)))
    for _ in range(rng.integers(2, 6)):
        at = np.array([*rng.uniform(-0.6, 0.6, 2), 0.0])
        if rng.random() < 0.4:
            r = rng.uniform(0.15, 0.4)
            shape = union(shape, minus(cylinder(at, r + t, 0.6), cylinder(at, r - t, 2)))
        elif rng.random() < 0.5:
            shape = union(shape, cylinder(at, 1.5 * t, 0.7, int(rng.integers(0, 3))))
        else:
            wall = box((0, 0, 0), np.array([t, rng.uniform(0.2, 0.8), 0.5]))
            q = turn(rng) if rng.random() < 0.2 else np.eye(3)
            shape = union(shape, placed(wall, at, q))
    return shape


def smooth(rng, h) -> Solid:
    kind = rng.integers(0, 4)
    if kind == 0:
        return torus((0, 0, 0), rng.uniform(0.6, 0.85), rng.uniform(0.12, 0.4))
    if kind == 1:
        return ellipsoid((0, 0, 0), rng.uniform(0.3, 1.0, 3))
    if kind == 2:
        r = rng.uniform(0.12, 0.4)
        return grown(box((0, 0, 0), rng.uniform(0.2, 0.6, 3)), r)
    shape = ball((0, 0, 0), 0.5)
    for _ in range(3):
        shape = blend(shape, ball(rng.uniform(-0.5, 0.5, 3), rng.uniform(0.2, 0.5)),
                      rng.uniform(0.15, 0.5))  # fmt: skip
    return shape


def profiled(rng, h) -> Solid:
    """Make gears, stepped shafts, combs or channels: crisp, with as many concave as convex edges.

    Their distances are exact, like those a remesher computes from a mesh.
    """
    kind = rng.integers(0, 5)
    if kind == 0:
        shape = turned(profile(_shaft(rng)))
    else:
        half = rng.uniform(0.12, 0.7)
        shape = extruded(profile(_outline(rng, 1.0)), half)
        for side in (1, -1):
            if rng.random() < 0.4:
                shape = joined(shape, _hub(rng, side, half))
    for _ in range(rng.integers(0, 4)):
        if rng.random() < 0.5:  # a bore, or a blind hole
            at = np.array([0, 0, 0]) if rng.random() < 0.5 else rng.uniform(-0.5, 0.5, 3)
            deep = 3 if rng.random() < 0.6 else rng.uniform(0.1, 0.5)
            shape = cut(shape, cylinder(at, rng.uniform(0.07, 0.3), deep))
        else:  # a pocket
            at, half = rng.uniform(-0.6, 0.6, 3), rng.uniform(0.08, 0.4, 3)
            shape = cut(shape, box(at, half))
    return placed(shape, np.zeros(3), np.eye(3)[rng.permutation(3)])


def lettered(rng, h) -> Solid:
    """Make extruded outlines like letters and emblems: curved, with crisp, beveled or round rims.

    Bevels and roundings are 2 to 7 voxels wide: narrower bevels look like what remeshers leave of
    crisp edges. Distances are exact where outlines do not cross.
    """
    flat = _curve(rng)
    for _ in range(rng.integers(0, 3)):
        at, radius = rng.uniform(-0.5, 0.5, 2), rng.uniform(0.08, 0.3)
        flat = minus(flat, lambda p, at=at, radius=radius: norm(p - at) - radius)
    half = np.exp(rng.uniform(np.log(0.06), np.log(0.6)))
    across = profile(_section(rng, half, h))
    shape = lambda p: across(np.stack([flat(p[:, :2]), p[:, 2]], 1))  # noqa: E731
    return placed(shape, np.zeros(3), np.eye(3)[rng.permutation(3)])


def _curve(rng):
    # A flat shape around the origin: a wavy disc, a bent stroke, or a polygon with round corners.
    kind = rng.integers(0, 3)
    if kind == 0:
        a, n = np.arange(100) * 2 * np.pi / 100, np.arange(2, 8)[:, None]
        waves = rng.normal(size=(6, 1)) * np.cos(n * a + rng.uniform(0, 6.3, (6, 1))) / n
        r = np.maximum(1 + rng.uniform(0, 0.6) * waves.sum(0), 0.3)
        r *= rng.uniform(0.7, 1.1) / r.max()
        return profile(np.stack([r * np.cos(a), r * rng.uniform(0.5, 1) * np.sin(a)], 1))
    if kind == 1:
        t = np.linspace(0, 1, int(rng.integers(12, 40)))
        way = np.cumsum(rng.normal(size=4)[:, None] * np.cos(np.arange(4)[:, None] * np.pi * t), 0)
        line = np.cumsum(np.stack([np.cos(3 * way[-1]), np.sin(3 * way[-1])], 1), 0)
        line -= (line.min(0) + line.max(0)) / 2
        stroke = profile(np.concatenate([line, line[::-1]]) * (0.9 / abs(line).max()))
        wide = rng.uniform(0.06, 0.25)
        return lambda p: abs(stroke(p)) - wide
    r = rng.uniform(0.02, 0.2)
    corners = profile(_outline(rng, 1.0 - r))
    return lambda p: corners(p) - r


def _section(rng, half, h):
    # The outline of a rim, in the plane of the distance to the flat shape and the height.
    size = min(h * np.exp(rng.uniform(np.log(2), np.log(7))), 0.9 * half)
    kind = rng.random()
    edge = np.zeros((1, 2))
    if kind > 0.85 and size > 1.9 * h:  # round
        a = np.linspace(0, np.pi / 2, 9)[:, None]
        edge = size * np.concatenate([np.cos(a) - 1, np.sin(a) - 1], 1)
    elif kind > 0.75 and size > 1.9 * h:  # beveled
        edge = size * np.array([[0, -rng.uniform(0.8, 1.4)], [-1, 0]])
        edge[0, 1] = max(edge[0, 1], -0.9 * half)
    high = edge + (0, half)
    low = (edge if rng.random() < 0.7 else np.zeros((1, 2))) + (0, half)
    return np.concatenate([high, [[-4.0, half], [-4.0, -half]], (low * (1, -1))[::-1]])


def _hub(rng, side, half):
    # A hub, round or with a random outline, on one side of a plate of half thickness `half`.
    radius, high = rng.uniform(0.25, 0.55), half + rng.uniform(0.08, 0.5)
    flat = profile(_outline(rng, radius))
    if rng.random() < 0.6:
        flat = lambda p: np.linalg.norm(p, axis=1) - radius  # noqa: E731
    return placed(extruded(flat, high / 2), np.array([0, 0, side * high / 2]), np.eye(3))


def _outline(rng, size):
    # A polygon around the origin: teeth, a star, steps.
    kind = rng.integers(0, 3)
    if kind == 0:
        n = int(rng.integers(5, 21))
        low, shares = rng.uniform(0.6, 0.88), np.sort(rng.uniform(0.0, 0.42, 2))
        shares = np.array([0, shares[0], shares[1] + 0.1, shares[0] + shares[1] + 0.15])
        a = (np.arange(n)[:, None] + shares / max(1.0, 1.15 * shares[-1])) * 2 * np.pi / n
        r = np.array([low, 1, 1, low]) * np.ones((n, 1))
        a, r = a.reshape(-1), r.reshape(-1)
    elif kind == 1:
        n = int(rng.integers(4, 13))
        a = (np.arange(n) + rng.uniform(-0.3, 0.3, n)) * 2 * np.pi / n
        r = rng.uniform(0.4, 1.0, n)
    else:
        n = int(rng.integers(2, 7))
        x = np.linspace(-1, 1, n + 1)
        up, down = rng.uniform(0.1, 0.9, n), -rng.uniform(0.1, 0.9, n)
        top = np.stack([np.repeat(x, 2)[1:-1], np.repeat(up, 2)], 1)
        low = np.stack([np.repeat(x, 2)[1:-1], np.repeat(down, 2)], 1)
        return size * np.concatenate([low, top[::-1]])
    return size * np.stack([r * np.cos(a), r * np.sin(a)], 1)


def _shaft(rng):
    # Half of a cross section, of two to six steps, some of them slanted.
    n = int(rng.integers(2, 7))
    z = np.concatenate([[-1], np.sort(rng.uniform(-0.9, 0.9, n - 1)), [1]])
    r = rng.uniform(0.2, 1.0, (n, 1)) * np.ones(2)
    r += (rng.random((n, 1)) < 0.3) * rng.uniform(-0.15, 0.15, (n, 2))
    side = np.stack([r.reshape(-1), np.repeat(z, 2)[1:-1]], 1)
    return np.concatenate([[[-1.0, -1.0]], side, [[-1.0, 1.0]]])


def _mixed(rng, h) -> Solid:
    one = placed(part(rng, 1), np.array([-0.45, 0, 0]), np.eye(3))
    return union(one, placed(smooth(rng, h), np.array([0.5, 0.1, 0]), 1.4 * np.eye(3)))


_MAKE = {
    "part": lambda rng, h: part(rng),
    "filleted": filleted,
    "narrow": lambda rng, h: filleted(rng, h, (0.7, 2.6)),
    "plinth": plinth,
    "statue": lambda rng, h: statue(rng, np.zeros(3), rng.uniform(0.8, 1.2)),
    "thin": thin,
    "smooth": smooth,
    "mixed": _mixed,
    "profiled": profiled,
    "lettered": lettered,
    "exact": lambda rng, h: part(rng, None, joined, cut),
}
