# SPDX-License-Identifier: GPL-3.0-or-later
"""The sheet: a texture's texels laid out so that each node belongs to one chart.

A node is a texel as seen by one chart, and a cell is the square between four nodes. Charts lie
in the sheet as they lie in the image, except those whose nodes touch another chart's, or that
leave the image: these are shifted by whole texels to shelves below (paper B, footnote 1). So cells
are addressed by row and column, neighbours are adjacent, and no two charts meet.

A node is *inside* if the texel's centre lies in a face; otherwise it is a *ghost*, whose value
comes from the surface beyond the nearest edge of its chart.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run, run_in_order
from ..base.progress import aside, ask, phase
from ..base.vectors import after
from ..errors import InvalidUV
from ..mesh.triangle_mesh import Floats, Ints
from .charts import Charts

NOTHING = -1
"""In `Sheet.nodes` and `Sheet.cells`: no chart is here."""

ROWS = 32
"""Rows of a sheet that a kernel processes at once."""

_GHOST = -2  # less the ghost's number
_CLEARLY = 0.01  # in texels
_SLACK = 1e-6
_MOST_NODES = 1 << 31


class _FacesByRows(NamedTuple):
    # First and last row of cells that each face touches: (m, 2). And the faces that touch nodes
    # of each chunk of rows: faces[start[chunk]:start[chunk + 1]], in ascending order.
    bands: npt.NDArray[np.int64]
    start: npt.NDArray[np.int64]
    faces: Ints


class Sheet(NamedTuple):
    """The layout of the charts' texels in the sheet.

    Attributes
    ----------
    points : (m, 3, 2) float64
        Corners of the faces as (row, column) in the sheet.
    shifts : (charts, 2) int64
        Offset of each chart in the sheet from its place in the image.
    nodes : (rows, columns) int32
        The face in which a node lies; `NOTHING`; or -2 - g for the ghost g.
    cells : (rows, columns) int32
        A face that touches the cell whose first corner is this node, preferably the one at its
        centre; or `NOTHING`.
    ghosts : (g,) int32
        Row times columns plus column of the ghosts.
    ghost_edges : (g,) int32
        The half-edge nearest to each ghost on its chart's outline.
    overlapping : (m,) bool
        Faces that share a texel's centre with another face of their chart.
    """

    points: Floats
    shifts: npt.NDArray[np.int64]
    nodes: Ints
    cells: Ints
    ghosts: Ints
    ghost_edges: Ints
    overlapping: npt.NDArray[np.bool_]


def lay_out(charts: Charts, height: int, width: int) -> Sheet:
    """Lay out the charts of an image of `height` times `width` texels.

    Raises
    ------
    InvalidUV
        If the sheet would need too many texels.
    """
    shifts, shape = _places(charts, height, width)
    points = charts.points + shifts[charts.labels][:, None]
    with aside("Finding texels"):
        faces = faces_by_rows(points, shape[0])
    nodes, cells = np.empty(shape, dtype=np.int32), np.empty(shape, dtype=np.int32)
    overlapping = np.zeros(len(points), dtype=np.bool_)
    with phase(0.4, 0.8, "Finding texels"):
        run(_draw_faces, shape[0], points, faces, nodes, cells, overlapping, chunk=ROWS)
    with phase(0.8, 0.9, "Finding texels"):
        run(_mark_ghosts, shape[0], cells, nodes, chunk=ROWS)
    with aside("Finding texels"):
        ghosts = np.flatnonzero(nodes == _GHOST).astype(np.int32)
        nodes.reshape(-1)[ghosts] = _GHOST - np.arange(len(ghosts))
    edges = np.full(len(ghosts), -1, dtype=np.int32)
    nearest = np.full(len(ghosts), np.inf, dtype=np.float32)
    with phase(0.9, 1.0, "Finding texels"):
        run_in_order(_find_edges, len(charts.borders), charts.borders, points, charts.labels,
                     nodes, cells, nearest, edges)  # fmt: skip
    return Sheet(points, shifts, nodes, cells, ghosts, edges, overlapping)


def _places(
    charts: Charts, height: int, width: int
) -> tuple[npt.NDArray[np.int64], tuple[int, int]]:
    # Shifts of all charts and the size of the sheet.
    low = np.floor(charts.boxes[:, 0] - _SLACK).astype(np.int64)
    high = np.floor(charts.boxes[:, 1] + _SLACK).astype(np.int64) + 1
    away = (low < -1).any(axis=1) | (high > (height, width)).any(axis=1)
    with phase(0.0, 0.3, "Finding texels"):
        away |= _clashing(charts, away, (height + 2, width + 2))
    shifts, (rows, columns) = _shelve(low, high, away, height, width)
    if rows * columns >= min(_MOST_NODES, 64 * height * width + 1024 * len(charts.boxes)):
        largest = int(np.argmax((high - low).max(axis=1)))
        raise InvalidUV(
            "Laid out without overlaps, the charts need {columns} x {rows} texels, too many for an"
            " image of {width} x {height}; the longest chart is that of face {face}. Unwrap the"
            " mesh without overlaps.",
            columns=columns,
            rows=rows,
            width=width,
            height=height,
            face=int(np.argmax(charts.labels == largest)),
        )
    return shifts, (rows, columns)


def _clashing(charts: Charts, away: npt.NDArray, shape: tuple[int, int]) -> npt.NDArray[np.bool_]:
    # Charts that share a node with a chart of a lower number.
    claims = np.empty(shape, dtype=np.int32)
    points = charts.points + 1.0  # nodes start one row and one column before the image
    with aside("Finding texels"):
        faces = faces_by_rows(points, shape[0])
    clashes = np.zeros(len(charts.boxes), dtype=np.bool_)
    for check in (False, True):
        with phase(0.5 * check, 0.5 + 0.5 * check, "Finding texels"):
            run(_claim, shape[0], points, faces, charts.labels, away, check, claims,
                clashes, chunk=ROWS)  # fmt: skip
    return clashes


def _shelve(
    low: npt.NDArray[np.int64],
    high: npt.NDArray[np.int64],
    away: npt.NDArray[np.bool_],
    height: int,
    width: int,
) -> tuple[npt.NDArray[np.int64], tuple[int, int]]:
    # Shifts of all charts and the size of the sheet; shelves are filled with tall charts first.
    shifts = np.ones_like(low)
    sizes = high - low + 1
    columns = max(width + 2, int(sizes[away, 1].max(initial=0)))
    row, column, tallest = height + 2, 0, 0
    chosen = np.flatnonzero(away)
    for chart in chosen[np.argsort(-sizes[chosen, 0], kind="stable")]:
        if column + sizes[chart, 1] > columns:
            row, column, tallest = row + tallest, 0, 0
        shifts[chart] = (row - low[chart, 0], column - low[chart, 1])
        column += sizes[chart, 1]
        tallest = max(tallest, sizes[chart, 0])
    return shifts, (int(row + tallest), columns)


def faces_by_rows(points: Floats, rows: int) -> _FacesByRows:
    """List the faces that touch the nodes of each chunk of `ROWS` rows."""
    low, high = points[..., 0].min(axis=1), points[..., 0].max(axis=1)
    bands = np.floor(np.stack([low - _SLACK, high + _SLACK], axis=1)).astype(np.int64)
    ask()
    chunks = -(-rows // ROWS)
    first = np.maximum(bands[:, 0] // ROWS, 0)
    counts = np.maximum(np.minimum((bands[:, 1] + 1) // ROWS + 1, chunks) - first, 0)
    ends = np.cumsum(counts)
    # One entry for each pair of a face and a chunk that it touches.
    faces = np.repeat(np.arange(len(points), dtype=np.int32), counts)
    chunk = np.arange(len(faces)) - np.repeat(ends - counts - first, counts)
    ask()
    faces = faces[np.argsort(chunk, kind="stable")]
    start = np.concatenate([[0], np.cumsum(np.bincount(chunk, minlength=chunks))])
    return _FacesByRows(bands, start, faces)


@kernel
def span(triangle, low, high):
    """First and last column of the part of a triangle between two rows."""
    first = np.inf
    last = -np.inf
    for k in range(3):
        y = triangle[k, 0]
        x = triangle[k, 1]
        if low <= y <= high:
            first = min(first, x)
            last = max(last, x)
        next_y = triangle[after(k), 0]
        slope = triangle[after(k), 1] - x
        for line in (low, high):
            if min(y, next_y) < line < max(y, next_y):
                crossing = x + slope * (line - y) / (next_y - y)
                first = min(first, crossing)
                last = max(last, crossing)
    return first, last


@kernel
def _claim(start, stop, points, by_rows, labels, away, check, claims, clashes):
    # Assigns each node to the lowest chart that touches it; the second pass marks the others.
    if not check:
        claims[start:stop] = clashes.shape[0]
    bands, listed, faces = by_rows
    chunk = start // ROWS
    for f in faces[listed[chunk] : listed[chunk + 1]]:
        label = labels[f]
        if away[label]:
            continue
        triangle = points[f]
        for row in range(max(bands[f, 0], start - 1), min(bands[f, 1] + 1, stop)):
            first, last = span(triangle, row - _SLACK, row + 1 + _SLACK)
            if last < first:
                continue
            left = int(np.floor(first - _SLACK))
            right = int(np.floor(last + _SLACK)) + 1
            for y in range(max(row, start), min(row + 2, stop)):
                for x in range(left, right + 1):
                    if not check:
                        claims[y, x] = min(claims[y, x], label)
                    elif claims[y, x] != label:
                        clashes[label] = True


@kernel
def clearly_within(triangle, y, x):
    """Whether a texel's centre is so deep in a triangle that it cannot lie in another as well."""
    return depth_within(triangle, y, x) > _CLEARLY


@kernel
def depth_within(triangle, y, x):
    """The depth of a place in a triangle, in texels; at most 0 in one without area."""
    area = (triangle[1, 1] - triangle[0, 1]) * (triangle[2, 0] - triangle[0, 0])
    area -= (triangle[1, 0] - triangle[0, 0]) * (triangle[2, 1] - triangle[0, 1])
    sign = 1.0 if area > 0 else -1.0
    depth = np.inf
    for k in range(3):
        ey = triangle[after(k), 0] - triangle[k, 0]
        ex = triangle[after(k), 1] - triangle[k, 1]
        length = np.sqrt(ey * ey + ex * ex)
        if length == 0:
            return -np.inf
        across = ex * (y - triangle[k, 0]) - ey * (x - triangle[k, 1])
        depth = min(depth, sign * across / length)
    return depth


@kernel
def _draw_faces(start, stop, points, by_rows, nodes, cells, overlapping):
    # Rows start .. stop - 1 of nodes and cells; if faces overlap, the first one is kept.
    nodes[start:stop] = NOTHING
    cells[start:stop] = NOTHING
    bands, listed, faces = by_rows
    chunk = start // ROWS
    for f in faces[listed[chunk] : listed[chunk + 1]]:
        triangle = points[f]
        for row in range(max(bands[f, 0], start), min(bands[f, 1] + 1, stop)):
            first, last = span(triangle, row - _SLACK, row + 1 + _SLACK)
            if last < first:
                continue
            for x in range(int(np.floor(first - _SLACK)), int(np.floor(last + _SLACK)) + 1):
                if cells[row, x] == NOTHING:
                    cells[row, x] = f
            first, last = span(triangle, row + 0.5, row + 0.5)
            if last >= first:  # cells whose centre lies in the face
                for x in range(int(np.ceil(first - 0.5)), int(np.floor(last - 0.5)) + 1):
                    cells[row, x] = f
            first, last = span(triangle, row - _SLACK, row + _SLACK)
            if last < first:
                continue
            for x in range(int(np.ceil(first - _SLACK)), int(np.floor(last + _SLACK)) + 1):
                other = nodes[row, x]
                if other == NOTHING:
                    nodes[row, x] = f
                elif clearly_within(triangle, row, x) and clearly_within(points[other], row, x):
                    overlapping[f] = True
                    overlapping[other] = True


@kernel
def _beside(cells, y, x):
    # A face of one of the cells around a node that a chart touches, or NOTHING. The sheet's last
    # row and column of cells are empty, so that index -1 is valid.
    for dy in range(2):
        for dx in range(2):
            if cells[y - dy, x - dx] != NOTHING:
                return cells[y - dy, x - dx]
    return NOTHING


@kernel
def _mark_ghosts(start, stop, cells, nodes):
    for y in range(start, stop):
        for x in range(nodes.shape[1]):
            if nodes[y, x] == NOTHING and _beside(cells, y, x) != NOTHING:
                nodes[y, x] = _GHOST


@kernel
def ends(points, edge):
    """Row and column of a half-edge's start, then of its end."""
    f, k = divmod(edge, 3)
    return points[f, k, 0], points[f, k, 1], points[f, after(k), 0], points[f, after(k), 1]


@kernel
def place_on_edge(points, edge, share):
    """Row and column of a place on a half-edge."""
    ay, ax, by, bx = ends(points, edge)
    return ay + share * (by - ay), ax + share * (bx - ax)


@kernel
def nearest_on_edge(points, edge, y, x):
    """Share along a half-edge of its point nearest to (y, x), and the squared distance."""
    ay, ax, by, bx = ends(points, edge)
    ey = by - ay
    ex = bx - ax
    dy = y - ay
    dx = x - ax
    length = ey * ey + ex * ex
    share = min(max((dy * ey + dx * ex) / length, 0.0), 1.0) if length > 0 else 0.0
    dy -= share * ey
    dx -= share * ex
    return share, dy * dy + dx * dx


@kernel
def _find_edges(start, stop, borders, points, labels, nodes, cells, nearest, edges):
    # A ghost is a corner of a cell that its chart touches, so it is less than 1.5 texels away.
    reach = 1.5
    rows, columns = nodes.shape
    for edge in borders[start:stop]:
        label = labels[edge // 3]
        ay, ax, by, bx = ends(points, edge)
        first = max(int(np.ceil(min(ay, by) - reach)), 0)
        last = min(int(np.floor(max(ay, by) + reach)), rows - 1)
        for y in range(first, last + 1):
            # Columns of the edge where its row is near y, extended by the reach on both sides.
            a, b = 0.0, 1.0
            if abs(by - ay) > 1e-9:
                a = min(max((y - reach - ay) / (by - ay), 0.0), 1.0)
                b = min(max((y + reach - ay) / (by - ay), 0.0), 1.0)
            one = ax + a * (bx - ax)
            two = ax + b * (bx - ax)
            left = max(int(np.ceil(min(one, two) - reach)), 0)
            right = min(int(np.floor(max(one, two) + reach)), columns - 1)
            for x in range(left, right + 1):
                if nodes[y, x] > _GHOST or labels[_beside(cells, y, x)] != label:
                    continue
                ghost = _GHOST - nodes[y, x]
                _, distance = nearest_on_edge(points, edge, y, x)
                if distance < nearest[ghost]:
                    nearest[ghost] = distance
                    edges[ghost] = edge


@kernel
def shares_of_corners(points, f, y, x):
    """Barycentric coordinates of a place in or near a face, (row, column) in the sheet."""
    ay = points[f, 1, 0] - points[f, 0, 0]
    ax = points[f, 1, 1] - points[f, 0, 1]
    by = points[f, 2, 0] - points[f, 0, 0]
    bx = points[f, 2, 1] - points[f, 0, 1]
    dy = y - points[f, 0, 0]
    dx = x - points[f, 0, 1]
    det = ay * bx - ax * by
    second = min(max((dy * bx - dx * by) / det, 0.0), 1.0) if det != 0 else 0.0
    third = min(max((ay * dx - ax * dy) / det, 0.0), 1.0) if det != 0 else 0.0
    first = max(1.0 - second - third, 0.0)
    total = first + second + third
    return first / total, second / total, third / total
