# SPDX-License-Identifier: GPL-3.0-or-later
"""Polygons cut into triangles."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...document import Bools, Floats, Ints

_FLAT = 1e-12  # of a polygon's squared area: below it, a triangle is a line


def fans(sizes: Ints) -> tuple[Ints, Ints]:
    """Cut polygons into fans: corner numbers (t, 3), and the polygon of each triangle."""
    counts = np.maximum(sizes - 2, 0)
    owner = np.repeat(np.arange(len(sizes)), counts)
    step = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    first = (np.cumsum(sizes) - sizes)[owner]
    return np.column_stack([first, first + step + 1, first + step + 2]), owner


def without_flips(points: Floats, triangles: Ints, owner: Ints) -> Ints:
    """Cut concave polygons anew, whose fans hold triangles that face backwards.

    Parameters
    ----------
    points : (n, 3) float
    triangles : (t, 3) int
        Indices of points; the triangles of a polygon, in their order, are a fan.
    owner : (t,) int
        The polygon of each triangle.

    Returns
    -------
    (t, 3) int
        Convex polygons, and those that cross themselves, keep their fans.
    """
    if len(owner) == len(np.unique(owner)):
        return triangles
    if triangles.min() < 0 or triangles.max() >= len(points):
        return triangles  # refused by whoever reads them
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    with np.errstate(over="ignore", invalid="ignore"):
        crosses = np.cross(b - a, c - a)
        normals = np.column_stack([np.bincount(owner, axis) for axis in crosses.T])
        along = np.einsum("ij,ij->i", crosses, normals[owner])
        flipped = along < -_FLAT * np.einsum("ij,ij->i", normals, normals)[owner]
    result = triangles
    order = np.argsort(owner, kind="stable")
    polygons = np.unique(owner[flipped])
    starts = np.searchsorted(owner[order], polygons)
    stops = np.searchsorted(owner[order], polygons, side="right")
    for polygon, start, stop in zip(polygons, starts, stops, strict=True):
        rows = order[start:stop]
        outline = np.concatenate([triangles[rows[0], :2], triangles[rows, 2]])
        cut = _ears(_flattened(points[outline], normals[polygon]))
        if cut is not None:
            result = triangles.copy() if result is triangles else result
            result[rows] = outline[cut]
    return result


def _flattened(points: Floats, normal: Floats) -> Floats:
    """Points as seen against a normal: (n, 2), counterclockwise."""
    normal = normal / np.linalg.norm(normal)
    first = np.cross(normal, np.eye(3)[abs(normal).argmin()])
    first /= np.linalg.norm(first)
    return (points - points[0]) @ np.column_stack([first, np.cross(normal, first)])


def _ears(outline: Floats) -> Ints | None:
    """Cut a counterclockwise polygon into triangles; None if no cut fits."""
    left = list(range(len(outline)))
    result = []
    place = tried = 0
    while len(left) > 3:
        place %= len(left)
        ear = [left[place - 1], left[place], left[(place + 1) % len(left)]]
        if _is_ear(outline[ear], outline[left]):
            result.append(ear)
            del left[place]
            tried = 0
        else:
            place, tried = place + 1, tried + 1
            if tried > len(left):
                return None
    return np.array([*result, left]) if _turn(*outline[left]) >= 0.0 else None


def _is_ear(ear: Floats, others: Floats) -> bool:
    """Whether a corner points outwards, and no other point is in its triangle."""
    after = np.roll(ear, -1, axis=0)
    if _turn(ear[0], ear[1], ear[2]) <= 0.0:
        return False
    inside: Bools = np.ones(len(others), dtype=np.bool_)
    for start, stop in zip(ear, after, strict=True):
        inside &= (_turn(start, stop, others) >= 0.0) & (others != start).any(axis=1)
    return not inside.any()


def _turn(start: Floats, stop: Floats, points: Floats) -> npt.NDArray[np.float64]:
    # Twice the area of the triangles that a side forms with points.
    along, to = stop - start, points - start
    return along[..., 0] * to[..., 1] - along[..., 1] * to[..., 0]
