# SPDX-License-Identifier: GPL-3.0-or-later
"""Geodesic distance on the texels or the faces of a surface: fronts run from polygon to polygon.

The surface is divided into flat polygons (see `cut`): the uncut cells of the sheet, with their mean
metric, and the pieces of the cut ones, which seams join. Each point receives the least length of a
path that enters one of its polygons through a side and continues straight (Hopf and Lax; Bornemann,
Rasch 2006), until no value falls any more. At the side the front is a circle around its source,
unfolded into the plane (Novotni, Klein 2002), whose radius is carried along with the distance: so
it is exact in the plane, for points and for straight lines, at any distance.

Crane's heat method, used in paper B (7.3), follows the gradient of a heat that falls by
e^(-r/sqrt(t)): it fails beyond some hundred texels, or must smooth more the farther it goes.

Lengths are in mean texel sizes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.checks import Floats
from ..base.findings import tell
from ..base.parallel import kernel
from ..base.progress import aside, ask
from ..mesh.triangle_mesh import Ints, TriangleMesh
from .cut import CROSSING, NODE, tempered_jacobians
from .matrices import TextureSpace

_FLAT = 1e6
"""Radius of a straight front."""

_LEAST = 1e-5
"""A new path must be at least this much shorter to be passed on."""

_WIDTH = 0.5
"""Points whose distances differ by less are visited in arbitrary order."""

_BUCKETS = 1 << 12

_ROUND = 1 << 15
"""Points visited between two calls of `ask`."""

_MOST_VISITS = 100
"""Mean visits per point after which the march stops and reports the points that are left."""

_PATIENCE = 8
"""Visits of a point after which a new path must be shorter by more, the more visits there were.
Among long thin faces, the circles assumed at two sides may disagree. Distances would then fall in
turn in tiny steps, and the march would stay there until its visits are used up."""

_NEAR = 1e-6


class Segments(NamedTuple):
    """Straight line segments in faces, as sources of distance; points are segments of length 0.

    Attributes
    ----------
    faces : (k,) int32
    ends : (k, 2, 3) float64
        Barycentric coordinates.
    """

    faces: Ints
    ends: Floats


class _Polygons(NamedTuple):
    # Uncut cells and pieces. Points are the sheet's nodes, then the points of pieces that are not.
    cells: npt.NDArray[np.float32]  # see TextureSpace.mean_metrics
    start: npt.NDArray[np.int64]  # the first corner of each piece
    points: Ints  # the point at each corner
    frame: Floats  # the position of each corner
    first: Ints  # the corners at each point: corners[first[i] : first[i + 1]]
    corners: Ints
    pieces: Ints  # the piece of each corner


class _Fronts(NamedTuple):
    # Distance and radius at the points, and a bucket queue of points to visit, by distance.
    distances: Floats
    radii: Floats
    visits: Ints  # how often each point was visited
    lists: Ints  # the bucket of each point; -1: none
    before: Ints
    behind: Ints
    heads: Ints
    state: npt.NDArray[np.int64]  # the current bucket, and how many points are queued


class SurfaceDistance:
    """Distance on the surface from given sources.

    Parameters
    ----------
    space : TextureSpace
        Preferably one that separates faces where the metric jumps.
    """

    def __init__(self, space: TextureSpace) -> None:
        self._space = space
        self._jacobians = tempered_jacobians(space.atlas.metric)
        self._polygons, self._numbers = _polygons_of(space)
        self._fronts = _new_fronts(self._polygons)

    @property
    def found(self) -> bool:
        """Whether any source has been added."""
        return bool(self._fronts.state[1])

    def start_at_nodes(self, chosen: npt.NDArray[np.bool_]) -> None:
        """Add nodes of the sheet as sources: (rows, columns) bool."""
        labels = self._space.labels.reshape(-1)
        hidden = self._space.cut_cells.hidden
        nodes = np.flatnonzero(chosen.reshape(-1) & (labels >= 0))
        points = self._numbers[hidden[chosen.reshape(-1)[hidden[:, 0]], 1]]
        _start_at(np.concatenate([nodes, points]), self._fronts)

    def start_at_segments(self, segments: Segments) -> None:
        """Add points and line segments in faces as sources."""
        atlas, cut = self._space.atlas, self._space.cut_cells
        for low in range(0, len(segments.faces), _ROUND):
            part = slice(low, low + _ROUND)
            _start_along(segments.faces[part], segments.ends[part], atlas.sheet.points,
                         self._jacobians, atlas.metric.shapes, cut.cut, cut.pieces.faces,
                         cut.pieces.cells, self._polygons, self._fronts)  # fmt: skip
            ask()

    def spread(self) -> None:
        """Propagate the fronts until no distance falls any more."""
        _spread(self._polygons, self._fronts)

    def values(self) -> npt.NDArray[np.float32]:
        """Return the distance as a function on the surface (n, 1), inf where no path leads."""
        cut, labels = self._space.cut_cells, self._space.labels.reshape(-1)
        result = np.zeros((self._space.size, 1), dtype=np.float32)
        inside = np.flatnonzero(labels >= 0)
        result[inside, 0] = self._fronts.distances[inside]
        result[cut.unknowns, 0] = self._fronts.distances[self._numbers[cut.free]]
        return result


def distance_on_mesh(mesh: TriangleMesh, segments: Segments) -> Floats:
    """Return how far each vertex of a mesh is from points and lines in its faces.

    Returns
    -------
    (n,) float64
        In mean edge lengths; inf where no path leads.
    """
    places = mesh.scaled_vertices[mesh.faces]
    one, two = places[:, 1] - places[:, 0], places[:, 2] - places[:, 0]
    length = np.linalg.norm(one, axis=1)
    safe = np.maximum(length, 1e-300)
    shapes = np.stack([length, (one * two).sum(axis=1) / safe, 2.0 * mesh.areas / safe], axis=1)
    frame = np.zeros((mesh.face_count, 3, 2))
    frame[:, 1, 0], frame[:, 2] = shapes[:, 0], shapes[:, 1:]
    numbers = np.arange(mesh.face_count, dtype=np.int32)
    polygons = _Polygons(
        np.zeros((0, 0, 4), dtype=np.float32),
        3 * np.arange(mesh.face_count + 1),
        mesh.faces.reshape(-1),
        frame.reshape(-1, 2),
        *mesh.corners,
        np.repeat(numbers, 3),
    )
    fronts = _new_fronts(polygons)
    # Each face is a piece as a whole.
    none, cut = np.zeros((0, 2, 2)), np.zeros((0, 0), dtype=np.bool_)
    for low in range(0, len(segments.faces), _ROUND):
        part = slice(low, low + _ROUND)
        _start_along(segments.faces[part], segments.ends[part], none, none, shapes, cut, numbers,
                     np.full_like(numbers, -1), polygons, fronts)  # fmt: skip
        ask()
    _spread(polygons, fronts)
    return fronts.distances


def _new_fronts(polygons: _Polygons) -> _Fronts:
    count = len(polygons.first) - 1
    return _Fronts(
        np.full(count, np.inf),
        np.zeros(count),
        np.zeros(count, dtype=np.int32),
        np.full(count, -1, dtype=np.int32),
        np.empty(count, dtype=np.int32),
        np.empty(count, dtype=np.int32),
        np.full(_BUCKETS, -1, dtype=np.int32),
        np.zeros(2, dtype=np.int64),
    )


def _spread(polygons: _Polygons, fronts: _Fronts) -> None:
    total = len(fronts.distances)
    for done in range(0, _MOST_VISITS * total, _ROUND):
        _visit(_ROUND, polygons, fronts)
        ask(min(done / total, 1.0))
        if fronts.state[1] == 0:
            return
    tell("Places whose distance may be too large: {count}.", count=int(fronts.state[1]))


def _polygons_of(space: TextureSpace) -> tuple[_Polygons, Ints]:
    # Also returns the number of each point of the pieces.
    pieces, kinds = space.cut_cells.pieces, space.cut_cells.kinds
    with aside("Finding texels"):
        count = space.labels.size
        others = kinds != NODE
        numbers = np.empty(len(kinds), dtype=np.int32)
        numbers[others] = count + np.arange(np.count_nonzero(others))
        own = ~others[pieces.points]
        y, x = np.round(pieces.places[own]).astype(np.int64).T
        numbers[pieces.points[own]] = y * space.labels.shape[1] + x
        ask()
        cells = space.mean_metrics()
        points, frame, sizes = _cells_with_crossings(space, cells, numbers)
        points = np.concatenate([numbers[pieces.points], points])
        start = np.concatenate([pieces.start, pieces.start[-1] + np.cumsum(sizes)])
        total = count + np.count_nonzero(others)
        first = np.zeros(total + 1, dtype=np.int32)
        np.cumsum(np.bincount(points, minlength=total), out=first[1:])
        corners = np.argsort(points, kind="stable").astype(np.int32)
        of_corners = np.repeat(np.arange(len(start) - 1, dtype=np.int32), np.diff(start))
        ask()
    frame = np.concatenate([pieces.frame, frame])
    return _Polygons(cells, start, points, frame, first, corners, of_corners), numbers


def _cells_with_crossings(
    space: TextureSpace, cells: npt.NDArray[np.float32], numbers: Ints
) -> tuple[Ints, Floats, npt.NDArray[np.int64]]:
    # Uncut cells whose sides contain points of the pieces beside them: the points around each cell,
    # their positions in a plane, and how many each cell has.
    cut, columns = space.cut_cells, space.labels.shape[1]
    corner = np.flatnonzero(cut.kinds[cut.pieces.points] == CROSSING)
    corner = corner[np.unique(cut.pieces.points[corner], return_index=True)[1]]
    point, place = numbers[cut.pieces.points[corner]], cut.pieces.places[corner]
    on_row = place[:, 0] == np.round(place[:, 0])
    cell = np.floor(place).astype(np.int64)
    beside = cell - np.stack([on_row, ~on_row], axis=1)
    cell, point, place = np.concatenate([cell, beside]), np.tile(point, 2), np.tile(place, (2, 1))
    uncut = cells[cell[:, 0], cell[:, 1], 3] > 0
    cell, point, place = cell[uncut], point[uncut], place[uncut]
    chosen = np.unique(cell[:, 0] * columns + cell[:, 1])
    steps = np.array([[0, 0], [0, 1], [1, 1], [1, 0]])
    nodes = np.stack(np.divmod(chosen, columns), axis=1)[:, None] + steps
    owner = np.concatenate([np.repeat(chosen, 4), cell[:, 0] * columns + cell[:, 1]])
    point = np.concatenate([(nodes @ [columns, 1]).reshape(-1).astype(np.int32), point])
    place = np.concatenate([nodes.reshape(-1, 2).astype(np.float64), place])
    dy, dx = (place - np.stack(np.divmod(owner, columns), axis=1)).T
    order = np.lexsort([np.arctan2(dy - 0.5, dx - 0.5), owner])
    rows, mixed, across, _ = cells.reshape(-1, 4)[owner].astype(np.float64).T
    length = np.sqrt(rows)
    off = np.sqrt(across - mixed * mixed / rows)
    frame = np.stack([length * dy + mixed / length * dx, off * dx], axis=1)
    sizes = np.unique(owner, return_counts=True)[1]
    return point[order], frame[order], sizes


@kernel
def _metric(cell):
    # Squared lengths of a step of one row and of one column, and their inner product.
    return np.float64(cell[0]), np.float64(cell[2]), np.float64(cell[1])


@kernel
def _through(d, r, e, s, base, a, b):
    # Distance and radius at a point, from those at both ends of a side whose squared length is
    # `base`, if the path crosses the side; a and b are the squared distances to its ends.
    if not (d < np.inf and e < np.inf and base > 0):
        return np.inf, 0.0
    length = np.sqrt(base)
    x = (a + base - b) / (2.0 * length)
    square = a - x * x
    if square <= 0:
        return np.inf, 0.0
    if d == 0 and e == 0:
        # Adjacent painted nodes form a line. The surroundings of other sources are set already.
        if r > 0 or s > 0:
            return np.inf, 0.0
        r = _FLAT
        s = _FLAT
    # The source lies beyond the side, at the distances p and q from its ends.
    mean = 0.5 * (r + s)
    p = mean + 0.5 * (d - e)
    q = mean - 0.5 * (d - e)
    if p < 0 or q < 0:
        return np.inf, 0.0
    along = (base + (d - e) * (p + q)) / (2.0 * length)
    off = (p - along) * (p + along)
    if off < 0:
        return np.inf, 0.0
    off = np.sqrt(off)
    y = np.sqrt(square)
    if y * along + off * x < -_NEAR * length or y * along + off * x > (1 + _NEAR) * length * (
        y + off
    ):
        return np.inf, 0.0
    radius = np.sqrt((x - along) ** 2 + (y + off) ** 2)
    return max(0.5 * (d + e) - mean + radius, min(d, e)), min(radius, _FLAT)


@kernel
def _take_out(i, lists, before, behind, heads):
    if before[i] >= 0:
        behind[before[i]] = behind[i]
    else:
        heads[lists[i]] = behind[i]
    if behind[i] >= 0:
        before[behind[i]] = before[i]
    lists[i] = -1


@kernel
def _queue(i, distance, lists, before, behind, heads, state):
    # Points too far away for the buckets wait in the last one.
    now = state[0]
    place = (now + min(max(int(distance / _WIDTH) - now, 0), _BUCKETS - 1)) % _BUCKETS
    if lists[i] == place:
        return
    if lists[i] >= 0:
        _take_out(i, lists, before, behind, heads)
        state[1] -= 1
    head = heads[place]
    before[i] = -1
    behind[i] = head
    if head >= 0:
        before[head] = i
    heads[place] = i
    lists[i] = place
    state[1] += 1


@kernel
def _offer(i, distance, radius, fronts):
    # At equal distance the larger radius wins: where lines join, fronts are straight on both sides.
    distances, radii, _, lists, before, behind, heads, state = fronts
    gain = distances[i] - distance
    if gain > _LEAST or (gain > -_LEAST and radius > radii[i]):
        distances[i] = distance
        radii[i] = radius
        _queue(i, distance, lists, before, behind, heads, state)


@kernel
def _start_at(points, fronts):
    for i in points:
        _offer(i, 0.0, 0.0, fronts)


@kernel
def _better(found, radius, old, d, r, e, s, base, a, b):
    # The shorter of the best path so far and the path through a side.
    if min(d, e) < min(found, old):
        distance, far = _through(d, r, e, s, base, a, b)
        if distance < found:
            return distance, far
    return found, radius


@kernel
def _is_shorter(found, old, visits):
    return found < old - _LEAST * max(visits / _PATIENCE, 1.0) ** 3


@kernel
def _visit_node(i, polygons, fronts):
    # Passes a node's distance on to the other nodes of its four cells.
    distances, radii, visits, lists, before, behind, heads, state = fronts
    cells = polygons.cells
    columns = cells.shape[1]
    row, column = divmod(i, columns)
    d, r = distances[i], radii[i]
    for corner in range(4):
        down, right = 2 * (corner >> 1) - 1, 2 * (corner & 1) - 1
        y, x = row - (down < 0), column - (right < 0)
        if y < 0 or x < 0 or cells[y, x, 3] == 0:
            continue
        rows, across, mixed = _metric(cells[y, x])
        slanted = 2.0 * mixed * down * right
        diagonal, other = rows + across + slanted, rows + across - slanted
        a, b = i + down * columns, i + right
        c = a + right
        e, s, g, t = distances[a], radii[a], distances[b], radii[b]
        length = np.sqrt(diagonal)
        best, radius = d + length, r + length
        old = distances[c]
        best, radius = _better(best, radius, old, d, r, e, s, rows, diagonal, across)
        best, radius = _better(best, radius, old, d, r, g, t, across, diagonal, rows)
        if _is_shorter(best, old, visits[c]):
            distances[c], radii[c] = best, min(radius, _FLAT)
            _queue(c, best, lists, before, behind, heads, state)
        length = np.sqrt(rows)
        best, radius = _better(d + length, r + length, e, d, r, g, t, across, rows, other)
        if _is_shorter(best, e, visits[a]):
            distances[a], radii[a] = best, min(radius, _FLAT)
            _queue(a, best, lists, before, behind, heads, state)
        length = np.sqrt(across)
        best, radius = _better(d + length, r + length, g, d, r, e, s, rows, across, other)
        if _is_shorter(best, g, visits[b]):
            distances[b], radii[b] = best, min(radius, _FLAT)
            _queue(b, best, lists, before, behind, heads, state)


@kernel
def _square(frame, i, j):
    return (frame[i, 0] - frame[j, 0]) ** 2 + (frame[i, 1] - frame[j, 1]) ** 2


@kernel
def _visit_piece(corner, polygons, fronts):
    # Passes the distance at a corner on to the other corners of its piece.
    distances, radii, visits, lists, before, behind, heads, state = fronts
    points, frame = polygons.points, polygons.frame
    piece = polygons.pieces[corner]
    low, high = polygons.start[piece], polygons.start[piece + 1]
    k = corner + 1 if corner + 1 < high else low
    j = corner - 1 if corner > low else high - 1
    i = points[corner]
    d, r = distances[i], radii[i]
    e, s, g, t = distances[points[j]], radii[points[j]], distances[points[k]], radii[points[k]]
    left, right = _square(frame, j, corner), _square(frame, k, corner)
    for n in range(low, high):
        if n == corner:
            continue
        target = points[n]
        old = distances[target]
        square = _square(frame, n, corner)
        length = np.sqrt(square)
        best, radius = d + length, r + length
        if n != j:
            far = _square(frame, j, n)
            best, radius = _better(best, radius, old, d, r, e, s, left, square, far)
        if n != k:
            far = _square(frame, k, n)
            best, radius = _better(best, radius, old, d, r, g, t, right, square, far)
        if _is_shorter(best, old, visits[target]):
            distances[target], radii[target] = best, min(radius, _FLAT)
            _queue(target, best, lists, before, behind, heads, state)


@kernel
def _visit(most, polygons, fronts):
    distances, _, visits, lists, before, behind, heads, state = fronts
    nodes = polygons.cells.shape[0] * polygons.cells.shape[1]
    visited = 0
    while state[1] > 0 and visited < most:
        i = heads[state[0] % _BUCKETS]
        if i < 0:
            state[0] += 1
            continue
        _take_out(i, lists, before, behind, heads)
        state[1] -= 1
        if int(distances[i] / _WIDTH) > state[0]:
            _queue(i, distances[i], lists, before, behind, heads, state)
            continue
        visited += 1
        visits[i] += 1
        if i < nodes:
            _visit_node(i, polygons, fronts)
        for n in range(polygons.first[i], polygons.first[i + 1]):
            _visit_piece(polygons.corners[n], polygons, fronts)


@kernel
def _find_piece(faces, cells, face, cell):
    # The piece of a face in a cell, or -1; pieces are sorted.
    low, high = 0, len(faces)
    while low < high:
        middle = (low + high) // 2
        if faces[middle] < face or (faces[middle] == face and cells[middle] < cell):
            low = middle + 1
        else:
            high = middle
    if low < len(faces) and faces[low] == face and cells[low] == cell:
        return low
    return -1


@kernel
def _to_segment(px, py, ax, ay, bx, by, rows, across, mixed):
    # Distance of P from the segment AB in a metric, and the radius of its front there.
    ux, uy = bx - ax, by - ay
    vx, vy = px - ax, py - ay
    square = rows * ux * ux + across * uy * uy + 2.0 * mixed * ux * uy
    radius = 0.0
    if square > 0:
        share = (rows * ux * vx + across * uy * vy + mixed * (ux * vy + uy * vx)) / square
        if -_NEAR <= share <= 1.0 + _NEAR:
            radius = _FLAT
        share = min(max(share, 0.0), 1.0)
        vx -= share * ux
        vy -= share * uy
    distance = np.sqrt(max(rows * vx * vx + across * vy * vy + 2.0 * mixed * vx * vy, 0.0))
    return distance, radius if radius > 0 else distance


@kernel
def _place(triangle, shares):
    y = shares[0] * triangle[0, 0] + shares[1] * triangle[1, 0] + shares[2] * triangle[2, 0]
    x = shares[0] * triangle[0, 1] + shares[1] * triangle[1, 1] + shares[2] * triangle[2, 1]
    return y, x


@kernel
def _in_frame(triangle, jacobian, y, x):
    dy, dx = y - triangle[0, 0], x - triangle[0, 1]
    return jacobian[0, 0] * dy + jacobian[0, 1] * dx, jacobian[1, 0] * dy + jacobian[1, 1] * dx


@kernel
def _start_in_piece(piece, ax, ay, bx, by, polygons, fronts):
    for n in range(polygons.start[piece], polygons.start[piece + 1]):
        px, py = polygons.frame[n]
        distance, radius = _to_segment(px, py, ax, ay, bx, by, 1.0, 1.0, 0.0)
        _offer(polygons.points[n], distance, radius, fronts)


@kernel
def _start_in_cell(row, column, ay, ax, by, bx, polygons, fronts):
    cell = polygons.cells[row, column]
    if cell[3] == 0:
        return
    rows, across, mixed = _metric(cell)
    for y in range(row, row + 2):
        for x in range(column, column + 2):
            distance, radius = _to_segment(y, x, ay, ax, by, bx, rows, across, mixed)
            _offer(y * polygons.cells.shape[1] + x, distance, radius, fronts)


@kernel
def _start_within(face, triangle, jacobian, ay, ax, by, bx, cut, faces, cells, polygons, fronts):
    # Starts from a segment in one cell, or on its boundary.
    y, x = 0.5 * (ay + by), 0.5 * (ax + bx)
    for row in range(int(np.floor(y - _NEAR)), int(np.floor(y + _NEAR)) + 1):
        for column in range(int(np.floor(x - _NEAR)), int(np.floor(x + _NEAR)) + 1):
            if not cut[row, column]:
                _start_in_cell(row, column, ay, ax, by, bx, polygons, fronts)
                continue
            piece = _find_piece(faces, cells, face, row * cut.shape[1] + column)
            if piece >= 0:
                au, av = _in_frame(triangle, jacobian, ay, ax)
                bu, bv = _in_frame(triangle, jacobian, by, bx)
                _start_in_piece(piece, au, av, bu, bv, polygons, fronts)


@kernel
def _start_along(which, ends, places, jacobians, shapes, cut, faces, cells, polygons, fronts):
    for k in range(len(which)):
        f = which[k]
        flat = _find_piece(faces, cells, f, -1)
        if flat >= 0:
            # A face without area in the texture is one piece.
            ax, ay = _shape_place(shapes[f], ends[k, 0])
            bx, by = _shape_place(shapes[f], ends[k, 1])
            _start_in_piece(flat, ax, ay, bx, by, polygons, fronts)
            continue
        triangle = places[f]
        ay, ax = _place(triangle, ends[k, 0])
        by, bx = _place(triangle, ends[k, 1])
        share = 0.0
        while True:
            # Continue to the next line of the lattice.
            y, x = ay + share * (by - ay), ax + share * (bx - ax)
            end = min(_share_at_line(ay, by, y), _share_at_line(ax, bx, x))
            v, u = ay + end * (by - ay), ax + end * (bx - ax)
            _start_within(
                f, triangle, jacobians[f], y, x, v, u, cut, faces, cells, polygons, fronts
            )
            if end >= 1.0:
                break
            share = end


@kernel
def _share_at_line(a, b, now):
    # The position from a to b of the next whole number after `now`; at most 1.
    if b > a:
        return min((np.floor(now + _NEAR) + 1.0 - a) / (b - a), 1.0)
    if b < a:
        return min((np.ceil(now - _NEAR) - 1.0 - a) / (b - a), 1.0)
    return 1.0


@kernel
def _shape_place(shape, shares):
    return shares[1] * shape[0] + shares[2] * shape[1], shares[2] * shape[2]
