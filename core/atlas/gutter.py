# SPDX-License-Identifier: GPL-3.0-or-later
"""The gutter: texels around the charts, filled by walking across the nearest seam."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.ndimage import distance_transform_edt

from ..base.checks import SCALES
from ..base.parallel import kernel, run, run_in_order
from ..base.progress import phase
from ..mesh.triangle_mesh import Ints
from ..settings import DilateSettings
from .atlas import TextureAtlas
from .ghosts import interpolate, place_beyond, turn_direction
from .sheet import NOTHING, ROWS, ends, nearest_on_edge, place_on_edge

_LEAST = 1.5
"""Linear sampling reads texels this far from a chart."""

_LITTLE = 1e-6  # weight of known values below which a texel of the gutter is left as it is


class _Borders(NamedTuple):
    # The half-edge of a chart's end nearest to each texel without an owner, -1 where none is in
    # reach, and the squared distance: (h, w). And which faces' charts go on around the rim of the
    # image, which repeats: (m,) bool.
    edges: Ints
    squares: npt.NDArray[np.float32]
    around: npt.NDArray[np.bool_]


class _Coding(NamedTuple):
    # How values are kept in the image: `scale` is 1 of the sheet's, and `rounded` to whole numbers
    # or not; or as colors of tangent-space normals, which turn across seams.
    scale: float
    rounded: bool
    normals: bool


def write_texels(
    atlas: TextureAtlas,
    values: npt.NDArray[np.float32],
    settings: DilateSettings,
    keep: npt.NDArray[np.bool_] | None,
    out: npt.NDArray,
    *,
    opacity: int = -1,
    normals: bool = False,
) -> None:
    """Write the values of a sheet into an image: charts, gutter and background.

    Parameters
    ----------
    values : (rows, columns, c) float32
        Values of nodes and ghosts.
    settings : DilateSettings
    keep : (h, w) bool, optional
        Texels inside charts that are left as they are.
    out : (h, w, c) array
        Overwritten where there is something to write; whole numbers are rounded.
    opacity : int
        A channel that is left as it is inside charts; -1: none.
    normals : bool
        The values are colors of tangent-space normals, which turn across seams.
    """
    coding = _Coding(1.0 / SCALES[out.dtype.name], out.dtype.kind == "u", normals)
    flat = values.reshape(-1, values.shape[2])
    inside = atlas.inside
    kept = np.zeros(inside.shape, dtype=np.bool_) if keep is None else keep & inside
    with phase(0.0, 0.4, "Filling the gutter"):
        run(_write_owned, atlas.height, atlas.owners, inside, flat, coding, kept, opacity, out,
            chunk=ROWS)  # fmt: skip
    filled = atlas.owners != NOTHING
    if not filled.all():
        radius = max(float(settings.gutter), _LEAST)
        with phase(0.4, 0.8, "Filling the gutter"):
            borders = _nearest_borders(atlas, filled, radius)
        with phase(0.8, 1.0, "Filling the gutter"):
            run(_write_gutter, atlas.height, borders, filled, radius, atlas.charts, atlas.sheet,
                atlas.metric, atlas.sources.cells >= 0, flat, coding, out, chunk=ROWS)  # fmt: skip
    if settings.background == "nearest" and filled.any() and not filled.all():
        rows, columns = distance_transform_edt(~filled, return_distances=False, return_indices=True)
        out[~filled] = out[rows[~filled], columns[~filled]]


def _nearest_borders(atlas: TextureAtlas, filled: npt.NDArray[np.bool_], reach: float) -> _Borders:
    charts = atlas.charts
    boxes, rim = charts.boxes + 0.5, np.array([atlas.height, atlas.width])
    leaves = (boxes[:, 0] < -1e-6).any(axis=1) | (boxes[:, 1] > rim + 1e-6).any(axis=1)
    found = _Borders(
        np.full(filled.shape, -1, dtype=np.int32),
        np.full(filled.shape, np.inf, dtype=np.float32),
        leaves[charts.labels],
    )
    with phase(0.0, 0.2, "Filling the gutter"):
        run_in_order(_seed_borders, len(charts.borders), charts.borders, charts.points, found)
    for backwards in (False, True):
        with phase(0.2 + 0.4 * backwards, 0.6 + 0.4 * backwards, "Filling the gutter"):
            run_in_order(_spread_borders, len(filled), backwards, charts.points, filled,
                         (reach + 1.5) ** 2, found, chunk=ROWS)  # fmt: skip
    return found


@kernel
def _beside(points, around, edge, y, x, height, width):
    # The place of texel (y, x), that nearest to a half-edge if its chart leaves the image, which
    # repeats there.
    if not around[edge // 3]:
        return float(y), float(x)
    ay, ax, by, bx = ends(points, edge)
    up, left = 0.5 * (ay + by) - y, 0.5 * (ax + bx) - x
    return y + height * np.rint(up / height), x + width * np.rint(left / width)


@kernel
def _offer(points, found, edge, y, x):
    height, width = found.squares.shape
    there, across = _beside(points, found.around, edge, y, x, height, width)
    _, square = nearest_on_edge(points, edge, there, across)
    if square < found.squares[y, x]:
        found.squares[y, x] = square
        found.edges[y, x] = edge


@kernel
def _seed_borders(start, stop, borders, points, found):
    height, width = found.edges.shape
    for edge in borders[start:stop]:
        ay, ax, by, bx = ends(points, edge)
        steps = int(np.ceil(max(abs(by - ay), abs(bx - ax)))) + 1
        for step in range(steps + 1):
            y = int(np.floor(ay + (by - ay) * step / steps))
            x = int(np.floor(ax + (bx - ax) * step / steps))
            for dy in range(2):
                for dx in range(2):
                    row, column = (y + dy) % height, (x + dx) % width
                    if found.around[edge // 3] or (row == y + dy and column == x + dx):
                        _offer(points, found, edge, row, column)


@kernel
def _spread_borders(start, stop, backwards, points, filled, most, found):
    # A sweep over the image, down or up; each texel is offered what its neighbours found.
    edges, squares = found.edges, found.squares
    height, width = edges.shape
    for i in range(start, stop):
        y = height - 1 - i if backwards else i
        back = y + 1 if backwards else y - 1
        if 0 <= back < height:
            for x in range(width):
                if filled[y, x]:
                    continue
                for side in range(max(x - 1, 0), min(x + 2, width)):
                    if squares[back, side] < most:
                        _offer(points, found, edges[back, side], y, x)
        for x in range(1, width):
            if not filled[y, x] and squares[y, x - 1] < most:
                _offer(points, found, edges[y, x - 1], y, x)
        for x in range(width - 2, -1, -1):
            if not filled[y, x] and squares[y, x + 1] < most:
                _offer(points, found, edges[y, x + 1], y, x)


@kernel
def _coded(value, coding):
    value *= coding.scale
    if coding.rounded:
        return np.floor(min(max(value, 0.0), coding.scale) + 0.5)
    return value


@kernel
def unit_normal(color):
    """Make the normal n of a color (n + 1) / 2 unit length, in place."""
    square = (color[0] - 0.5) ** 2 + (color[1] - 0.5) ** 2 + (color[2] - 0.5) ** 2
    if square > 1e-6:
        for c in range(3):
            color[c] = 0.5 + (color[c] - 0.5) * 0.5 / np.sqrt(square)


@kernel
def unit_normals(start, stop, values):
    """Make normals of a sheet unit length."""
    for y in range(start, stop):
        for x in range(values.shape[1]):
            unit_normal(values[y, x])


@kernel
def _write_owned(start, stop, owners, inside, values, coding, kept, opacity, out):
    for y in range(start, stop):
        for x in range(owners.shape[1]):
            node = owners[y, x]
            if node != NOTHING and not kept[y, x]:
                for c in range(out.shape[2]):
                    if c != opacity or not inside[y, x]:
                        out[y, x, c] = _coded(values[node, c], coding)


@kernel
def _write_gutter(
    start, stop, borders, filled, radius, charts, sheet, metric, known, values, coding, out
):
    height, width = filled.shape
    nodes, points, cells = sheet.nodes, sheet.points, sheet.cells
    ways, shapes, jacobians = metric.ways, metric.shapes, metric.jacobians
    b = np.empty(3)
    turn = np.empty((2, 2))
    color = np.empty(out.shape[2])
    for y in range(start, stop):
        for x in range(width):
            edge = borders.edges[y, x]
            if filled[y, x] or edge < 0 or borders.squares[y, x] > radius * radius:
                continue
            label = charts.labels[edge // 3]
            there, across = _beside(charts.points, borders.around, edge, y, x, height, width)
            there += sheet.shifts[label, 0]
            across += sheet.shifts[label, 1]
            face, row, column, _, _ = place_beyond(
                points, ways, shapes, jacobians, cells, edge, there, across, b, turn
            )
            if face < 0:  # the surface ends: the nearest value on its border
                share, _ = nearest_on_edge(points, edge, there, across)
                row, column = place_on_edge(points, edge, share)
            cell = int(row) * nodes.shape[1] + int(column)
            down, across = row - int(row), column - int(column)
            color[:] = 0.0
            if interpolate(nodes, known, values, cell, down, across, -1, color) <= _LITTLE:
                continue
            filled[y, x] = True
            if coding.normals:
                if face >= 0:
                    turn_direction(turn, color, 0.5)
                unit_normal(color)
            for c in range(out.shape[2]):
                out[y, x, c] = _coded(color[c], coding)
