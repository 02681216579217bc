# SPDX-License-Identifier: GPL-3.0-or-later
"""Cut cells: the pieces into which chart outlines cut the cells of the sheet, joined across seams.

A cell that no chart outline touches holds a bilinear function of its four nodes. A cut cell falls
into *pieces*: the polygons in which faces and the cell intersect. Their corners are points of the
surface, identified by exact names, never by rounded positions, so that both sides of a seam share
them:

- nodes of the sheet inside a chart,
- vertices of the mesh,
- seam points: where an edge on a chart outline crosses a line of the lattice, on either side,
- crossings: where another edge of the mesh does.

Not all are free unknowns. A crossing is interpolated linearly between its neighbours on the lattice
edge, as an uncut cell beside it is. So is a seam point that is very near the previous one along
the seam.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..atlas.atlas import TextureAtlas
from ..atlas.charts import degenerate_faces
from ..atlas.metric import AtlasMetric, open_places
from ..atlas.sheet import depth_within, ends, place_on_edge, span
from ..base.checks import Floats
from ..base.findings import tell
from ..base.parallel import kernel, run, run_in_order
from ..base.progress import aside, ask
from ..base.vectors import after
from ..mesh.triangle_mesh import Ints
from ..sparse.components import connected_components
from ..sparse.matrix import Sparse, from_triples, product

NODE, VERTEX, SEAM, CROSSING = range(4)
"""Kinds of points."""

_KIND = 60
"""Bits of a point's name from here on are its kind, those below its number within the kind."""

_NEAR = 1e-6
"""Positions closer than this, in texels, are the same."""

_APART = 0.2
"""Seam points closer than this to the previous one are not free: in texels, or in edge lengths if
the edge is shorter than a texel."""

_FLAT = 1e-12
"""Pieces of smaller area, in squared texels, are left out."""

_STRETCH = 1e3
"""Largest stretch of a face in one direction relative to the other; beyond it, single precision
would lose the next values along the long direction. Areas are preserved."""

_MOST_CORNERS = 256
"""Faces without area in the texture and with more corners are left out, as if the surface ended
there, because each corner would be coupled with all others."""


class SeamPoints(NamedTuple):
    """Where edges on chart outlines cross lines of the lattice, on either side.

    Attributes
    ----------
    pairs : (3 m,) int32
        For each half-edge the number of its pair: the two sides of an edge on a chart outline, or
        the one side of a border; -1 for all others.
    first : (pairs,) int32
        The half-edge along which the points of a pair are counted.
    start : (pairs + 1,) int64
        The first point of each pair, and the total number.
    shares : (k,) float64
        Positions along that half-edge, ascending.
    free : (k,) bool
        Free unknowns; the others are interpolated between their neighbours.
    split : (k,) bool
        Whether the surface is closed there, so that each side has its own point.
    """

    pairs: Ints
    first: Ints
    start: npt.NDArray[np.int64]
    shares: Floats
    free: npt.NDArray[np.bool_]
    split: npt.NDArray[np.bool_]


class Pieces(NamedTuple):
    """The polygons in which faces and cut cells intersect; corners are in order around them.

    A face without area in the texture is one piece, with its corners and its seam points.

    Attributes
    ----------
    start : (p + 1,) int64
        The first corner of each piece, and the total number.
    faces : (p,) int32
    cells : (p,) int64
        Row times columns plus column of the cell; -1 for faces without area in the texture.
    points : (v,) int64
        The number of the point at each corner.
    places : (v, 2) float64
        Its position in the sheet, in the piece's chart; NaN without area in the texture.
    frame : (v, 2) float64
        Its position in the face's frame, in mean texel sizes.
    """

    start: npt.NDArray[np.int64]
    faces: Ints
    cells: npt.NDArray[np.int64]
    points: npt.NDArray[np.int64]
    places: Floats
    frame: Floats


class CutCells(NamedTuple):
    """The cells of a sheet that chart outlines cut.

    Attributes
    ----------
    cut : (rows, columns) bool
        Cells that a chart outline touches.
    pieces : Pieces
    kinds : (points,) int64
        `NODE`, `VERTEX`, `SEAM` or `CROSSING`.
    unknowns : (s,) int32
        Flat numbers of the free points, ascending: of nodes row times columns plus column; all
        others follow the sheet's nodes in order.
    interpolation : (points, s) Sparse
        Interpolates the values of all points from those of the free ones.
    free : (s,) int64
        The free points, in the order of `unknowns` and of the interpolation's columns.
    hidden : (k, 2) int64
        Nodes that are not unknowns because a point of another kind coincides, and the number of
        that point.
    """

    cut: npt.NDArray[np.bool_]
    pieces: Pieces
    kinds: npt.NDArray[np.int64]
    unknowns: Ints
    interpolation: Sparse
    free: npt.NDArray[np.int64]
    hidden: npt.NDArray[np.int64]


def find_cut_cells(atlas: TextureAtlas, jacobians: Floats, jump: float = np.inf) -> CutCells:
    """Find the cut cells of an atlas whose faces have the given `jacobians`.

    Cells that edges of the mesh cross are also cut if lengths change across the edge by more than
    `jump`, over a texel.
    """
    mesh, sheet, metric = atlas.mesh, atlas.sheet, atlas.metric
    flat = degenerate_faces(atlas.charts)
    with aside("Finding seams"):
        seams = _find_seam_points(atlas, flat)
        corners = _corner_points(mesh.faces, metric)
        ends_here = np.flatnonzero(seams.pairs >= 0)
        at_end = np.zeros(int(corners.max()) + 1, dtype=np.bool_)
        at_end[corners.reshape(-1)[ends_here]] = True
        at_end[corners[ends_here // 3, (ends_here + 1) % 3]] = True
        cut = np.zeros(sheet.nodes.shape, dtype=np.bool_)
        _mark_cut(ends_here, sheet.points, flat, cut)
        if jump < np.inf:
            rough = np.flatnonzero(_jumps(mesh.twins, jacobians) > jump)
            _mark_cut(rough, sheet.points, flat, cut)
        ask()
        names, pieces = _cut_faces(atlas, jacobians, flat, seams, corners, at_end, cut)
        ask()
        named, pieces_points = np.unique(names, return_inverse=True)
        pieces = pieces._replace(points=pieces_points.reshape(-1))
        ask()
    kinds = named >> _KIND
    which = named & ((1 << _KIND) - 1)
    tied = np.full((len(named), 2), -1, dtype=np.int64)
    shares = np.zeros(len(named))
    _tie_seam_points(seams, corners, mesh.twins, named, kinds, which, tied, shares)
    inner = kinds == CROSSING
    vertices = kinds == VERTEX
    inner[vertices] = ~at_end[which[vertices]]
    _tie_to_lattice(pieces, sheet.nodes.shape[1], inner, tied, shares)
    unknowns, interpolation, free = _interpolation(kinds, which, tied, shares, sheet.nodes.size)
    hidden = _hidden(pieces, kinds, sheet.nodes.shape[1])
    return CutCells(cut, pieces, kinds, unknowns, interpolation, free, hidden)


def tempered_jacobians(metric: AtlasMetric) -> Floats:
    """Jacobians of the faces with the stretch limited to `_STRETCH`; areas are preserved."""
    jacobians = metric.jacobians.copy()
    a = np.einsum("fij,fij->f", jacobians, jacobians)
    area = np.abs(np.linalg.det(jacobians))
    wild = np.flatnonzero(a > (_STRETCH + 1.0 / _STRETCH) * area)
    wild = wild[area[wild] > 0]
    left, sizes, right = np.linalg.svd(jacobians[wild])
    mean, most = np.sqrt(sizes[:, 0] * sizes[:, 1]), np.sqrt(_STRETCH)
    sizes = np.stack([mean * most, mean / most], axis=1)
    jacobians[wild] = left @ (sizes[:, :, None] * right)
    return jacobians


def _jumps(twins: Ints, jacobians: Floats) -> Floats:
    # The change of lengths between both sides of each half-edge, over a texel: (3 m,). The
    # logarithm of the stretch from one side to the other, times the longer texel.
    f, g = np.repeat(np.arange(len(twins)), 3), twins.reshape(-1) // 3
    metrics = np.einsum("fki,fkj->fij", jacobians, jacobians)
    p, q, r = metrics[:, 0, 0], metrics[:, 0, 1], metrics[:, 1, 1]
    det = p * r - q * q
    both = p[f] * r[g] + r[f] * p[g] - 2.0 * q[f] * q[g]
    with np.errstate(all="ignore"):
        squares = both / det[f] + both / det[g] - 4.0
    sizes = np.sqrt(np.maximum(p + r, 0.0))
    found = np.sqrt(np.maximum(squares, 0.0)) * np.maximum(sizes[f], sizes[g])
    return np.where((g >= 0) & (det[f] > 0) & (det[g] > 0), found, 0.0)


def _find_seam_points(atlas: TextureAtlas, flat: npt.NDArray[np.bool_]) -> SeamPoints:
    # All edges of faces without area in the texture count as chart outlines.
    twins, points = atlas.mesh.twins.reshape(-1), atlas.sheet.points
    sides = np.zeros(len(twins), dtype=np.bool_)
    sides[atlas.charts.borders] = True
    sides.reshape(-1, 3)[flat] = True
    far = twins[sides]
    sides[far[far >= 0]] = True
    edges = np.flatnonzero(sides).astype(np.int32)
    other = twins[edges]
    is_first = (other < 0) | (other > edges)
    first = edges[is_first]
    pairs = np.full(len(twins), -1, dtype=np.int32)
    pairs[first] = np.arange(len(first), dtype=np.int32)
    second = twins[first]
    pairs[second[second >= 0]] = np.flatnonzero(second >= 0)
    most = _lines_between(points, first)
    most += np.where(second >= 0, _lines_between(points, second), 0)
    start = np.concatenate([[0], np.cumsum(most)])
    shares, free = np.full(start[-1], np.nan), np.zeros(start[-1], dtype=np.bool_)
    run(_place_seam_points, len(first), first, twins, points, start, shares, free)
    found = ~np.isnan(shares)
    start = np.concatenate([[0], np.cumsum(found)])[start]
    shares, free = shares[found], free[found]
    edge = np.repeat(first, np.diff(start))
    split = ~open_places(atlas.metric.ways, edge, shares)
    return SeamPoints(pairs, first, start, shares, free, split)


def _lines_between(points: Floats, edges: Ints) -> npt.NDArray[np.int64]:
    # Upper bounds of the lines of the lattice that half-edges cross.
    f, k = np.divmod(edges, 3)
    steps = np.floor(points[f, (k + 1) % 3]) - np.floor(points[f, k])
    return np.abs(steps).astype(np.int64).sum(axis=1) + 2


@kernel
def _add_crossings(points, edge, backwards, found, count):
    ay, ax, by, bx = ends(points, edge)
    for axis in range(2):
        a = ay if axis == 0 else ax
        b = by if axis == 0 else bx
        if a == b:
            continue
        for line in range(int(np.ceil(min(a, b))), int(np.floor(max(a, b))) + 1):
            share = (line - a) / (b - a)
            if 0.0 < share < 1.0:
                found[count] = 1.0 - share if backwards else share
                count += 1
    return count


@kernel
def _length(points, edge):
    ay, ax, by, bx = ends(points, edge)
    return np.sqrt((by - ay) ** 2 + (bx - ax) ** 2)


@kernel
def _place_seam_points(start, stop, first, twins, points, starts, shares, free):
    for i in range(start, stop):
        found = shares[starts[i] : starts[i + 1]]
        edge = first[i]
        count = _add_crossings(points, edge, False, found, 0)
        length = _length(points, edge)
        if twins[edge] >= 0:
            count = _add_crossings(points, twins[edge], True, found, count)
            length = max(length, _length(points, twins[edge]))
        found[:count].sort()
        kept = 0
        last = 0.0
        last_free = 0.0
        apart = _APART * min(1.0, length)
        for n in range(count):
            share = found[n]
            found[n] = np.nan
            if (share - last) * length <= _NEAR or (1.0 - share) * length <= _NEAR:
                continue
            found[kept] = share
            last = share
            if (share - last_free) * length >= apart and (1.0 - share) * length >= apart:
                free[starts[i] + kept] = True
                last_free = share
            kept += 1


def _corner_points(faces: Ints, metric: AtlasMetric) -> Ints:
    # The vertex at each corner; where seams are closed, each side has its own.
    ways = metric.ways
    if not ways.closed.any():
        return faces
    edges = np.flatnonzero(ways.twins.reshape(-1) >= 0)
    edges = edges[open_places(ways, edges, np.full(len(edges), 1e-6))]
    g, j = np.divmod(ways.twins.reshape(-1)[edges], 3)
    _, labels = connected_components(faces.size, edges, 3 * g + (j + 1) % 3)
    return labels.reshape(-1, 3)


@kernel
def _mark_cut(edges, points, flat, cut):
    line = np.empty((3, 2))
    for edge in edges:
        if flat[edge // 3]:
            continue
        line[0, 0], line[0, 1], line[1, 0], line[1, 1] = ends(points, edge)
        line[2] = line[1]
        low = int(np.floor(min(line[0, 0], line[1, 0]) - _NEAR))
        high = int(np.floor(max(line[0, 0], line[1, 0]) + _NEAR))
        for row in range(low, high + 1):
            first, last = span(line, row - _NEAR, row + 1 + _NEAR)
            if last >= first:
                left, right = int(np.floor(first - _NEAR)), int(np.floor(last + _NEAR))
                cut[row, left : right + 1] = True


class _Polygon(NamedTuple):
    # Corners of the current piece, with their angles around the middle, which order them.
    names: npt.NDArray[np.int64]
    places: Floats
    angles: Floats


def _cut_faces(
    atlas: TextureAtlas,
    jacobians: Floats,
    flat: npt.NDArray[np.bool_],
    seams: SeamPoints,
    corners: Ints,
    at_end: npt.NDArray[np.bool_],
    cut: npt.NDArray[np.bool_],
) -> tuple[npt.NDArray[np.int64], Pieces]:
    # The names of the pieces' corners, and the pieces, whose points are not numbered yet.
    count = atlas.mesh.face_count
    surface = atlas.sheet.points, atlas.mesh.twins, flat, atlas.metric.shapes, jacobians
    given = *surface, seams, corners, at_end, cut
    sizes = np.zeros((count, 2), dtype=np.int64)
    empty = Pieces(
        np.zeros(1, dtype=np.int64),
        np.zeros(0, dtype=np.int32),
        np.zeros(0, dtype=np.int64),
        np.zeros(0, dtype=np.int64),
        np.zeros((0, 2)),
        np.zeros((0, 2)),
    )
    run(_cut, count, *given, sizes, sizes, True, empty.points, empty)
    left_out = np.count_nonzero(flat & (atlas.metric.shapes[:, 2] != 0) & (sizes[:, 0] == 0))
    if left_out:
        tell(
            "Faces without area in the texture that are left out, as too many texels lie at their"
            " sides: {count}.",
            count=int(left_out),
        )
    first = np.zeros((count + 1, 2), dtype=np.int64)
    np.cumsum(sizes, axis=0, out=first[1:])
    pieces, total = first[-1]
    found = Pieces(
        np.zeros(pieces + 1, dtype=np.int64),
        np.empty(pieces, dtype=np.int32),
        np.empty(pieces, dtype=np.int64),
        np.empty(0, dtype=np.int64),
        np.full((total, 2), np.nan),
        np.empty((total, 2)),
    )
    names = np.empty(total, dtype=np.int64)
    run(_cut, count, *given, sizes, first, False, names, found)
    found.start[-1] = total
    return names, found


@kernel
def _name(kind, which):
    return (np.int64(kind) << _KIND) | np.int64(which)


@kernel
def _seam_name(seams, n, is_first):
    # Where the surface is closed, the second side's points are numbered after all others.
    return _name(SEAM, n if is_first or not seams.split[n] else n + seams.shares.shape[0])


@kernel
def _add(polygon, count, name, y, x):
    polygon.names[count] = name
    polygon.places[count, 0] = y
    polygon.places[count, 1] = x
    return count + 1


@kernel
def _within_cell(y, x, row, column):
    return row - _NEAR <= y <= row + 1 + _NEAR and column - _NEAR <= x <= column + 1 + _NEAR


@kernel
def _add_corners(polygon, triangle, corners, at_end, columns, row, column):
    count = 0
    for k in range(3):
        y, x = triangle[k, 0], triangle[k, 1]
        if not _within_cell(y, x, row, column):
            continue
        b, a = np.round(y), np.round(x)
        if not at_end[corners[k]] and abs(y - b) <= _NEAR and abs(x - a) <= _NEAR:
            count = _add(polygon, count, _name(NODE, int(b) * columns + int(a)), b, a)
        else:
            count = _add(polygon, count, _name(VERTEX, corners[k]), y, x)
    return count


@kernel
def _add_seam_points(polygon, count, points, seams, edge, row, column):
    pair = seams.pairs[edge]
    is_first = seams.first[pair] == edge
    for n in range(seams.start[pair], seams.start[pair + 1]):
        y, x = place_on_edge(points, edge, seams.shares[n] if is_first else 1.0 - seams.shares[n])
        if _within_cell(y, x, row, column):
            count = _add(polygon, count, _seam_name(seams, n, is_first), y, x)
    return count


@kernel
def _add_lattice_crossings(polygon, count, points, twin, edge, row, column):
    # Named along the lower of the two half-edges, so that both faces use the same name.
    ay, ax, by, bx = ends(points, edge)
    lower = edge
    if 0 <= twin < edge:
        lower = twin
        ay, ax, by, bx = by, bx, ay, ax
    length = np.sqrt((by - ay) ** 2 + (bx - ax) ** 2)
    for axis in range(2):
        a = ay if axis == 0 else ax
        b = by if axis == 0 else bx
        if a == b:
            continue
        first = row if axis == 0 else column
        other = column if axis == 0 else row
        for line in range(first, first + 2):
            share = (line - a) / (b - a)
            if share * length <= _NEAR or (1.0 - share) * length <= _NEAR:
                continue
            y = float(line) if axis == 0 else ay + share * (by - ay)
            x = ax + share * (bx - ax) if axis == 0 else float(line)
            off = (x if axis == 0 else y) - other
            # At a node, the node itself is the corner.
            if _NEAR < off < 1.0 - _NEAR:
                name = _name(CROSSING, ((np.int64(lower) * 2 + axis) << 20) + line)
                count = _add(polygon, count, name, y, x)
    return count


@kernel
def _add_nodes(polygon, count, triangle, columns, row, column):
    for y in range(row, row + 2):
        for x in range(column, column + 2):
            if depth_within(triangle, y, x) < -_NEAR:
                continue
            taken = False
            for n in range(count):
                place = polygon.places[n]
                taken |= abs(place[0] - y) <= 2 * _NEAR and abs(place[1] - x) <= 2 * _NEAR
            if not taken:
                count = _add(polygon, count, _name(NODE, y * columns + x), float(y), float(x))
    return count


@kernel
def _sort_around(polygon, count):
    # Orders the corners around their middle; returns the area.
    names, places, angles = polygon
    my = 0.0
    mx = 0.0
    for n in range(count):
        my += places[n, 0] / count
        mx += places[n, 1] / count
    for n in range(count):
        angles[n] = np.arctan2(places[n, 0] - my, places[n, 1] - mx)
    for n in range(1, count):  # insertion sort of a few corners
        angle, name, y, x = angles[n], names[n], places[n, 0], places[n, 1]
        m = n
        while m > 0 and angles[m - 1] > angle:
            angles[m] = angles[m - 1]
            names[m] = names[m - 1]
            places[m] = places[m - 1]
            m -= 1
        angles[m] = angle
        names[m] = name
        places[m, 0] = y
        places[m, 1] = x
    area = 0.0
    for n in range(count):
        y, x = places[n]
        v, u = places[n + 1 if n + 1 < count else 0]
        area += 0.5 * ((x - mx) * (v - my) - (y - my) * (u - mx))
    return area


@kernel
def _polygon_of(polygon, points, twins, seams, corners, at_end, columns, f, row, column):
    # The intersection of a face and a cell; returns its number of corners, 0 if there is none.
    triangle = points[f]
    count = _add_corners(polygon, triangle, corners[f], at_end, columns, row, column)
    for k in range(3):
        edge = 3 * f + k
        if seams.pairs[edge] >= 0:
            count = _add_seam_points(polygon, count, points, seams, edge, row, column)
        else:
            twin = twins[f, k]
            count = _add_lattice_crossings(polygon, count, points, twin, edge, row, column)
    count = _add_nodes(polygon, count, triangle, columns, row, column)
    if count < 3 or _sort_around(polygon, count) < _FLAT:
        return 0
    return count


@kernel
def _store(polygon, count, f, cell, piece, corner, names, pieces):
    pieces.start[piece] = corner
    pieces.faces[piece] = f
    pieces.cells[piece] = cell
    names[corner : corner + count] = polygon.names[:count]


@kernel
def _shape_of(polygon, shapes, seams, corners, f):
    # A face without area in the texture as a piece: places are positions in its frame.
    count = 0
    for k in range(3):
        j = after(k)
        ax = 0.0 if k == 0 else shapes[f, k - 1]
        ay = shapes[f, 2] if k == 2 else 0.0
        bx = 0.0 if j == 0 else shapes[f, j - 1]
        by = shapes[f, 2] if j == 2 else 0.0
        count = _add(polygon, count, _name(VERTEX, corners[f, k]), ax, ay)
        edge = 3 * f + k
        pair = seams.pairs[edge]
        is_first = seams.first[pair] == edge
        low, high = seams.start[pair], seams.start[pair + 1]
        for i in range(high - low):
            n = low + i if is_first else high - 1 - i
            share = seams.shares[n] if is_first else 1.0 - seams.shares[n]
            name = _seam_name(seams, n, is_first)
            count = _add(polygon, count, name, ax + share * (bx - ax), ay + share * (by - ay))
    return count


@kernel
def _cut(
    start, stop, points, twins, flat, shapes, jacobians, seams, corners, at_end, cut,
    sizes, first, counting, names, pieces,
):  # fmt: skip
    columns = cut.shape[1]
    capacity = 16
    for pair in range(seams.first.shape[0]):
        capacity = max(capacity, 16 + 3 * (seams.start[pair + 1] - seams.start[pair]))
    polygon = _Polygon(
        np.empty(capacity, dtype=np.int64), np.empty((capacity, 2)), np.empty(capacity)
    )
    for f in range(start, stop):
        piece, corner = 0, 0
        if not counting:
            piece, corner = first[f]
        if shapes[f, 2] == 0:
            continue  # no area in space
        if flat[f]:
            count = _shape_of(polygon, shapes, seams, corners, f)
            if count > _MOST_CORNERS:
                continue
            if counting:
                sizes[f, 0] += 1
                sizes[f, 1] += count
            else:
                _store(polygon, count, f, -1, piece, corner, names, pieces)
                pieces.frame[corner : corner + count] = polygon.places[:count]
            continue
        triangle = points[f]
        low = int(np.floor(min(triangle[0, 0], triangle[1, 0], triangle[2, 0]) - _NEAR))
        high = int(np.floor(max(triangle[0, 0], triangle[1, 0], triangle[2, 0]) + _NEAR))
        for row in range(low, high + 1):
            left, right = span(triangle, row - _NEAR, row + 1 + _NEAR)
            if right < left:
                continue
            for column in range(int(np.floor(left - _NEAR)), int(np.floor(right + _NEAR)) + 1):
                if not cut[row, column]:
                    continue
                count = _polygon_of(
                    polygon, points, twins, seams, corners, at_end, columns, f, row, column
                )
                if count == 0:
                    continue
                if counting:
                    sizes[f, 0] += 1
                    sizes[f, 1] += count
                    continue
                _store(polygon, count, f, row * columns + column, piece, corner, names, pieces)
                for n in range(count):
                    y, x = polygon.places[n]
                    pieces.places[corner + n, 0] = y
                    pieces.places[corner + n, 1] = x
                    dy = y - triangle[0, 0]
                    dx = x - triangle[0, 1]
                    for axis in range(2):
                        pieces.frame[corner + n, axis] = (
                            jacobians[f, axis, 0] * dy + jacobians[f, axis, 1] * dx
                        )
                piece += 1
                corner += count


def _tie_seam_points(
    seams: SeamPoints,
    corners: Ints,
    twins: Ints,
    named: npt.NDArray[np.int64],
    kinds: npt.NDArray[np.int64],
    which: npt.NDArray[np.int64],
    tied: npt.NDArray[np.int64],
    shares: Floats,
) -> None:
    # Seam points that are not free lie between the next free ones of their pair, or edge ends.
    total = len(seams.shares)
    if total == 0:
        return
    ties = np.flatnonzero(kinds == SEAM)
    ties = ties[~seams.free[which[ties] % total]]
    is_second, n = np.divmod(which[ties], total)
    pair = np.searchsorted(seams.start, n, side="right") - 1
    numbers = np.arange(total)
    before = np.maximum.accumulate(np.where(seams.free, numbers, -1))[n]
    behind = np.minimum.accumulate(np.where(seams.free, numbers, total)[::-1])[::-1][n]
    f, k = np.divmod(seams.first[pair], 3)
    g, j = np.divmod(np.maximum(twins[f, k], 0), 3)
    places = []
    for side, (neighbour, found) in enumerate(
        [(before, before >= seams.start[pair]), (behind, behind < seams.start[pair + 1])]
    ):
        neighbour = np.where(found, neighbour, 0)
        own = seams.split[neighbour] & (is_second == 1)
        point = np.int64(SEAM << _KIND) + neighbour + total * own
        here, there = corners[f, (k + side) % 3], corners[g, (j + 1 - side) % 3]
        end = np.int64(VERTEX << _KIND) + np.where(is_second == 1, there, here)
        name = np.where(found, point, end)
        number = np.minimum(np.searchsorted(named, name), len(named) - 1)
        tied[ties, side] = np.where(named[number] == name, number, -1)
        places.append(np.where(found, seams.shares[neighbour], float(side)))
    low, high = places
    shares[ties] = (seams.shares[n] - low) / (high - low)
    tied[ties[(tied[ties] < 0).any(axis=1)]] = -1  # an end that is in no piece


def _tie_to_lattice(
    pieces: Pieces,
    columns: int,
    inner: npt.NDArray[np.bool_],
    tied: npt.NDArray[np.int64],
    shares: Floats,
) -> None:
    # Points inside charts on lattice edges lie between the next points that others share.
    in_cells = np.flatnonzero(pieces.cells >= 0)
    order = in_cells[np.argsort(pieces.cells[in_cells], kind="stable")]
    cells = pieces.cells[order]
    starts = np.flatnonzero(np.concatenate([[True], cells[1:] != cells[:-1], [True]]))
    if len(order) == 0:
        return
    with aside("Finding seams"):
        run_in_order(_tie_cells, len(starts) - 1, starts, order, pieces, columns, inner, tied,
                     shares)  # fmt: skip


@kernel
def _tie_cells(start, stop, starts, order, pieces, columns, inner, tied, shares):
    capacity = 0
    for c in range(start, stop):
        count = 0
        for piece in order[starts[c] : starts[c + 1]]:
            count += pieces.start[piece + 1] - pieces.start[piece]
        capacity = max(capacity, count)
    listed = np.empty(capacity, dtype=np.int64)
    for c in range(start, stop):
        row, column = divmod(pieces.cells[order[starts[c]]], columns)
        for side in range(4):
            axis = side >> 1
            line = (row if axis == 0 else column) + (side & 1)
            count = 0
            any_inner = False
            for piece in order[starts[c] : starts[c + 1]]:
                for corner in range(pieces.start[piece], pieces.start[piece + 1]):
                    if abs(pieces.places[corner, axis] - line) <= _NEAR:
                        listed[count] = corner
                        count += 1
                        any_inner |= inner[pieces.points[corner]]
            if any_inner:
                _tie_side(listed, count, 1 - axis, pieces, inner, tied, shares)


@kernel
def _tie_side(listed, count, axis, pieces, inner, tied, shares):
    for n in range(count):
        point = pieces.points[listed[n]]
        if not inner[point]:
            continue
        place = pieces.places[listed[n], axis]
        low, high = -1, -1
        for m in range(count):
            if inner[pieces.points[listed[m]]]:
                continue
            other = pieces.places[listed[m], axis]
            if other <= place and (low < 0 or other > pieces.places[listed[low], axis]):
                low = m
            if other > place and (high < 0 or other < pieces.places[listed[high], axis]):
                high = m
        if low < 0 or high < 0:
            continue
        a, b = pieces.places[listed[low], axis], pieces.places[listed[high], axis]
        tied[point, 0] = pieces.points[listed[low]]
        tied[point, 1] = pieces.points[listed[high]]
        shares[point] = (place - a) / (b - a)


def _interpolation(
    kinds: npt.NDArray[np.int64],
    which: npt.NDArray[np.int64],
    tied: npt.NDArray[np.int64],
    shares: Floats,
    nodes: int,
) -> tuple[Ints, Sparse, npt.NDArray[np.int64]]:
    count = len(kinds)
    is_tied = tied[:, 0] >= 0
    free, ties = np.flatnonzero(~is_tied), np.flatnonzero(is_tied)
    rows = np.concatenate([free, ties, ties])
    columns = np.concatenate([free, tied[ties, 0], tied[ties, 1]])
    weights = np.concatenate([np.ones(len(free)), 1.0 - shares[ties], shares[ties]])
    step = from_triples(rows, columns, weights, (count, count))
    number = np.full(count, -1, dtype=np.int32)
    number[free] = np.arange(len(free), dtype=np.int32)
    columns = number[columns]
    held = columns >= 0
    last = from_triples(rows[held], columns[held], weights[held], (count, len(free)))
    # Two steps: crossings depend on seam points, and these on free ones.
    interpolation = product(step, last)
    # Names are sorted: nodes come first.
    own = kinds[free] == NODE
    unknowns = np.where(own, which[free], nodes + np.cumsum(~own) - 1)
    return unknowns.astype(np.int32), interpolation, free


def _hidden(pieces: Pieces, kinds: npt.NDArray[np.int64], columns: int) -> npt.NDArray[np.int64]:
    near = np.round(pieces.places)
    with np.errstate(invalid="ignore"):
        there = (np.abs(pieces.places - near) <= 2 * _NEAR).all(axis=1)
    there &= kinds[pieces.points] != NODE
    corners = np.flatnonzero(there)
    y, x = near[corners].astype(np.int64).T
    nodes, first = np.unique(y * columns + x, return_index=True)
    return np.stack([nodes, pieces.points[corners[first]]], axis=1)
