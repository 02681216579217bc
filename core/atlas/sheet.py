# SPDX-License-Identifier: GPL-3.0-or-later
"""The sheet: a texture's texels laid out so that each node belongs to one chart.

A node is a texel as one chart sees it, and a cell is the square between four nodes. Charts lie
in the sheet as they lie in the image, except those whose nodes touch another chart's, or that
leave the image: these are moved by whole texels to shelves below (paper B, footnote 1). So cells
are found by their place, neighbours are next to each other, and no two charts meet.

A node is *inside* if the texel's centre lies in a face; otherwise it is a *ghost*, which takes
its value from the surface beyond the nearest edge of its chart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..errors import InvalidUV
from ..mesh import Floats, Ints
from ..parallel import Progress, kernel, run
from .charts import Charts

NOTHING = -1
"""In `Sheet.nodes` and `Sheet.cells`: no chart is here."""

ROWS = 32
"""Rows of a sheet that a kernel gets at once."""

CLEARLY = 0.01
"""Deeper in two faces than this, in texels, a texel's centre shows that they overlap."""

_SLACK = 1e-6
_MOST_NODES = 1 << 31


@dataclass(frozen=True)
class Sheet:
    """Where the charts' texels lie in the sheet.

    Attributes
    ----------
    points : (m, 3, 2) float64
        Corners of the faces as (row, column) in the sheet.
    shifts : (charts, 2) int64
        Place in the sheet minus place in the image, for each chart.
    nodes : (rows, columns) int32
        The face in which a node lies; `NOTHING`; or -2 - g for the ghost g.
    cells : (rows, columns) int32
        A face that the cell with this node as its first corner touches, the one at its centre if
        there is one, or `NOTHING`.
    ghosts : (g,) int32
        Row times columns plus column of the ghosts.
    ghost_edges : (g,) int32
        The half-edge nearest to each ghost at which its chart ends.
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


def lay_out(charts: Charts, height: int, width: int, progress: Progress) -> Sheet:
    """Lay the charts of an image of `height` times `width` texels out.

    Raises
    ------
    InvalidUV
        If that takes too many texels.
    """
    low = np.floor(charts.boxes[:, 0] - _SLACK).astype(np.int64)
    high = np.floor(charts.boxes[:, 1] + _SLACK).astype(np.int64) + 1
    away = (low < -1).any(axis=1) | (high > (height, width)).any(axis=1)
    away |= _clashing(charts, away, height, width)
    progress.update(0.2)
    shifts, shape = _shelve(low, high, away, height, width)
    most = min(_MOST_NODES, 64 * height * width + 1024 * charts.count)
    if shape[0] * shape[1] >= most:
        largest = int(np.argmax((high - low).max(axis=1)))
        raise InvalidUV(
            f"Laid out without overlaps, the charts need {shape[1]} x {shape[0]} texels, too many"
            f" for an image of {width} x {height}; the longest chart is that of face"
            f" {int(np.argmax(charts.labels == largest))}. Unwrap the mesh without overlaps."
        )
    points = charts.points + shifts[charts.labels][:, None]
    bands = _face_bands(points)
    nodes = np.full(shape, NOTHING, dtype=np.int32)
    cells = np.full(shape, NOTHING, dtype=np.int32)
    overlapping = np.zeros(len(points), dtype=np.bool_)
    run(_draw_faces, shape[0], points, bands, nodes, cells, overlapping, chunk=ROWS,
        progress=progress.part(0.2, 0.8, "Finding texels"))  # fmt: skip
    counts = np.zeros(shape[0], dtype=np.int64)
    run(_count_ghosts, shape[0], nodes, cells, counts, chunk=ROWS)
    ends = np.cumsum(counts)
    ghosts = np.empty(ends[-1], dtype=np.int32)
    run(_number_ghosts, shape[0], nodes, cells, ends - counts, ghosts, chunk=ROWS)
    edges = np.full(len(ghosts), -1, dtype=np.int32)
    nearest = np.full(len(ghosts), np.inf, dtype=np.float32)
    _find_edges(charts.borders, points, charts.labels, nodes, cells, nearest, edges)
    progress.update(1.0)
    return Sheet(points, shifts, nodes, cells, ghosts, edges, overlapping)


def _clashing(
    charts: Charts, away: npt.NDArray[np.bool_], height: int, width: int
) -> npt.NDArray[np.bool_]:
    # Charts that share a node with one of a lower number.
    claims = np.full((height + 2, width + 2), charts.count, dtype=np.int32)
    points = charts.points + 1.0
    bands = _face_bands(points)
    labels = np.where(away[charts.labels], -1, charts.labels).astype(np.int32)
    clashes = np.zeros(charts.count, dtype=np.bool_)
    for check in (False, True):
        run(_claim, height + 2, points, bands, labels, check, claims, clashes, chunk=ROWS)
    return clashes


def _shelve(
    low: npt.NDArray[np.int64],
    high: npt.NDArray[np.int64],
    away: npt.NDArray[np.bool_],
    height: int,
    width: int,
) -> tuple[npt.NDArray[np.int64], tuple[int, int]]:
    # Shifts of all charts and the size of the sheet; tall charts first, row by row.
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


def _face_bands(points: Floats) -> npt.NDArray[np.int32]:
    # First and last row of cells that each face touches: (m, 2).
    bands = np.empty((len(points), 2), dtype=np.int32)
    bands[:, 0] = np.floor(points[..., 0].min(axis=1) - _SLACK)
    bands[:, 1] = np.floor(points[..., 0].max(axis=1) + _SLACK)
    return bands


@kernel
def span(triangle, low, high):
    """Lowest and highest column of the part of a triangle between two rows."""
    first = np.inf
    last = -np.inf
    for k in range(3):
        y = triangle[k, 0]
        x = triangle[k, 1]
        if low <= y <= high:
            first = min(first, x)
            last = max(last, x)
        after = k + 1 if k < 2 else 0
        next_y = triangle[after, 0]
        slope = triangle[after, 1] - x
        if min(y, next_y) < low < max(y, next_y):
            crossing = x + slope * (low - y) / (next_y - y)
            first = min(first, crossing)
            last = max(last, crossing)
        if min(y, next_y) < high < max(y, next_y):
            crossing = x + slope * (high - y) / (next_y - y)
            first = min(first, crossing)
            last = max(last, crossing)
    return first, last


@kernel
def _claim(start, stop, points, bands, labels, check, claims, clashes):
    # Give each node to the lowest chart that touches it; then mark the other ones.
    for f in range(points.shape[0]):
        label = labels[f]
        if label < 0 or bands[f, 1] + 1 < start or bands[f, 0] >= stop:
            continue
        for row in range(bands[f, 0], bands[f, 1] + 1):
            if row + 1 < start or row >= stop:
                continue
            first, last = span(points[f], row - _SLACK, row + 1 + _SLACK)
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
def depth_within(triangle, y, x):
    """How far a point lies inside a triangle, in texels; negative outside."""
    area = (triangle[1, 1] - triangle[0, 1]) * (triangle[2, 0] - triangle[0, 0])
    area -= (triangle[1, 0] - triangle[0, 0]) * (triangle[2, 1] - triangle[0, 1])
    turn = 1.0 if area > 0 else -1.0
    depth = np.inf
    for k in range(3):
        after = k + 1 if k < 2 else 0
        ey = triangle[after, 0] - triangle[k, 0]
        ex = triangle[after, 1] - triangle[k, 1]
        length = np.sqrt(ey * ey + ex * ex)
        if length == 0:
            return -1.0
        across = ex * (y - triangle[k, 0]) - ey * (x - triangle[k, 1])
        depth = min(depth, turn * across / length)
    return depth


@kernel
def _draw_faces(start, stop, points, bands, nodes, cells, overlapping):
    # Rows start .. stop - 1 of nodes and cells; of several faces, the first one stays.
    for f in range(points.shape[0]):
        if bands[f, 1] < start or bands[f, 0] >= stop:
            continue
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
                elif (
                    depth_within(triangle, row, x) > CLEARLY
                    and depth_within(points[other], row, x) > CLEARLY
                ):
                    overlapping[f] = True
                    overlapping[other] = True


@kernel
def _beside(cells, y, x):
    # One of the cells around a node that a chart touches, as a face, or NOTHING.
    for dy in range(2):
        for dx in range(2):
            if y - dy >= 0 and x - dx >= 0 and cells[y - dy, x - dx] != NOTHING:
                return cells[y - dy, x - dx]
    return NOTHING


@kernel
def _count_ghosts(start, stop, nodes, cells, counts):
    for y in range(start, stop):
        for x in range(nodes.shape[1]):
            if nodes[y, x] == NOTHING and _beside(cells, y, x) != NOTHING:
                counts[y] += 1


@kernel
def _number_ghosts(start, stop, nodes, cells, starts, ghosts):
    for y in range(start, stop):
        number = starts[y]
        for x in range(nodes.shape[1]):
            if nodes[y, x] == NOTHING and _beside(cells, y, x) != NOTHING:
                nodes[y, x] = -2 - number
                ghosts[number] = y * nodes.shape[1] + x
                number += 1


@kernel
def nearest_on_edge(points, edge, y, x):
    """Share along a half-edge of its point nearest to (y, x), and the squared distance."""
    f = edge // 3
    k = edge - 3 * f
    after = k + 1 if k < 2 else 0
    ey = points[f, after, 0] - points[f, k, 0]
    ex = points[f, after, 1] - points[f, k, 1]
    dy = y - points[f, k, 0]
    dx = x - points[f, k, 1]
    length = ey * ey + ex * ex
    share = min(max((dy * ey + dx * ex) / length, 0.0), 1.0) if length > 0 else 0.0
    dy -= share * ey
    dx -= share * ex
    return share, dy * dy + dx * dx


@kernel
def _find_edges(borders, points, labels, nodes, cells, nearest, edges):
    # A ghost is a corner of a cell that its chart touches, so less than 1.5 texels away.
    reach = 1.5
    rows, columns = nodes.shape
    for edge in borders:
        f = edge // 3
        k = edge - 3 * f
        after = k + 1 if k < 2 else 0
        top = min(points[f, k, 0], points[f, after, 0]) - reach
        bottom = max(points[f, k, 0], points[f, after, 0]) + reach
        first = max(int(np.ceil(top)), 0)
        last = min(int(np.floor(bottom)), rows - 1)
        ey = points[f, after, 0] - points[f, k, 0]
        ex = points[f, after, 1] - points[f, k, 1]
        for y in range(first, last + 1):
            # Columns of the edge where its row is near y, on both sides by the reach.
            if abs(ey) > 1e-9:
                a = min(max((y - reach - points[f, k, 0]) / ey, 0.0), 1.0)
                b = min(max((y + reach - points[f, k, 0]) / ey, 0.0), 1.0)
            else:
                a, b = 0.0, 1.0
            one = points[f, k, 1] + a * ex
            two = points[f, k, 1] + b * ex
            left = max(int(np.ceil(min(one, two) - reach)), 0)
            right = min(int(np.floor(max(one, two) + reach)), columns - 1)
            for x in range(left, right + 1):
                if nodes[y, x] > -2 or labels[_beside(cells, y, x)] != labels[f]:
                    continue
                ghost = -2 - nodes[y, x]
                _, distance = nearest_on_edge(points, edge, y, x)
                if distance < nearest[ghost]:
                    nearest[ghost] = distance
                    edges[ghost] = edge
