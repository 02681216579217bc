# SPDX-License-Identifier: GPL-3.0-or-later
"""A bounding volume hierarchy of triangles, and the search for the first triangle along a ray."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel
from ..base.progress import ask

_LEAF = 4
"""Most triangles of a leaf; up to twice as many where splitting is no gain."""

_BINS = 16
_CODED = 16
_DEPTH = 64
"""Most levels; below it, halves are cut by count."""

STACK = 3 * _DEPTH
"""Size of the stack that a search needs."""

_EDGE = np.float32(1e-6)
"""Tolerance in barycentric coordinates by which rays beside a triangle hit it, so that none passes
between two."""

_Single = npt.NDArray[np.float32]


class Boxes(NamedTuple):
    """A binary tree of boxes.

    Attributes
    ----------
    boxes : (k, 12) float32
        For each node, the lowest and the highest corner of both parts.
    parts : (k, 2) int32
        The node of each part; for a leaf -1 - (16 first + count), triangles in `triangles`.
    triangles : (m, 9) float32
        The first corner, and the edges to the second and the third, in the order of the leaves.
    order : (m,) int32
        The index of each of these triangles in the input.
    """

    boxes: _Single
    parts: npt.NDArray[np.int32]
    triangles: _Single
    order: npt.NDArray[np.int32]


def boxes_around(corners: npt.NDArray[np.float64]) -> Boxes:
    """Make the tree of triangles (m, 3, 3), by the surface-area heuristic with 16 bins."""
    single = corners.astype(np.float32)
    lows = np.ascontiguousarray(single.min(axis=1))
    highs = np.ascontiguousarray(single.max(axis=1))
    ask()
    count = len(single)
    boxes, parts = np.zeros((max(count, 1), 12), np.float32), np.zeros((max(count, 1), 2), np.int32)
    order = np.arange(count, dtype=np.int32)
    used = _build(lows, highs, order, boxes, parts)
    ask()
    sides = single[order]
    sides[:, 1:] -= sides[:, :1]
    return Boxes(boxes[:used].copy(), parts[:used].copy(), sides.reshape(-1, 9).copy(), order)


@kernel
def _build(lows, highs, order, boxes, parts):
    # Nodes in the order in which they are made; returns their number.
    count = order.shape[0]
    middles = lows + highs  # twice the middles
    stack = np.empty((2 * _DEPTH + 64, 4), np.int64)  # first, last, node * 2 + side, depth
    costs = np.empty(_BINS)
    counts = np.empty((3, _BINS), np.int64)
    low_of = np.empty((3, _BINS, 3))
    high_of = np.empty((3, _BINS, 3))
    box = np.empty((2, 3))
    swept = np.empty((2, 3))
    used, top = 1, 0
    # The root has all triangles in one part, and nothing in the other.
    for side in range(2):
        for x in range(3):
            boxes[0, 6 * side + x], boxes[0, 6 * side + 3 + x] = np.inf, -np.inf
    parts[0, 1] = -1
    stack[top, 0], stack[top, 1], stack[top, 2], stack[top, 3] = 0, count, 0, 0
    top += 1
    while top > 0:
        top -= 1
        first, last, place, depth = stack[top, 0], stack[top, 1], stack[top, 2], stack[top, 3]
        node, side = place // 2, place % 2
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        box[0] = np.inf
        box[1] = -np.inf
        for i in range(first, last):
            t = order[i]
            for x in range(3):
                low[x], high[x] = min(low[x], middles[t, x]), max(high[x], middles[t, x])
                box[0, x], box[1, x] = min(box[0, x], lows[t, x]), max(box[1, x], highs[t, x])
        for x in range(3):
            boxes[node, 6 * side + x] = box[0, x]
            boxes[node, 6 * side + 3 + x] = box[1, x]
        number = last - first
        cut_axis, cut_bin, cheapest = -1, 0, np.inf
        if number > _LEAF and depth < _DEPTH:
            counts[:] = 0
            low_of[:] = np.inf
            high_of[:] = -np.inf
            for i in range(first, last):
                t = order[i]
                for axis in range(3):
                    extent = high[axis] - low[axis]
                    if extent > 0:
                        b = min(int((middles[t, axis] - low[axis]) / extent * _BINS), _BINS - 1)
                        counts[axis, b] += 1
                        for x in range(3):
                            low_of[axis, b, x] = min(low_of[axis, b, x], lows[t, x])
                            high_of[axis, b, x] = max(high_of[axis, b, x], highs[t, x])
            for axis in range(3):
                if not high[axis] > low[axis]:
                    continue
                swept[0] = np.inf
                swept[1] = -np.inf
                seen = 0
                for b in range(_BINS - 1):
                    seen += counts[axis, b]
                    _widen(swept, low_of[axis, b], high_of[axis, b])
                    costs[b] = seen * _area(swept) if seen else np.inf
                swept[0] = np.inf
                swept[1] = -np.inf
                seen = 0
                for b in range(_BINS - 1, 0, -1):
                    seen += counts[axis, b]
                    _widen(swept, low_of[axis, b], high_of[axis, b])
                    cost = costs[b - 1] + seen * _area(swept) if seen else np.inf
                    if cost < cheapest:
                        cheapest, cut_axis, cut_bin = cost, axis, b
        pays = cut_axis >= 0 and (number > 2 * _LEAF or cheapest < number * _area(box))
        if not pays and number <= 2 * _LEAF:
            parts[node, side] = -1 - (first * _CODED + number)
            continue
        middle = first + number // 2
        if cut_axis >= 0:
            extent = high[cut_axis] - low[cut_axis]
            i, j = first, last - 1
            while i <= j:
                t = order[i]
                b = min(int((middles[t, cut_axis] - low[cut_axis]) / extent * _BINS), _BINS - 1)
                if b < cut_bin:
                    i += 1
                else:
                    order[i], order[j] = order[j], order[i]
                    j -= 1
            if first < i < last:
                middle = i
        child = used
        used += 1
        parts[node, side] = child
        stack[top, 0], stack[top, 1], stack[top, 2] = first, middle, 2 * child
        stack[top, 3] = depth + 1
        stack[top + 1, 0], stack[top + 1, 1], stack[top + 1, 2] = middle, last, 2 * child + 1
        stack[top + 1, 3] = depth + 1
        top += 2
    return used


@kernel
def _widen(box, low, high):
    for x in range(3):
        box[0, x], box[1, x] = min(box[0, x], low[x]), max(box[1, x], high[x])


@kernel
def _area(box):
    x, y, z = box[1, 0] - box[0, 0], box[1, 1] - box[0, 1], box[1, 2] - box[0, 2]
    return x * y + y * z + z * x


@kernel
def first_hit(tree, ox, oy, oz, dx, dy, dz, limit, any_hit, stack):
    """Find a triangle along a ray: how far it is, and its row in `Boxes.triangles`.

    `limit` and -1 if there is none before the limit.

    Parameters
    ----------
    tree : Boxes
    ox, oy, oz, dx, dy, dz : float32
        Origin and direction.
    limit : float32
        In lengths of the direction.
    any_hit : bool
        Whether to return any triangle along the ray, not necessarily the first.
    stack : (STACK,) int32
        Overwritten.
    """
    boxes, parts, triangles = tree.boxes, tree.parts, tree.triangles
    zero, one, tiny = np.float32(0), np.float32(1), np.float32(1e-20)
    ix = one / (dx if abs(dx) > tiny else tiny)
    iy = one / (dy if abs(dy) > tiny else tiny)
    iz = one / (dz if abs(dz) > tiny else tiny)
    nearest, found = limit, -1
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        item = stack[top]
        if item < 0:
            code = -1 - item
            first = code // _CODED
            for i in range(first, first + code % _CODED):
                ax, ay, az = triangles[i, 3], triangles[i, 4], triangles[i, 5]
                bx, by, bz = triangles[i, 6], triangles[i, 7], triangles[i, 8]
                px, py, pz = dy * bz - dz * by, dz * bx - dx * bz, dx * by - dy * bx
                det = ax * px + ay * py + az * pz
                if det == zero:
                    continue
                inverse = one / det
                tx, ty, tz = ox - triangles[i, 0], oy - triangles[i, 1], oz - triangles[i, 2]
                u = (tx * px + ty * py + tz * pz) * inverse
                if u < -_EDGE or u > one + _EDGE:
                    continue
                qx, qy, qz = ty * az - tz * ay, tz * ax - tx * az, tx * ay - ty * ax
                v = (dx * qx + dy * qy + dz * qz) * inverse
                if v < -_EDGE or u + v > one + _EDGE:
                    continue
                t = (bx * qx + by * qy + bz * qz) * inverse
                if zero < t < nearest:
                    nearest, found = t, i
                    if any_hit:
                        return nearest, found
            continue
        near = np.float32(np.inf)
        for side in range(2):
            k = 6 * side
            part = parts[item, side]
            if part == -1:
                continue
            x0, x1 = (boxes[item, k] - ox) * ix, (boxes[item, k + 3] - ox) * ix
            y0, y1 = (boxes[item, k + 1] - oy) * iy, (boxes[item, k + 4] - oy) * iy
            z0, z1 = (boxes[item, k + 2] - oz) * iz, (boxes[item, k + 5] - oz) * iz
            enters = max(max(min(x0, x1), min(y0, y1)), max(min(z0, z1), zero))
            leaves = min(min(max(x0, x1), max(y0, y1)), max(z0, z1)) * np.float32(1.000001)
            if enters <= leaves and enters < nearest:
                if side == 1 and top > 0 and near < enters:
                    # The nearer part is searched first.
                    stack[top] = stack[top - 1]
                    stack[top - 1] = part
                else:
                    stack[top] = part
                near = enters
                top += 1
    return nearest, found
