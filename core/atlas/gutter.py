# SPDX-License-Identifier: GPL-3.0-or-later
"""The gutter: texels around the charts, filled by walking across the nearest seam."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.ndimage import distance_transform_edt

from ..parallel import Progress, kernel, run
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
    progress: Progress,
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
    """
    sheet, surface = atlas.sheet, atlas.surface
    rounded = out.dtype.kind in "ui"
    kept = np.zeros((0, 0), dtype=np.bool_) if keep is None else keep & atlas.inside
    run(_write_owned, atlas.height, atlas.owners, values.reshape(-1, values.shape[2]), scale,
        rounded, kept, out, chunk=ROWS)  # fmt: skip
    filled = atlas.owners != NOTHING
    if not filled.all():
        radius = max(float(settings.gutter), _LEAST)
        edges, squares = atlas.nearest_borders(filled, radius)
        run(_write_gutter, atlas.height, edges, squares, filled, radius,
            atlas.charts.labels, sheet.shifts, sheet.nodes,
            sheet.cells, atlas.sources.cells, surface.points, surface.twins, surface.shapes,
            surface.to_frame, values, scale, rounded, out, chunk=ROWS,
            progress=progress)  # fmt: skip
    if settings.background == "nearest" and filled.any() and not filled.all():
        rows, columns = distance_transform_edt(~filled, return_distances=False, return_indices=True)
        out[~filled] = out[rows[~filled], columns[~filled]]
    progress.update(1.0)


@kernel
def _store(value, scale, rounded):
    value *= scale
    return np.floor(min(max(value, 0.0), scale) + 0.5) if rounded else value


@kernel
def _write_owned(start, stop, owners, values, scale, rounded, kept, out):
    for y in range(start, stop):
        for x in range(owners.shape[1]):
            node = owners[y, x]
            if node != NOTHING and not (kept.size > 0 and kept[y, x]):
                for c in range(out.shape[2]):
                    out[y, x, c] = _store(values[node, c], scale, rounded)


@kernel
def _write_gutter(
    start, stop, edges, squares, filled, radius, labels, shifts, nodes, cells, sources, points,
    twins, shapes, to_frame, values, scale, rounded, out,
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
            there = float(y + shifts[labels[f], 0])
            across = float(x + shifts[labels[f], 1])
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
                for c in range(out.shape[2]):
                    out[y, x, c] = _store(total[c] / weight, scale, rounded)
