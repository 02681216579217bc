# SPDX-License-Identifier: GPL-3.0-or-later
"""Searches for points near places in space.

They use a balanced k-d tree (Friedman, Bentley and Finkel 1977), not a grid of cells, because the
points of a surface may be concentrated in a few spots, each in a single cell. The tree needs no
pointers: node j of a level has the points from ``n j / 2**level`` to ``n (j + 1) / 2**level``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from .triangle_mesh import Floats, Ints

_LEAF = 8
"""Approximate number of points in a leaf."""

_CHUNK = 1 << 12
"""Places per chunk of a thread."""

_PATIENCE = 8
"""Pivots are chosen at random after this many comparisons per point in one selection."""

_DEEPEST = 64
"""Size of the stack of nodes in a search: one for each level."""


class PointTree(NamedTuple):
    """Points in space, ordered for searches; see `point_tree`.

    Attributes
    ----------
    points : (n, 3) float64
    numbers : (n,) int32
        Index of each point in the input.
    boxes : (nodes, 2, 3) float64
        Lowest and highest coordinates of each node, level by level from the root.
    lowest : (nodes,) int32
        The lowest number of each node.
    depth : int
        Level of the leaves.
    """

    points: Floats
    numbers: Ints
    boxes: Floats
    lowest: Ints
    depth: int


def point_tree(points: Floats) -> PointTree:
    """Build a tree of points, (n, 3), for searches.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter.core.mesh.nearest import nearest_point, point_tree
    >>> tree = point_tree(np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    >>> distances, numbers = nearest_point(tree, np.array([[1.0, 0.0, 0.0], [9.0, 0.0, 0.0]]), 2.0)
    >>> distances.tolist(), numbers.tolist()
    ([1.0, inf], [0, -1])
    """
    depth = max(len(points) // _LEAF, 1).bit_length() - 1
    nodes = (2 << depth) - 1
    tree = PointTree(
        np.array(points, dtype=np.float64, order="C"),
        np.arange(len(points), dtype=np.int32),
        np.empty((nodes, 2, 3)),
        np.empty(nodes, dtype=np.int32),
        depth,
    )
    for level in range(depth + 1):
        # A node costs as much as it has points.
        run(_split, 1 << level, level, tree, chunk=max((1 << level) // 16, 1))
    return tree


def nearest_point(tree: PointTree, places: Floats, within: float = np.inf) -> tuple[Floats, Ints]:
    """Find the nearest point of each place.

    Parameters
    ----------
    tree : PointTree
    places : (k, 3) float64
    within : float
        The largest distance.

    Returns
    -------
    distances : (k,) float64
        Infinite where no point lies within reach.
    numbers : (k,) int32
        The number of the point, of several at the same distance the lowest; -1 if there is none.
    """
    places = np.ascontiguousarray(places, dtype=np.float64)
    distances, numbers = np.empty(len(places)), np.empty(len(places), dtype=np.int32)
    run(_find_nearest, len(places), tree, places, float(within) ** 2, distances, numbers,
        chunk=_CHUNK)  # fmt: skip
    return distances, numbers


def points_within(
    tree: PointTree, places: Floats, distance: float
) -> tuple[npt.NDArray[np.int64], Ints]:
    """List all points around each place.

    Parameters
    ----------
    tree : PointTree
    places : (k, 3) float64
    distance : float
        The largest one.

    Returns
    -------
    start : (k + 1,) int64
    numbers : (total,) int32
        Those of place i are ``numbers[start[i]:start[i + 1]]``, in no particular order.
    """
    places = np.ascontiguousarray(places, dtype=np.float64)
    start = np.zeros(len(places) + 1, dtype=np.int64)
    numbers = np.empty(0, dtype=np.int32)
    square = float(distance) ** 2
    run(_list_near, len(places), tree, places, square, True, start, numbers, chunk=_CHUNK)
    np.cumsum(start, out=start)
    numbers = np.empty(start[-1], dtype=np.int32)
    run(_list_near, len(places), tree, places, square, False, start, numbers, chunk=_CHUNK)
    return start, numbers


@kernel
def _range(tree, level, node):
    # The points of a node of a level.
    count = len(tree.points)
    return (count * node) >> level, (count * (node + 1)) >> level


@kernel
def _split(start, stop, level, tree):
    # Measures nodes, and sorts the points of each along its longest side into two halves.
    first = (1 << level) - 1
    for node in range(start, stop):
        low, high = _range(tree, level, node)
        box = tree.boxes[first + node]
        lowest = len(tree.points)
        box[0], box[1] = np.inf, -np.inf
        for i in range(low, high):
            lowest = min(lowest, tree.numbers[i])
            for x in range(3):
                box[0, x] = min(box[0, x], tree.points[i, x])
                box[1, x] = max(box[1, x], tree.points[i, x])
        tree.lowest[first + node] = lowest
        if level < tree.depth:
            axis = 0
            for x in range(1, 3):
                if box[1, x] - box[0, x] > box[1, axis] - box[0, axis]:
                    axis = x
            middle, _ = _range(tree, level + 1, 2 * node + 1)
            _part(tree.points, tree.numbers, axis, low, high - 1, middle)


@kernel
def _part(points, numbers, axis, low, high, middle):
    # Hoare's selection: no coordinate before `middle` is greater, and none after it is less. After
    # many bad pivots from the ends and the middle, they are chosen pseudo-randomly: otherwise the
    # time would grow with the square of the number of points for some orders.
    most = _PATIENCE * (high - low + 1)
    scatter = 0
    while low < high:
        one, two, three = low, (low + high) >> 1, high
        most -= high - low
        if most < 0:
            one, scatter = _scattered(low, high, scatter)
            two, scatter = _scattered(low, high, scatter)
            three, scatter = _scattered(low, high, scatter)
        a, b, c = points[one, axis], points[two, axis], points[three, axis]
        pivot = max(min(a, b), min(max(a, b), c))
        i, j = low, high
        while i <= j:
            while points[i, axis] < pivot:
                i += 1
            while points[j, axis] > pivot:
                j -= 1
            if i <= j:
                for x in range(3):
                    points[i, x], points[j, x] = points[j, x], points[i, x]
                numbers[i], numbers[j] = numbers[j], numbers[i]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            break


@kernel
def _scattered(low, high, state):
    # A place from `low` to `high`, and the next state; Weyl's sequence of the golden ratio.
    state = (state + 0x9E3779B9) & 0xFFFFFFFF
    return low + ((state * (high - low + 1)) >> 32), state


@kernel
def _square_to(box, places, i):
    # Squared distance to a box. Each step rounds monotonically: it exceeds that to no point inside.
    total = 0.0
    for x in range(3):
        away = max(box[0, x] - places[i, x], places[i, x] - box[1, x], 0.0)
        total += away * away
    return total


@kernel
def _square_between(points, k, places, i):
    total = 0.0
    for x in range(3):
        away = points[k, x] - places[i, x]
        total += away * away
    return total


@kernel
def _find_nearest(start, stop, tree, places, most, distances, numbers):
    levels, nodes = np.empty(_DEEPEST, np.int64), np.empty(_DEEPEST, np.int64)
    squares = np.empty(_DEEPEST)
    for i in range(start, stop):
        best, found = most, len(tree.points)
        levels[0] = nodes[0] = 0
        squares[0] = _square_to(tree.boxes[0], places, i)
        waiting = 1
        while waiting > 0:
            waiting -= 1
            level, node, square = levels[waiting], nodes[waiting], squares[waiting]
            first = (1 << level) - 1
            if square > best or (square == best and tree.lowest[first + node] >= found):
                continue
            if level == tree.depth:
                low, high = _range(tree, level, node)
                for k in range(low, high):
                    square = _square_between(tree.points, k, places, i)
                    number = tree.numbers[k]
                    if square < best or (square == best and number < found):
                        best, found = square, number
                continue
            one, other = 2 * node, 2 * node + 1
            first = (2 << level) - 1
            near = _square_to(tree.boxes[first + one], places, i)
            far = _square_to(tree.boxes[first + other], places, i)
            is_lower = tree.lowest[first + other] < tree.lowest[first + one]
            if far < near or (far == near and is_lower):
                one, other = other, one
                near, far = far, near
            levels[waiting] = levels[waiting + 1] = level + 1
            nodes[waiting], squares[waiting] = other, far
            nodes[waiting + 1], squares[waiting + 1] = one, near
            waiting += 2
        is_found = found < len(tree.points)
        distances[i] = np.sqrt(best) if is_found else np.inf
        numbers[i] = found if is_found else -1


@kernel
def _list_near(start, stop, tree, places, most, only_count, starts, numbers):
    levels, nodes = np.empty(_DEEPEST, np.int64), np.empty(_DEEPEST, np.int64)
    for i in range(start, stop):
        count = 0
        levels[0] = nodes[0] = 0
        waiting = 1
        while waiting > 0:
            waiting -= 1
            level, node = levels[waiting], nodes[waiting]
            if _square_to(tree.boxes[(1 << level) - 1 + node], places, i) > most:
                continue
            if level < tree.depth:
                levels[waiting] = levels[waiting + 1] = level + 1
                nodes[waiting], nodes[waiting + 1] = 2 * node + 1, 2 * node
                waiting += 2
                continue
            low, high = _range(tree, level, node)
            for k in range(low, high):
                if _square_between(tree.points, k, places, i) <= most:
                    if not only_count:
                        numbers[starts[i] + count] = tree.numbers[k]
                    count += 1
        if only_count:
            starts[i + 1] = count
