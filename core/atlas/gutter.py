# SPDX-License-Identifier: GPL-3.0-or-later
"""The gutter: texels around the charts, filled by walking across the nearest seam."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.ndimage import distance_transform_edt

from ..base.parallel import Progress, kernel, run, run_in_order
from ..mesh.triangle_mesh import Ints
from ..settings import DilateSettings
from .atlas import TextureAtlas
from .ghosts import beyond
from .sheet import NOTHING, ROWS, nearest_on_edge

_LEAST = 1.5
"""Linear sampling reads texels this far from a chart."""


def write_texels(
    atlas: TextureAtlas,
    values: npt.NDArray[np.float32],
    scale: float,
    settings: DilateSettings,
    keep: npt.NDArray[np.bool_] | None,
    out: npt.NDArray,
    progress: Progress = Progress(None),
    *,
    opacity: int = -1,
    normals: bool = False,
) -> None:
    """Write the values of a sheet into an image: charts, gutter and background.

    Parameters
    ----------
    values : (rows, columns, c) float32
        Values of nodes and ghosts.
    scale : float
        What makes 1 of the image's white; whole numbers are rounded.
    settings : DilateSettings
    keep : (h, w) bool, optional
        Texels inside charts that are left as they are.
    out : (h, w, c) array
        Overwritten where there is something to write.
    opacity : int
        A channel that is left as it is inside charts; -1: none.
    normals : bool
        The values are colors of tangent-space normals, which turn across seams.
    """
    sheet, surface = atlas.sheet, atlas.surface
    rounded = out.dtype.kind in "ui"
    inside = atlas.inside
    kept = np.zeros((0, 0), dtype=np.bool_) if keep is None else keep & inside
    run(_write_owned, atlas.height, atlas.owners, inside, values.reshape(-1, values.shape[2]),
        scale, rounded, kept, opacity, out, chunk=ROWS,
        progress=progress.part(0.0, 0.4, "Filling the gutter"))  # fmt: skip
    filled = atlas.owners != NOTHING
    if not filled.all():
        radius = max(float(settings.gutter), _LEAST)
        around = _leave_image(atlas)
        edges, squares = _nearest_borders(
            atlas, around, filled, radius, progress.part(0.4, 0.8, "Filling the gutter")
        )
        run(_write_gutter, atlas.height, edges, squares, filled, radius, atlas.charts.points,
            around, atlas.charts.labels, sheet.shifts, sheet.nodes, sheet.cells,
            atlas.sources.cells,
            surface.points, surface.twins, surface.shapes, surface.to_frame, values, normals, scale,
            rounded, out, chunk=ROWS,
            progress=progress.part(0.8, 1.0, "Filling the gutter"))  # fmt: skip
    if settings.background == "nearest" and filled.any() and not filled.all():
        rows, columns = distance_transform_edt(~filled, return_distances=False, return_indices=True)
        out[~filled] = out[rows[~filled], columns[~filled]]
    progress.update(1.0)


def _leave_image(atlas: TextureAtlas) -> npt.NDArray[np.bool_]:
    # Faces whose chart goes on around the rim of the image, which repeats.
    boxes, rim = atlas.charts.boxes + 0.5, np.array([atlas.height, atlas.width])
    leaves = (boxes[:, 0] < -1e-6).any(axis=1) | (boxes[:, 1] > rim + 1e-6).any(axis=1)
    return leaves[atlas.charts.labels]


def _nearest_borders(
    atlas: TextureAtlas,
    around: npt.NDArray[np.bool_],
    filled: npt.NDArray[np.bool_],
    reach: float,
    progress: Progress = Progress(None),
) -> tuple[Ints, npt.NDArray[np.float32]]:
    # The half-edge of a chart's end nearest to each texel that is not filled, -1 where none is
    # in reach, and the squared distance.
    points = atlas.charts.points
    edges = np.full(filled.shape, -1, dtype=np.int32)
    squares = np.full(filled.shape, np.inf, dtype=np.float32)
    borders = atlas.charts.borders
    run_in_order(_seed_borders, len(borders), borders, points, around, edges, squares,
                 progress=progress.part(0.0, 0.2, "Filling the gutter"))  # fmt: skip
    for backwards in (False, True):
        run_in_order(_spread_borders, len(filled), backwards, points, around, filled,
                     (reach + 1.5) ** 2, edges, squares, chunk=ROWS,
                     progress=progress.part(0.6 if backwards else 0.2, 1.0 if backwards else 0.6,
                                            "Filling the gutter"))  # fmt: skip
    return edges, squares


@kernel
def _beside(points, around, edge, y, x, height, width):
    # The place of texel (y, x), that nearest to a half-edge if its chart leaves the image, which
    # repeats there.
    f = edge // 3
    if not around[f]:
        return float(y), float(x)
    k = edge - 3 * f
    after = k + 1 if k < 2 else 0
    middle = 0.5 * (points[f, k, 0] + points[f, after, 0])
    centre = 0.5 * (points[f, k, 1] + points[f, after, 1])
    return y + height * np.rint((middle - y) / height), x + width * np.rint((centre - x) / width)


@kernel
def _offer(points, around, edge, y, x, edges, squares):
    there, across = _beside(points, around, edge, y, x, squares.shape[0], squares.shape[1])
    _, square = nearest_on_edge(points, edge, there, across)
    if square < squares[y, x]:
        squares[y, x] = square
        edges[y, x] = edge


@kernel
def _seed_borders(start, stop, borders, points, around, edges, squares):
    height, width = edges.shape
    for edge in borders[start:stop]:
        f = edge // 3
        k = edge - 3 * f
        after = k + 1 if k < 2 else 0
        ay, ax = points[f, k, 0], points[f, k, 1]
        by, bx = points[f, after, 0], points[f, after, 1]
        steps = int(np.ceil(max(abs(by - ay), abs(bx - ax)))) + 1
        for step in range(steps + 1):
            y = int(np.floor(ay + (by - ay) * step / steps))
            x = int(np.floor(ax + (bx - ax) * step / steps))
            for dy in range(2):
                for dx in range(2):
                    row, column = (y + dy) % height, (x + dx) % width
                    if around[f] or (row == y + dy and column == x + dx):
                        _offer(points, around, edge, row, column, edges, squares)


@kernel
def _spread_borders(start, stop, backwards, points, around, filled, most, edges, squares):
    # A sweep over the image, down or up; each texel is offered what its neighbours found.
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
                        _offer(points, around, edges[back, side], y, x, edges, squares)
        for x in range(1, width):
            if not filled[y, x] and squares[y, x - 1] < most:
                _offer(points, around, edges[y, x - 1], y, x, edges, squares)
        for j in range(1, width):
            x = width - 1 - j
            if not filled[y, x] and squares[y, x + 1] < most:
                _offer(points, around, edges[y, x + 1], y, x, edges, squares)


@kernel
def _store(value, scale, rounded):
    value *= scale
    return np.floor(min(max(value, 0.0), scale) + 0.5) if rounded else value


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
def _write_owned(start, stop, owners, inside, values, scale, rounded, kept, opacity, out):
    for y in range(start, stop):
        for x in range(owners.shape[1]):
            node = owners[y, x]
            if node != NOTHING and not (kept.size > 0 and kept[y, x]):
                for c in range(out.shape[2]):
                    if c != opacity or not inside[y, x]:
                        out[y, x, c] = _store(values[node, c], scale, rounded)


@kernel
def _write_gutter(
    start, stop, edges, squares, filled, radius, places, around, labels, shifts, nodes, cells,
    sources, points, twins, shapes, to_frame, values, normals, scale, rounded, out,
):  # fmt: skip
    b = np.empty(3)
    turn = np.empty((2, 2))
    total = np.empty(out.shape[2])
    for y in range(start, stop):
        for x in range(edges.shape[1]):
            edge = edges[y, x]
            if filled[y, x] or edge < 0 or squares[y, x] > radius * radius:
                continue
            f = edge // 3
            k = edge - 3 * f
            there, across = _beside(places, around, edge, y, x, edges.shape[0], edges.shape[1])
            there += shifts[labels[f], 0]
            across += shifts[labels[f], 1]
            face, row, column, _, _ = beyond(
                points, twins, shapes, to_frame, edge, there, across, cells, b, turn
            )
            if face < 0:  # the surface ends: the nearest value on its border
                share, _ = nearest_on_edge(points, edge, there, across)
                after = k + 1 if k < 2 else 0
                row = points[f, k, 0] + share * (points[f, after, 0] - points[f, k, 0])
                column = points[f, k, 1] + share * (points[f, after, 1] - points[f, k, 1])
            weight = 0.0
            total[:] = 0.0
            first = int(row)
            left = int(column)
            for corner in range(4):
                i = first + (corner >> 1)
                j = left + (corner & 1)
                node = nodes[i, j]
                if node == NOTHING or (node < 0 and sources[-2 - node] < 0):
                    continue
                part = row - first if corner >> 1 else 1.0 - (row - first)
                part *= column - left if corner & 1 else 1.0 - (column - left)
                weight += part
                for c in range(out.shape[2]):
                    total[c] += part * values[i, j, c]
            if weight > 1e-6:
                filled[y, x] = True
                total /= weight
                if normals:
                    if face >= 0:
                        p = total[0] - 0.5
                        q = total[1] - 0.5
                        total[0] = 0.5 + turn[0, 0] * p + turn[0, 1] * q
                        total[1] = 0.5 + turn[1, 0] * p + turn[1, 1] * q
                    unit_normal(total)
                for c in range(out.shape[2]):
                    out[y, x, c] = _store(total[c], scale, rounded)
