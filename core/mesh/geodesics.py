# SPDX-License-Identifier: GPL-3.0-or-later
"""Geodesic distances on triangle meshes by fast marching.

References
----------
R. Kimmel, J. Sethian: Computing Geodesic Paths on Manifolds, 1998: fast marching, with obtuse
corners split by unfolding the faces opposite to them. M. Novotni, R. Klein: Computing Geodesic
Distances on Triangular Meshes, 2002: circular fronts.

The mesh may be embedded in any number of dimensions: only edge lengths are used.
"""

from __future__ import annotations

import logging
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run, run_in_order
from ..base.vectors import after
from .triangle_mesh import Floats, Ints, TriangleMesh

log = logging.getLogger(__name__)

UNFOLDED = 30
"""Most faces that are unfolded to split one obtuse corner."""

ALL = np.iinfo(np.int64).max
"""As `most`: a march reaches any number of vertices."""

_TIMES = 4
"""How often a `search` over all faces may visit a face, on average."""

_ACUTE, _AT_BORDER, _GIVEN_UP = -1, -2, -3  # why a corner is not split


class Stencils(NamedTuple):
    """The triangles that distances are updated through, listed by the vertices they start from.

    Row v, ``start[v]:start[v + 1]``, holds a triangle (v, other, target) for each pair in which
    v and `other` can update the distance of `target`.
    """

    start: npt.NDArray[np.int64]
    targets: Ints
    others: Ints
    shapes: npt.NDArray[np.float32]  # length of v-other; the target's place along and beside it


class Steps(NamedTuple):
    """The faces across the edges of each face, and the distances to them: infinite at borders."""

    targets: npt.NDArray[np.uint32]
    lengths: npt.NDArray[np.float32]


class Front(NamedTuple):
    """Working memory and result of `march`.

    The vertices reached are ``reached[:count]``, nearest first, with their squared distances in
    `squares`. All other fields are working memory.
    """

    reached: Ints
    squares: Floats
    stamps: Ints
    heap: Ints
    slots: Ints  # the place of each vertex in the heap


def stencils(mesh: TriangleMesh, embedding: Floats) -> Stencils:
    """Prepare marching on a mesh whose vertices are embedded at `embedding` (n, any number).

    Each corner is updated from its opposite edge. The front may reach an obtuse corner before both
    ends of that edge: the faces across it are unfolded into the corner's plane until a vertex
    splits the angle into two acute ones, and the two virtual triangles are used as well.
    """
    count, faces = mesh.face_count, mesh.faces
    splits = np.empty(3 * count, dtype=np.int32)
    places = np.empty((3 * count, 2), dtype=np.float32)
    run(_split_corners, count, faces, mesh.twins, embedding, splits, places)
    given_up = np.count_nonzero(splits == _GIVEN_UP)
    if given_up:
        log.info("%d obtuse corners are not split: no vertex lies opposite within %d faces.",
                 given_up, UNFOLDED)  # fmt: skip
    start = np.zeros(mesh.vertex_count + 1, dtype=np.int64)
    run_in_order(_count_stencils, count, faces, splits, start)
    graph = _empty_stencils(start)
    run_in_order(_fill_stencils, count, faces, embedding, splits, places, start[:-1].copy(), graph)
    return graph


def face_steps(mesh: TriangleMesh, centres: Floats, guide: Floats, beta: float) -> Steps:
    """Prepare `search` on the faces, their centres at (X, beta guide): (m, 3) each."""
    targets = np.empty((mesh.face_count, 3), dtype=np.uint32)
    lengths = np.empty((mesh.face_count, 3), dtype=np.float32)
    run(_measure_steps, mesh.face_count, mesh.twins, centres, guide, beta, targets, lengths)
    return Steps(targets, lengths)


def _empty_stencils(start: npt.NDArray[np.int64]) -> Stencils:
    # `start` holds the number of triangles in each row, one place further.
    np.cumsum(start, out=start)
    count = start[-1]
    shapes = np.zeros((count, 3), dtype=np.float32)
    return Stencils(start, np.empty(count, np.int32), np.empty(count, np.int32), shapes)


@kernel
def new_front(count):
    """Make a `Front` for `count` vertices; pages of memory that are never touched cost nothing."""
    reached = np.empty(count, np.int32)
    squares = np.empty(count, np.float64)
    stamps = np.zeros(count, np.int32)
    return Front(reached, squares, stamps, np.empty(count, np.int32), np.empty(count, np.int32))


@kernel
def march(source, stamp, limit, most, graph, front):
    """March from `source` up to the distance `limit`; return the number of vertices reached.

    Parameters
    ----------
    source : int
    stamp : int
        A different number above 0 for each march with the same front, so that nothing has to be
        cleared.
    limit : float
    most : int
        How many vertices to reach, the nearest ones; at a vertex with more triangles than this,
        some are left out evenly. `ALL` sets no limit.
    graph : Stencils
    front : Front
        Receives the vertices and their distances.
    """
    start, targets, others, shapes = graph  # once: each access to a field counts references
    reached, squares, stamps, heap, slots = front
    # A vertex is far while its stamp is below `close`, then close (in the heap), then accepted.
    close, accepted = 2 * stamp, 2 * stamp + 1
    count, size = 0, 0
    farthest = limit * limit
    squares[source] = 0.0
    stamps[source] = close
    size = _push(source, size, heap, slots, squares)
    while size > 0 and count < most:
        v = heap[0]
        size = _pop(size, heap, slots, squares)
        stamps[v] = accepted
        reached[count] = v
        count += 1
        square = squares[v]
        row = start[v + 1] - start[v]
        stride = 1 if row <= most else 1 + row // most
        for i in range(start[v], start[v + 1], stride):
            target, other = targets[i], others[i]
            if stamps[target] == accepted:
                continue
            along, beside = float(shapes[i, 1]), float(shapes[i, 2])
            found = np.inf
            if stamps[other] == accepted:
                length = float(shapes[i, 0])
                found = _across(square, squares[other], length, along, beside)
            if found == np.inf:
                found = (np.sqrt(square) + np.sqrt(along * along + beside * beside)) ** 2
            if not found <= farthest:  # also NaN, where lengths overflow
                continue
            if stamps[target] != close:
                stamps[target] = close
                squares[target] = found
                size = _push(target, size, heap, slots, squares)
            elif found < squares[target]:
                squares[target] = found
                _rise(slots[target], heap, slots, squares)
    return count


@kernel
def new_search(count):
    """Make `reached` and `left` of `search` for `count` faces; untouched pages cost nothing."""
    return np.empty(_TIMES * count, np.uint32), np.zeros(count, np.float32)


@kernel
def search(source, limit, most, targets, lengths, reached, left):
    """Find the faces nearer than `limit` to a face; return how many places of `reached` they take.

    Distances run from centre to centre. Faces are listed in the order of visits, and again when a
    shorter path is found later: near a face that is rare, and costs less than keeping them sorted.

    Parameters
    ----------
    source : int
    limit : float
    most : int
        Most visits, repeated ones included.
    targets, lengths : (m, 3) uint32, (m, 3) float32
        See `Steps`.
    reached : (k,) uint32
        Receives the faces, some repeatedly.
    left : (m,) float32
        Receives how much nearer each face is than the limit. Must be 0 everywhere before.
    """
    most = min(most, reached.shape[0])
    left[source] = limit
    reached[0] = source
    count, seen = 1, 0
    while seen < count:
        f = reached[seen]
        seen += 1
        here = left[f]
        for k in range(3):
            g = targets[f, k]
            there = here - lengths[f, k]
            if there > left[g] and count < most:  # false for NaN, where lengths overflow
                left[g] = there
                reached[count] = g
                count += 1
    return count


@kernel
def _across(from_v, from_other, length, along, beside):
    # All in squares. The distance of the target through the edge from a virtual source behind the
    # edge, at the given distances from both ends: exact on surfaces that unfold to a plane, where
    # the planar front of Kimmel and Sethian is up to a fifth too far near the source (Novotni and
    # Klein 2002). Infinite if the straight line misses the edge.
    if beside <= 0.0:
        return np.inf
    x = 0.5 * (from_v - from_other + length * length) / length
    y = np.sqrt(max(from_v - x * x, 0.0))
    crossing = x * beside + along * y
    if crossing < 0.0 or crossing > length * (y + beside):
        return np.inf
    return (along - x) * (along - x) + (beside + y) * (beside + y)


@kernel
def _push(v, size, heap, slots, squares):
    heap[size] = v
    slots[v] = size
    _rise(size, heap, slots, squares)
    return size + 1


@kernel
def _rise(slot, heap, slots, squares):
    v = heap[slot]
    key = squares[v]
    while slot > 0:
        parent = (slot - 1) >> 1
        if squares[heap[parent]] <= key:
            break
        heap[slot] = heap[parent]
        slots[heap[slot]] = slot
        slot = parent
    heap[slot] = v
    slots[v] = slot


@kernel
def _pop(size, heap, slots, squares):
    size -= 1
    v = heap[size]
    key = squares[v]
    slot = 0
    while True:
        child = 2 * slot + 1
        if child >= size:
            break
        if child + 1 < size and squares[heap[child + 1]] < squares[heap[child]]:
            child += 1
        if squares[heap[child]] >= key:
            break
        heap[slot] = heap[child]
        slots[heap[slot]] = slot
        slot = child
    heap[slot] = v
    slots[v] = slot
    return size


@kernel
def squared_distance(points, a, b):
    """Compute the squared Euclidean distance of two of the points (n, any number)."""
    total = 0.0
    for j in range(points.shape[1]):
        step = points[a, j] - points[b, j]
        total += step * step
    return total


@kernel
def _apex(ax, ay, bx, by, square_ac, square_bc):
    # The position of c, right of the line from a to b, given its squared distances.
    ux, uy = bx - ax, by - ay
    square = ux * ux + uy * uy
    if square <= 0.0:
        return ax, ay
    along = 0.5 * (square_ac - square_bc + square) / square
    beside = np.sqrt(max(square_ac / square - along * along, 0.0))
    return ax + along * ux + beside * uy, ay + along * uy - beside * ux


@kernel
def _measure_steps(start, stop, twins, centres, guide, beta, targets, lengths):
    for f in range(start, stop):
        for k in range(3):
            targets[f, k] = 0
            lengths[f, k] = np.inf
            if twins[f, k] >= 0:
                g = twins[f, k] // 3
                space = signal = 0.0
                for x in range(3):
                    space += (centres[f, x] - centres[g, x]) ** 2
                    signal += (guide[f, x] - guide[g, x]) ** 2
                targets[f, k] = g
                lengths[f, k] = np.sqrt(space + beta * beta * signal)


@kernel
def _split_corners(start, stop, faces, twins, embedding, splits, places):
    # Per corner: the vertex that splits it and its place in the corner's own frame (see below),
    # or why it is not split.
    for f in range(start, stop):
        for k in range(3):
            c, a, b = faces[f, k], faces[f, after(k)], faces[f, after(after(k))]
            corner = 3 * f + k
            splits[corner] = _ACUTE
            square_a = squared_distance(embedding, c, a)
            square_b = squared_distance(embedding, c, b)
            if square_a + square_b >= squared_distance(embedding, a, b) * (1 - 1e-9):
                continue
            splits[corner] = _AT_BORDER
            # The corner at the origin, a on the x axis, b above it; unfold across a-b.
            ax, ay = np.sqrt(square_a), 0.0
            bx, by = _apex(ax, ay, 0.0, 0.0, squared_distance(embedding, a, b), square_b)
            if ax == 0.0:
                continue
            fx, fy, gx, gy = ax, ay, bx, by
            edge = twins[f, after(k)]
            for _ in range(UNFOLDED):
                if edge < 0:
                    break
                g = edge // 3
                m = edge - 3 * g
                # The half-edge runs from the end near b to the one near a.
                d = faces[g, after(after(m))]
                near_b, near_a = faces[g, m], faces[g, after(m)]
                dx, dy = _apex(fx, fy, gx, gy, squared_distance(embedding, near_a, d),
                                squared_distance(embedding, near_b, d))  # fmt: skip
                beyond_a = dx * ax + dy * ay < 0.0  # more than 90 degrees from a
                beyond_b = dx * bx + dy * by < 0.0
                if not beyond_a and not beyond_b:
                    splits[corner] = d
                    places[corner, 0] = dx
                    places[corner, 1] = dy
                    break
                if beyond_a:
                    gx, gy = dx, dy
                    edge = twins[g, after(m)]
                else:
                    fx, fy = dx, dy
                    edge = twins[g, after(after(m))]
            else:
                splits[corner] = _GIVEN_UP


@kernel
def _count_stencils(start, stop, faces, splits, row_start):
    for f in range(start, stop):
        for k in range(3):
            a, b = faces[f, after(k)], faces[f, after(after(k))]
            d = splits[3 * f + k]
            row_start[a + 1] += 1 if d < 0 else 2
            row_start[b + 1] += 1 if d < 0 else 2
            if d >= 0:
                row_start[d + 1] += 2


@kernel
def _fill_stencils(start, stop, faces, embedding, splits, places, cursors, graph):
    _, targets, others, shapes = graph
    for f in range(start, stop):
        for k in range(3):
            c, a, b = faces[f, k], faces[f, after(k)], faces[f, after(after(k))]
            d = splits[3 * f + k]
            square_a = squared_distance(embedding, c, a)
            square_b = squared_distance(embedding, c, b)
            square_ab = squared_distance(embedding, a, b)
            _put(a, b, c, square_ab, square_a, square_b, cursors, targets, others, shapes)
            if d < 0:
                continue
            x, y = float(places[3 * f + k, 0]), float(places[3 * f + k, 1])
            ax = np.sqrt(square_a)
            bx, by = _apex(ax, 0.0, 0.0, 0.0, square_ab, square_b)
            square_d = x * x + y * y
            square_ad = (x - ax) ** 2 + y * y
            square_bd = (x - bx) ** 2 + (y - by) ** 2
            _put(a, d, c, square_ad, square_a, square_d, cursors, targets, others, shapes)
            _put(d, b, c, square_bd, square_d, square_b, cursors, targets, others, shapes)


@kernel
def _put(a, b, c, square_ab, square_ac, square_bc, cursors, targets, others, shapes):
    length = np.sqrt(square_ab)
    along, beside = np.sqrt(square_ac), 0.0
    if length > 0.0:
        along = 0.5 * (square_ac - square_bc + square_ab) / length
        beside = np.sqrt(max(square_ac - along * along, 0.0))
    for direction in range(2):
        i = cursors[a]
        cursors[a] += 1
        targets[i] = c
        others[i] = b
        shapes[i, 0] = length
        shapes[i, 1] = along
        shapes[i, 2] = beside
        if direction == 0:
            a, b = b, a
            along = length - along
