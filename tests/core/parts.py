# SPDX-License-Identifier: GPL-3.0-or-later
"""Machine parts made by code whose creases are known, out of a surface net as a remesh gives it."""

import numpy as np
from remeshed import surface_net
from shock_filter import core

TURN = np.linalg.qr(np.array([[1.0, 0.3, 0.2], [-0.4, 1.0, 0.5], [0.1, -0.3, 1.0]]))[0]
"""Turns parts out of the grid."""

STEP = 0.01
"""Between points on creases."""


def remeshed(distance, count, turn=TURN, reach=1.5):
    """A mesh out of a grid of count³ points, whose rows of `turn` are the part's axes."""
    line = np.linspace(-reach, reach, count)
    points = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    values = distance(points @ turn.T).reshape(count, count, count)
    vertices, faces = surface_net(values, line[1] - line[0])
    return core.TriangleMesh((vertices - reach) @ turn.T, faces)


def box(half=(1.0, 0.7, 0.5)):
    """A box: its distance and its creases."""
    x, y, z = half
    corners = np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
    return extruded(corners, z)


def bracket():
    """An angle with a notch, and a round hole through its base."""
    outline = [[-1, -0.8], [1, -0.8], [1, -0.3], [-0.4, -0.3], [-0.4, 0.2], [-0.1, 0.2],
               [-0.1, 0.5], [-0.4, 0.5], [-0.4, 0.9], [-1, 0.9]]  # fmt: skip
    solid, creases = extruded(np.array(outline), 0.5)
    hole = lambda p: 0.22 - np.hypot(p[:, 0] - 0.35, p[:, 2])  # noqa: E731
    turn = np.arange(0.0, 2.0 * np.pi, STEP / 0.22)
    ring = np.stack([0.35 + 0.22 * np.cos(turn), np.zeros_like(turn), 0.22 * np.sin(turn)], axis=1)
    rims = [ring + [0.0, height, 0.0] for height in (-0.8, -0.3)]
    return lambda p: np.maximum(solid(p), hole(p)), np.concatenate([creases, *rims])


def cog(teeth=7):
    """A cog wheel with a bore."""
    angle = np.arange(4 * teeth) * np.pi / (2 * teeth)
    radius = np.where(np.arange(4 * teeth) % 4 < 2, 1.0, 0.72)
    outline = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    solid, creases = extruded(outline, 0.35)
    turn = np.arange(0.0, 2.0 * np.pi, STEP / 0.3)
    ring = np.stack([0.3 * np.cos(turn), 0.3 * np.sin(turn), np.zeros_like(turn)], axis=1)
    rims = [ring + [0.0, 0.0, height] for height in (-0.35, 0.35)]
    bored = lambda p: np.maximum(solid(p), 0.3 - np.hypot(p[:, 0], p[:, 1]))  # noqa: E731
    return bored, np.concatenate([creases, *rims])


def filleted(radius=0.3):
    """A plate with round corners: crisp rims, and fillets that are no creases."""
    half = np.array([1.0, 0.7])

    def distance(p):
        beyond = np.abs(p[:, :2]) - (half - radius)
        outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
        flat = outside + np.minimum(beyond.max(axis=1), 0.0) - radius
        return np.maximum(flat, np.abs(p[:, 2]) - 0.4)

    turn = np.arange(0.0, 2.0 * np.pi, STEP / radius)
    arc = radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    arc += np.sign(arc) * (half - radius)
    straight = between(np.array([[1.0, -0.4], [1.0, 0.4]]))
    sides = [straight * [s, 1] for s in (-1, 1)]
    straight = between(np.array([[-0.7, 0.7], [0.7, 0.7]]))
    sides += [straight * [1, s] for s in (-1, 1)]
    outline = np.concatenate([arc, *sides])
    return distance, raised(outline, 0.4)


def rook():
    """A turned tower with four merlons: rings of creases, some of them cut."""
    profile = np.array(
        [(0.0, -1.2), (0.75, -1.2), (0.75, -0.95), (0.5, -0.8), (0.4, 0.4),
         (0.62, 0.6), (0.62, 1.1), (0.42, 1.1), (0.42, 0.75), (0.0, 0.75)]
    )  # fmt: skip

    def distance(p):
        radius = np.hypot(p[:, 0], p[:, 1])
        body = polygon_distance(np.stack([radius, p[:, 2]], axis=1), profile)
        slots = np.minimum(np.abs(p[:, 0]), np.abs(p[:, 1])) - 0.15
        return np.maximum(body, -np.maximum(slots, 0.82 - p[:, 2]))

    return distance


def extruded(corners, height):
    """A prism over a polygon: its distance and its creases."""

    def distance(p):
        return np.maximum(polygon_distance(p[:, :2], corners), np.abs(p[:, 2]) - height)

    outline = np.concatenate(
        [between(np.stack(ends)) for ends in zip(corners, np.roll(corners, -1, 0), strict=True)]
    )
    upright = between(np.array([[-height, 0.0], [height, 0.0]]))[:, :1]
    walls = [np.hstack([np.tile(c, (len(upright), 1)), upright]) for c in corners]
    return distance, np.concatenate([raised(outline, height), *walls])


def raised(outline, height):
    """An outline (k, 2) at both ends of a prism."""
    return np.concatenate([np.insert(outline, 2, z, axis=1) for z in (-height, height)])


def between(ends):
    """Points from one place to another."""
    count = max(int(np.linalg.norm(ends[1] - ends[0]) / STEP), 1)
    return ends[0] + np.linspace(0.0, 1.0, count + 1)[:, None] * (ends[1] - ends[0])


def polygon_distance(points, corners):
    """Signed distance (n,) of points in the plane to a polygon, negative inside."""
    nearest = np.full(len(points), np.inf)
    inside = np.zeros(len(points), dtype=bool)
    x, y = points.T
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        e, w = b - a, points - a
        share = np.clip((w @ e) / (e @ e), 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(w - share[:, None] * e, axis=1))
        if a[1] != b[1]:
            crossed = (a[1] <= y) != (b[1] <= y)
            inside ^= crossed & (x < a[0] + (y - a[1]) * e[0] / e[1])
    return np.where(inside, -nearest, nearest)
