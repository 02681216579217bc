# SPDX-License-Identifier: GPL-3.0-or-later
"""Local geodesic distances on triangle meshes by fast marching.

After Kimmel and Sethian (Computing geodesic paths on manifolds, 1998), with obtuse corners split
by unfolding the faces that lie across. The mesh may be embedded in any number of dimensions:
only lengths of edges are read.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run, run_in_order
from .triangle_mesh import Floats, Ints, TriangleMesh

UNFOLDED = 30
"""Most faces that are unfolded to split one obtuse corner."""


class Stencils(NamedTuple):
    """The triangles through which distances travel, seen from the vertices that they leave.

    Row v, ``start[v]:start[v + 1]``, holds a triangle (v, other, target) for each way in which
    v and `other` can hand their distances on to `target`.
    """

    start: npt.NDArray[np.int64]
    targets: Ints
    others: Ints
    shapes: npt.NDArray[np.float32]  # length of v-other; target's place along it and beside it


def stencils(mesh: TriangleMesh, embedding: Floats) -> Stencils:
    """Prepare marching on a mesh whose vertices lie at `embedding` (n, any number).

    Each corner takes its distance from the opposite edge. An obtuse corner may be reached before
    both ends of it: faces across that edge are unfolded into its plane until a vertex appears
    that cuts the angle into two acute ones, and the two virtual triangles serve, too.
    """
    count, faces = mesh.face_count, mesh.faces
    splits = np.empty(3 * count, dtype=np.int32)
    places = np.empty((3 * count, 2), dtype=np.float32)
    run(_split_corners, count, faces, mesh.twins, embedding, splits, places)
    start = np.zeros(mesh.vertex_count + 1, dtype=np.int64)
    run_in_order(_count_stencils, count, faces, splits, start)
    np.cumsum(start, out=start)
    targets = np.empty(start[-1], dtype=np.int32)
    others = np.empty(start[-1], dtype=np.int32)
    shapes = np.empty((start[-1], 3), dtype=np.float32)
    run_in_order(_fill_stencils, count, faces, embedding, splits, places, start[:-1].copy(),
                 targets, others, shapes)  # fmt: skip
    return Stencils(start, targets, others, shapes)


def face_stencils(mesh: TriangleMesh, embedding: Floats) -> Stencils:
    """Prepare marching from face to face, their centres at `embedding` (m, any number).

    Distances run straight from centre to centre: between faces there are no triangles to go
    through.
    """
    start = np.zeros(mesh.face_count + 1, dtype=np.int64)
    run(_count_links, mesh.face_count, mesh.twins, start)
    np.cumsum(start, out=start)
    targets = np.empty(start[-1], dtype=np.int32)
    others = np.empty(start[-1], dtype=np.int32)
    shapes = np.zeros((start[-1], 3), dtype=np.float32)
    run(_link_faces, mesh.face_count, mesh.twins, embedding, start, targets, others, shapes)
    return Stencils(start, targets, others, shapes)


def distances_from(
    mesh: TriangleMesh, source: int, embedding: Floats | None = None, limit: float = np.inf
) -> Floats:
    """Geodesic distances from one vertex: (n,), infinite beyond `limit`.

    Parameters
    ----------
    mesh : TriangleMesh
    source : int
    embedding : (n, any number) float64, optional
        Where the vertices lie; as a rule, `mesh.scaled_vertices`.
    limit : float
        Where to stop.
    """
    points = mesh.scaled_vertices if embedding is None else embedding
    scratch = march_scratch(mesh.vertex_count)
    reached = march(source, 1, limit, stencils(mesh, points), *scratch)
    found = np.full(mesh.vertex_count, np.inf)
    vertices = scratch[0][:reached]
    found[vertices] = np.sqrt(scratch[1][vertices])
    return found


@kernel
def march_scratch(count):
    """Memory that `march` needs for a mesh of `count` vertices; untouched pages cost nothing."""
    reached = np.empty(count, np.int32)
    squares = np.empty(count, np.float64)
    stamps = np.zeros(count, np.int32)
    heap = np.empty(count, np.int32)
    places = np.empty(count, np.int32)
    return reached, squares, stamps, heap, places


@kernel
def march(source, turn, limit, graph, reached, squares, stamps, heap, places):
    """March from `source` up to the distance `limit`; return how many vertices were reached.

    They are ``reached[:count]``, nearest first, with their squared distances in `squares`.
    `turn` is another number above zero for each march that uses the same scratch, so that
    nothing need be cleared.
    """
    start, targets, others, shapes = graph
    # A vertex is far while its stamp is below `close`, then close (in the heap), then accepted.
    close, accepted = 2 * turn, 2 * turn + 1
    count, size = 0, 0
    farthest = limit * limit
    squares[source] = 0.0
    stamps[source] = close
    size = _push(source, size, heap, places, squares)
    while size > 0:
        v = heap[0]
        size = _pop(size, heap, places, squares)
        stamps[v] = accepted
        reached[count] = v
        count += 1
        square = squares[v]
        for i in range(start[v], start[v + 1]):
            target = targets[i]
            if stamps[target] == accepted:
                continue
            along, beside = float(shapes[i, 1]), float(shapes[i, 2])
            found = np.inf
            if stamps[others[i]] == accepted:
                length = float(shapes[i, 0])
                found = _across(square, squares[others[i]], length, along, beside)
            if found == np.inf:
                found = (np.sqrt(square) + np.sqrt(along * along + beside * beside)) ** 2
            if not found <= farthest:  # nor NaN, where lengths overflow
                continue
            if stamps[target] != close:
                stamps[target] = close
                squares[target] = found
                size = _push(target, size, heap, places, squares)
            elif found < squares[target]:
                squares[target] = found
                _rise(places[target], heap, places, squares)
    return count


@kernel
def _across(from_v, from_other, length, along, beside):
    # All in squares. The distance that reaches the target through the edge, from a point behind
    # it that lies as far from both ends as they say: exact on what unfolds to a plane, where the
    # planar front of Kimmel and Sethian is up to a fifth too far next to the source (Novotni and
    # Klein 2002). Infinite if the straight way misses the edge.
    if beside <= 0.0:
        return np.inf
    x = 0.5 * (from_v - from_other + length * length) / length
    y = np.sqrt(max(from_v - x * x, 0.0))
    crossing = x * beside + along * y
    if crossing < 0.0 or crossing > length * (y + beside):
        return np.inf
    return (along - x) * (along - x) + (beside + y) * (beside + y)


@kernel
def _push(v, size, heap, places, squares):
    heap[size] = v
    places[v] = size
    _rise(size, heap, places, squares)
    return size + 1


@kernel
def _rise(place, heap, places, squares):
    v = heap[place]
    key = squares[v]
    while place > 0:
        parent = (place - 1) >> 1
        if squares[heap[parent]] <= key:
            break
        heap[place] = heap[parent]
        places[heap[place]] = place
        place = parent
    heap[place] = v
    places[v] = place


@kernel
def _pop(size, heap, places, squares):
    size -= 1
    v = heap[size]
    key = squares[v]
    place = 0
    while True:
        child = 2 * place + 1
        if child >= size:
            break
        if child + 1 < size and squares[heap[child + 1]] < squares[heap[child]]:
            child += 1
        if squares[heap[child]] >= key:
            break
        heap[place] = heap[child]
        places[heap[place]] = place
        place = child
    heap[place] = v
    places[v] = place
    return size


@kernel
def _squared(embedding, a, b):
    total = 0.0
    for j in range(embedding.shape[1]):
        step = embedding[a, j] - embedding[b, j]
        total += step * step
    return total


@kernel
def _third(ax, ay, bx, by, square_ac, square_bc):
    # Where c lies, right of the way from a to b, given its squared distances.
    ux, uy = bx - ax, by - ay
    square = ux * ux + uy * uy
    if square <= 0.0:
        return ax, ay
    along = 0.5 * (square_ac - square_bc + square) / square
    beside = np.sqrt(max(square_ac / square - along * along, 0.0))
    return ax + along * ux + beside * uy, ay + along * uy - beside * ux


@kernel
def _count_links(start, stop, twins, row_start):
    for f in range(start, stop):
        for k in range(3):
            row_start[f + 1] += twins[f, k] >= 0


@kernel
def _link_faces(start, stop, twins, embedding, row_start, targets, others, shapes):
    for f in range(start, stop):
        place = row_start[f]
        for k in range(3):
            if twins[f, k] >= 0:
                g = twins[f, k] // 3
                targets[place] = g
                others[place] = f
                shapes[place, 1] = np.sqrt(_squared(embedding, f, g))
                place += 1


@kernel
def _split_corners(start, stop, faces, twins, embedding, splits, places):
    # Per corner: the vertex that splits it and its place in the corner's own frame (see below),
    # or -1 if the corner is not obtuse; -2 if it is, but the unfolding runs over a border.
    for f in range(start, stop):
        for k in range(3):
            c, a, b = faces[f, k], faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
            corner = 3 * f + k
            splits[corner] = -1
            square_a = _squared(embedding, c, a)
            square_b = _squared(embedding, c, b)
            if square_a + square_b >= _squared(embedding, a, b) * (1 - 1e-9):
                continue
            splits[corner] = -2
            # The corner at the origin, a on the x axis, b above it; unfold across a-b.
            ax, ay = np.sqrt(square_a), 0.0
            bx, by = _third(ax, ay, 0.0, 0.0, _squared(embedding, a, b), square_b)
            if ax == 0.0:
                continue
            fx, fy, gx, gy = ax, ay, bx, by
            edge = twins[f, (k + 1) % 3]
            for _ in range(UNFOLDED):
                if edge < 0:
                    break
                g = edge // 3
                m = edge - 3 * g
                # The half-edge runs from the end near b to the one near a.
                d = faces[g, (m + 2) % 3]
                near_b, near_a = faces[g, m], faces[g, (m + 1) % 3]
                dx, dy = _third(fx, fy, gx, gy, _squared(embedding, near_a, d),
                                _squared(embedding, near_b, d))  # fmt: skip
                beyond_a = dx * ax + dy * ay < 0.0  # more than 90 degrees from a
                beyond_b = dx * bx + dy * by < 0.0
                if not beyond_a and not beyond_b:
                    splits[corner] = d
                    places[corner, 0] = dx
                    places[corner, 1] = dy
                    break
                if beyond_a:
                    gx, gy = dx, dy
                    edge = twins[g, (m + 1) % 3]
                else:
                    fx, fy = dx, dy
                    edge = twins[g, (m + 2) % 3]


@kernel
def _count_stencils(start, stop, faces, splits, row_start):
    for f in range(start, stop):
        for k in range(3):
            a, b = faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
            d = splits[3 * f + k]
            row_start[a + 1] += 1 if d < 0 else 2
            row_start[b + 1] += 1 if d < 0 else 2
            if d >= 0:
                row_start[d + 1] += 2


@kernel
def _fill_stencils(start, stop, faces, embedding, splits, places, cursors, targets, others, shapes):
    for f in range(start, stop):
        for k in range(3):
            c, a, b = faces[f, k], faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
            d = splits[3 * f + k]
            square_a = _squared(embedding, c, a)
            square_b = _squared(embedding, c, b)
            square_ab = _squared(embedding, a, b)
            _put(a, b, c, square_ab, square_a, square_b, cursors, targets, others, shapes)
            if d < 0:
                continue
            x, y = float(places[3 * f + k, 0]), float(places[3 * f + k, 1])
            ax = np.sqrt(square_a)
            bx, by = _third(ax, 0.0, 0.0, 0.0, square_ab, square_b)
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
    for turn in range(2):
        i = cursors[a]
        cursors[a] += 1
        targets[i] = c
        others[i] = b
        shapes[i, 0] = length
        shapes[i, 1] = along
        shapes[i, 2] = beside
        if turn == 0:
            a, b = b, a
            along = length - along
