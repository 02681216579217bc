# SPDX-License-Identifier: GPL-3.0-or-later
"""Patches: the surroundings of a tile of a chart, continued on the surface beyond its seams.

A patch is a grid that extends the chart's texels. Each place beyond a seam holds the texel nearest
to the end of a straight walk from the chart's nearest edge. Texels are not interpolated there, so
that noise is as strong as inside the chart. Around a corner of a chart where the surface does not
unfold, some texels occur twice or not at all.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel
from ..base.vectors import after
from ..mesh.triangle_mesh import Floats, Ints
from .atlas import TextureAtlas
from .ghosts import walk_beyond
from .metric import AtlasMetric, is_closed, store
from .sheet import NOTHING, Sheet, ends, nearest_on_edge, shares_of_corners


class Surface(NamedTuple):
    """The data that patches are made from.

    Attributes
    ----------
    sheet : Sheet
    labels : (m,) int32
        The chart of each face.
    metric : AtlasMetric
    known : (g,) bool
        Ghosts of the sheet that have a value.
    vertices : (n, 3) float64
        Positions in space, in mean texel sizes.
    faces : (m, 3) int32
    """

    sheet: Sheet
    labels: Ints
    metric: AtlasMetric
    known: npt.NDArray[np.bool_]
    vertices: Floats
    faces: Ints


class Tiles(NamedTuple):
    """The sheet cut into squares, numbered row by row.

    Attributes
    ----------
    size : int
        Texels along a side.
    columns : int
        Squares in a row.
    reach : int
        Most texels that patches extend beyond their tile.
    starts : (tiles + 1,) int64
    edges : (k,) int32
        Half-edges on outlines of charts within reach of each tile:
        ``edges[starts[tile]:starts[tile + 1]]``.
    """

    size: int
    columns: int
    reach: int
    starts: npt.NDArray[np.int64]
    edges: Ints


class Patch(NamedTuple):
    """A chart's surroundings of a tile.

    Attributes
    ----------
    nodes : (h, w) int64
        The texel at each place: row times columns plus column in the sheet; -1: none.
    points : (h, w, 3) float32
        Position in space, in mean texel sizes; NaN where there is no texel.
    sizes : (h, w) float32
        Length of this chart's texels there, the root of their area, in mean texel sizes.
    turns : (h, w, 2, 2) float32
        Rotation of tangent-space normals from the texel's chart to this one; empty if not asked
        for.
    """

    nodes: npt.NDArray[np.int64]
    points: npt.NDArray[np.float32]
    sizes: npt.NDArray[np.float32]
    turns: npt.NDArray[np.float32]


def surface_of(atlas: TextureAtlas) -> Surface:
    """Gather the data that patches of an atlas are made from."""
    mesh = atlas.mesh
    vertices = mesh.scaled_vertices * (mesh.mean_edge_length / atlas.texel_size)
    known = atlas.sources.cells >= 0
    return Surface(atlas.sheet, atlas.charts.labels, atlas.metric, known, vertices, mesh.faces)


def cut_tiles(atlas: TextureAtlas, size: int, reach: int) -> Tiles:
    """Cut an atlas's sheet into tiles, each with the half-edges within its reach."""
    rows, columns = (-(-length // size) for length in atlas.sheet.nodes.shape)
    borders = atlas.charts.borders
    face, k = np.divmod(borders, 3)
    sides = np.stack([atlas.sheet.points[face, k], atlas.sheet.points[face, (k + 1) % 3]])
    first = np.floor((sides.min(axis=0) - reach) / size).astype(np.int64)
    last = np.floor((sides.max(axis=0) + reach) / size).astype(np.int64)
    first, last = np.maximum(first, 0), np.minimum(last, (rows - 1, columns - 1))
    down, across = np.maximum(last - first + 1, 0).T
    # One entry for each pair of an edge and a tile near it.
    near = down * across
    edge = np.repeat(np.arange(len(borders)), near)
    number = np.arange(len(edge)) - np.repeat(np.cumsum(near) - near, near)
    row, column = np.divmod(number, across[edge])
    tile = (first[edge, 0] + row) * columns + first[edge, 1] + column
    counts = np.bincount(tile, minlength=rows * columns)
    starts = np.concatenate([[0], np.cumsum(counts)])
    return Tiles(size, columns, reach, starts, borders[edge[np.argsort(tile, kind="stable")]])


@kernel
def next_chart(surface, tiles, tile, skipped, last, box):
    """Find the first chart after `last` that has nodes in a tile which are not `skipped`.

    Parameters
    ----------
    skipped : (rows, columns) bool
    box : (2, 2) int64
        Receives the first row and column of these nodes, and the ends of their ranges.

    Returns
    -------
    int
        The chart, or -1.
    """
    nodes, labels = surface.sheet.nodes, surface.labels
    down, across = divmod(tile, tiles.columns)
    chart = -1
    for y in range(down * tiles.size, min((down + 1) * tiles.size, nodes.shape[0])):
        for x in range(across * tiles.size, min((across + 1) * tiles.size, nodes.shape[1])):
            if nodes[y, x] < 0 or skipped[y, x]:
                continue
            label = labels[nodes[y, x]]
            if label <= last or (chart >= 0 and label > chart):
                continue
            if label != chart:
                chart = label
                box[0, 0], box[0, 1] = y, x
                box[1, 0], box[1, 1] = y + 1, x + 1
            box[0, 1] = min(box[0, 1], x)
            box[1, 0] = y + 1
            box[1, 1] = max(box[1, 1], x + 1)
    return chart


@kernel
def stretch_around(surface, tiles, chart, box):
    """Return the most texels per unit length of a chart around a box, at least 1."""
    nodes, labels = surface.sheet.nodes, surface.labels
    rows, columns = nodes.shape
    most = 1.0
    before = -1
    for y in range(max(box[0, 0] - tiles.reach, 0), min(box[1, 0] + tiles.reach, rows)):
        for x in range(max(box[0, 1] - tiles.reach, 0), min(box[1, 1] + tiles.reach, columns)):
            face = nodes[y, x]
            if face < 0 or face == before or labels[face] != chart:
                continue
            before = face
            area = float(surface.metric.texel_areas[face])
            metric = surface.metric.inverse_metrics[face]
            mean = 0.5 * area * (float(metric[0]) + metric[2])
            half = 0.5 * area * (float(metric[0]) - metric[2])
            across = area * metric[1]
            most = max(most, mean + np.sqrt(half * half + across * across))
    return np.sqrt(most)


@kernel
def lay_patch(surface, tiles, tile, chart, box, margin, normals):
    """Lay out the surroundings of a tile for a chart.

    Parameters
    ----------
    surface : Surface
    tiles : Tiles
    tile, chart : int
    box : (2, 2) int64
        See `next_chart`.
    margin : int
        By how many texels the patch extends beyond the box.
    normals : bool
        Whether `turns` are computed.

    Returns
    -------
    Patch
    """
    sheet, labels = surface.sheet, surface.labels
    nodes = sheet.nodes
    rows, columns = nodes.shape
    top, left = box[0, 0] - margin, box[0, 1] - margin
    height, width = box[1, 0] + margin - top, box[1, 1] + margin - left
    patch = Patch(
        np.full((height, width), -1, np.int64),
        np.full((height, width, 3), np.nan, np.float32),
        np.zeros((height, width), np.float32),
        np.zeros((height if normals else 0, width, 2, 2), np.float32),
    )
    origin = np.zeros(3)
    empty = True
    for i in range(max(-top, 0), min(rows - top, height)):
        for j in range(max(-left, 0), min(columns - left, width)):
            face = nodes[top + i, left + j]
            if face < 0 or labels[face] != chart:
                continue
            if empty:
                origin[:] = surface.vertices[surface.faces[face, 0]]
                empty = False
            shares = shares_of_corners(sheet.points, face, top + i, left + j)
            _set_point(surface, face, shares, origin, patch.points[i, j])
            patch.nodes[i, j] = (top + i) * columns + left + j
            patch.sizes[i, j] = _size(surface.metric, face)
            if normals:
                store(patch.turns[i, j], 1.0, 0.0, 0.0, 1.0)
    edges = np.full((height, width), -1, np.int32)
    squares = np.full((height, width), np.float32(margin * margin + 1e-3), np.float32)
    for edge in tiles.edges[tiles.starts[tile] : tiles.starts[tile + 1]]:
        if labels[edge // 3] == chart:
            _offer(sheet.points, edge, top, left, margin, patch.nodes, squares, edges)
    b = np.empty(3)
    rotation = np.empty((2, 2))
    for i in range(height):
        for j in range(width):
            if edges[i, j] >= 0:
                _look_beyond(surface, edges[i, j], top, left, i, j, origin, b, rotation, patch)
    return patch


@kernel
def _size(metric, face):
    area = metric.texel_areas[face]
    return np.sqrt(area) if area > 0 else np.float32(1.0)


@kernel
def _set_point(surface, face, shares, origin, point):
    for c in range(3):
        place = -origin[c]
        for k in range(3):
            place += shares[k] * surface.vertices[surface.faces[face, k], c]
        point[c] = place


@kernel
def _offer(points, edge, top, left, margin, nodes, squares, edges):
    # Offers a half-edge to the places within the margin that are outside the chart.
    height, width = nodes.shape
    ay, ax, by, bx = ends(points, edge)
    ay -= top
    by -= top
    ax -= left
    bx -= left
    first = max(int(np.ceil(min(ay, by) - margin)), 0)
    last = min(int(np.floor(max(ay, by) + margin)), height - 1)
    for i in range(first, last + 1):
        # Columns of the edge where its row is near i, extended by the margin on both sides.
        start, stop = 0.0, 1.0
        if abs(by - ay) > 1e-9:
            one = (i - margin - ay) / (by - ay)
            other = (i + margin - ay) / (by - ay)
            start = min(max(min(one, other), 0.0), 1.0)
            stop = min(max(max(one, other), 0.0), 1.0)
        one = ax + start * (bx - ax)
        other = ax + stop * (bx - ax)
        low = max(int(np.ceil(min(one, other) - margin)), 0)
        high = min(int(np.floor(max(one, other) + margin)), width - 1)
        for j in range(low, high + 1):
            if nodes[i, j] >= 0:
                continue
            _, square = nearest_on_edge(points, edge, float(top + i), float(left + j))
            if square < squares[i, j]:
                squares[i, j] = square
                edges[i, j] = edge


@kernel
def _look_beyond(surface, edge, top, left, i, j, origin, b, rotation, patch):
    # Finds the texel of a place beyond a seam; none if the surface ends before it.
    sheet, metric = surface.sheet, surface.metric
    face, row, column, _, _ = walk_beyond(
        sheet.points, metric.ways, metric.shapes, metric.jacobians, edge,
        float(top + i), float(left + j), b, rotation,
    )  # fmt: skip
    if face < 0 or _is_at_end(metric.ways, face, b):
        return
    node = _nearest_node(surface, surface.labels[face], row, column)
    if node < 0:
        return
    patch.nodes[i, j] = node
    patch.sizes[i, j] = _size(metric, edge // 3)
    _set_point(surface, face, (b[0], b[1], b[2]), origin, patch.points[i, j])
    if patch.turns.shape[0] > 0:
        patch.turns[i, j] = rotation


@kernel
def _is_at_end(ways, face, b):
    # Whether a walk ended early: on a side of a face beyond which the surface ends.
    for corner in range(3):
        side = after(corner)
        if b[corner] == 0.0 and (
            ways.twins[face, side] < 0 or is_closed(ways, 3 * face + side, b[after(side)])
        ):
            return True
    return False


@kernel
def _nearest_node(surface, chart, row, column):
    # The node nearest to a place in the sheet: one inside the chart if there is any, otherwise a
    # ghost with a value; -1 if there is neither.
    nodes = surface.sheet.nodes
    best = np.inf
    found = -1
    for corner in range(4):
        y = int(row) + (corner >> 1)
        x = int(column) + (corner & 1)
        square = (row - y) ** 2 + (column - x) ** 2
        if nodes[y, x] == NOTHING:
            continue
        if nodes[y, x] < NOTHING:
            if not surface.known[-2 - nodes[y, x]]:
                continue
            square += 4.0
        elif surface.labels[nodes[y, x]] != chart:
            continue
        if square < best:
            best = square
            found = y * nodes.shape[1] + x
    return found
