# SPDX-License-Identifier: GPL-3.0-or-later
"""The gutter: texels around the charts, filled from the surface across the nearest seam."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.checks import SCALES
from ..base.parallel import kernel, run, run_in_order
from ..base.progress import phase
from ..grid.nearest import nearest_marked
from ..mesh.triangle_mesh import Ints
from ..settings import DilateSettings
from .atlas import TextureAtlas
from .ghosts import interpolate, nearest_in_cells, nearest_nodes, place_beyond, turn_direction
from .normal_frames import NormalFrames, axes_at, into_frame
from .sheet import NOTHING, ROWS, ends, nearest_on_edge, place_on_edge

_LEAST = 1.5
"""Linear sampling reads texels up to this distance from a chart."""

_LITTLE = 1e-6  # texels of the gutter with a smaller weight of known values are not written


class _Borders(NamedTuple):
    # For each texel without an owner, the nearest half-edge on a chart's outline, -1 if none is
    # within reach, and its squared distance: (h, w). And the faces whose charts cross the rim of
    # the image, which repeats: (m,) bool.
    edges: Ints
    squares: npt.NDArray[np.float32]
    around: npt.NDArray[np.bool_]


class _Coding(NamedTuple):
    # How values are stored in the image: white is `scale`, `rounded` to whole numbers or not; as
    # colors of tangent-space normals, which rotate across seams, or as such normals converted
    # from object space.
    scale: float
    rounded: bool
    normals: bool
    from_object: bool


class _Gutter(NamedTuple):
    # Where the values of texels beside charts are interpolated: row times width plus column of the
    # texels; row times columns plus column of cells; (down, across) in these; and the rotations of
    # normals across the seam, (g, 2, 2), or the axes of their own chart there, (g, 3, 3).
    texels: npt.NDArray[np.int64]
    cells: Ints
    places: npt.NDArray[np.float32]
    rotations: npt.NDArray[np.float32]


class TexelWriter:
    """Writes the values of a sheet to an image: charts, gutter and background.

    Parameters
    ----------
    atlas : TextureAtlas
    settings : DilateSettings
    normals : bool
        The values are colors of tangent-space normals, which rotate across seams.
    frames : NormalFrames, optional
        The values are colors of object-space normals, and the image receives tangent-space ones.
    made : bool
        The image held nothing before. Otherwise charts in which no texel's centre lies keep what
        they read, see `TextureAtlas.lone`.
    """

    def __init__(
        self,
        atlas: TextureAtlas,
        settings: DilateSettings,
        *,
        normals: bool = False,
        frames: NormalFrames | None = None,
        made: bool = False,
    ) -> None:
        self._atlas = atlas
        self._normals, self._frames = normals, frames
        self._known = atlas.sources.cells >= 0
        filled = atlas.owners != NOTHING
        self._lone = None if made else atlas.lone != NOTHING
        if self._lone is not None:
            filled |= self._lone
        self._gutter = _find_gutter(atlas, filled, max(float(settings.gutter), _LEAST), normals,
                                    frames, made)  # fmt: skip
        self._beyond = np.zeros((2, 0), dtype=np.int64)
        if settings.background == "nearest":
            filled.reshape(-1)[self._gutter.texels] = True
            if atlas.inside.any() and not filled.all():
                self._beyond = _nearest_filled(filled)

    def write(
        self,
        values: npt.NDArray[np.float32],
        keep: npt.NDArray[np.bool_] | None,
        out: npt.NDArray,
        *,
        opacity: int = -1,
    ) -> None:
        """Write the values of a sheet to an image.

        Parameters
        ----------
        values : (rows, columns, c) float32
            Values of nodes and ghosts. With frames, they are converted in place.
        keep : (h, w) bool, optional
            Texels inside charts that are not written.
        out : (h, w, c) array, contiguous
            Overwritten where there are values; whole numbers are rounded.
        opacity : int
            A channel that is not written inside charts; -1: none.
        """
        atlas = self._atlas
        scale, from_object = 1.0 / SCALES[out.dtype.name], self._frames is not None
        coding = _Coding(scale, out.dtype.kind == "u", self._normals, from_object)
        flat = values.reshape(-1, values.shape[2])
        inside = atlas.inside
        kept = np.zeros(inside.shape, dtype=np.bool_) if keep is None else keep & inside
        if self._lone is not None:
            kept |= self._lone
        texels = out.reshape(-1, out.shape[2])
        with phase(0.0, 0.4, "Filling the gutter"):
            run(_write_gutter, len(self._gutter.texels), self._gutter, atlas.sheet.nodes,
                self._known, flat, coding, texels)  # fmt: skip
        with phase(0.4, 1.0, "Filling the gutter"):
            if self._frames is not None:
                self._frames.to_tangent(values)
            run(_write_owned, atlas.height, atlas.owners, inside, flat, coding, kept, opacity, out,
                chunk=ROWS)  # fmt: skip
        if self._beyond.size:
            texels[self._beyond[0]] = texels[self._beyond[1]]


def nodes_of_texels(atlas: TextureAtlas, settings: DilateSettings) -> Ints:
    """Return the node inside a chart whose value each texel shows, about: (h, w); or `NOTHING`.

    Beside charts it is the node nearest to where `TexelWriter` interpolates: for images of noise.
    """
    sheet, owners = atlas.sheet, atlas.owners
    nearest = nearest_nodes(sheet, atlas.sources)
    found = np.where(owners == NOTHING, np.int32(NOTHING), nearest[owners])
    filled = found != NOTHING
    gutter = _find_gutter(atlas, filled, max(float(settings.gutter), _LEAST), False, None, True)
    flat = found.reshape(-1)
    flat[gutter.texels] = nearest_in_cells(sheet, nearest, gutter.cells, gutter.places)
    if settings.background == "nearest" and filled.any():
        beyond, there = _nearest_filled(found != NOTHING)
        flat[beyond] = flat[there]
    return found


def _find_gutter(
    atlas: TextureAtlas,
    filled: npt.NDArray[np.bool_],
    radius: float,
    normals: bool,
    frames: NormalFrames | None,
    made: bool,
) -> _Gutter:
    if filled.all():
        texels = np.zeros(0, dtype=np.int64)
    else:
        with phase(0.0, 0.6, "Filling the gutter"):
            borders = _nearest_borders(atlas, filled, radius)
        near = ~filled & (borders.edges >= 0) & (borders.squares <= radius * radius)
        if not made:  # texels around the lone ones keep what was painted too
            labels = atlas.charts.labels
            lone = np.zeros(len(atlas.charts.boxes), dtype=np.bool_)
            lone[labels[atlas.lone[atlas.lone != NOTHING]]] = True
            near &= ~lone[labels[borders.edges // 3]]
        texels = np.flatnonzero(near)
    count = len(texels)
    found = _Gutter(
        texels,
        np.full(count, -1, dtype=np.int32),
        np.empty((count, 2), dtype=np.float32),
        np.empty((count if normals else 0, 2, 2), dtype=np.float32),
    )
    if frames is not None:
        found = found._replace(rotations=np.empty((count, 3, 3), dtype=np.float32))
    if count:
        with phase(0.6, 1.0, "Filling the gutter"):
            run(_place_gutter, count, borders, atlas.charts, atlas.sheet, atlas.metric,
                atlas.sources.cells >= 0, normals, found)  # fmt: skip
            if frames is not None:
                run(_frame_gutter, count, borders, atlas.charts, atlas.sheet, frames.corners,
                    found)  # fmt: skip
    held = found.cells >= 0
    return _Gutter(texels[held], found.cells[held], found.places[held],
                   found.rotations[held] if len(found.rotations) else found.rotations)  # fmt: skip


def _nearest_filled(filled: npt.NDArray[np.bool_]) -> npt.NDArray[np.int64]:
    # Texels that are not written, and the nearest ones that are.
    return np.stack([np.flatnonzero(~filled), nearest_marked(filled)[~filled]])


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
    # The place of texel (y, x); of its repetitions the one nearest to the half-edge, if the
    # half-edge's chart leaves the image.
    if not around[edge // 3]:
        return float(y), float(x)
    ay, ax, by, bx = ends(points, edge)
    up, left = 0.5 * (ay + by) - y, 0.5 * (ax + bx) - x
    return y + height * np.rint(up / height), x + width * np.rint(left / width)


@kernel
def _offer(points, found, edge, y, x):
    if found.edges[y, x] == edge:
        return
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
    # A sweep over the image, down or up; each texel is offered the edges of its neighbours.
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
    """Normalize the normal n of a color (n + 1) / 2, in place."""
    square = (color[0] - 0.5) ** 2 + (color[1] - 0.5) ** 2 + (color[2] - 0.5) ** 2
    if square > 1e-6:
        for c in range(3):
            color[c] = 0.5 + (color[c] - 0.5) * 0.5 / np.sqrt(square)


@kernel
def unit_normals(start, stop, values):
    """Normalize the normals of a sheet."""
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
def _in_sheet(borders, charts, sheet, edge, y, x):
    # The place in the sheet of texel (y, x) of the gutter, beside a half-edge's chart.
    height, width = borders.edges.shape
    label = charts.labels[edge // 3]
    there, across = _beside(charts.points, borders.around, edge, y, x, height, width)
    return there + sheet.shifts[label, 0], across + sheet.shifts[label, 1]


@kernel
def _frame_gutter(start, stop, borders, charts, sheet, frames, found):
    axes = np.empty((3, 3))
    for i in range(start, stop):
        y, x = divmod(found.texels[i], borders.edges.shape[1])
        edge = borders.edges[y, x]
        there, across = _in_sheet(borders, charts, sheet, edge, y, x)
        share, _ = nearest_on_edge(sheet.points, edge, there, across)
        there, across = place_on_edge(sheet.points, edge, share)
        axes_at(sheet.points, frames, edge // 3, there, across, axes)
        found.rotations[i] = axes


@kernel
def _place_gutter(start, stop, borders, charts, sheet, metric, known, normals, found):
    width = borders.edges.shape[1]
    nodes, points, cells = sheet.nodes, sheet.points, sheet.cells
    ways, shapes, jacobians = metric.ways, metric.shapes, metric.jacobians
    b = np.empty(3)
    rotation = np.empty((2, 2))
    nothing = np.zeros((1, 0), dtype=np.float32)
    for i in range(start, stop):
        y, x = divmod(found.texels[i], width)
        edge = borders.edges[y, x]
        there, across = _in_sheet(borders, charts, sheet, edge, y, x)
        face, row, column, _, _ = place_beyond(
            points, ways, shapes, jacobians, cells, edge, there, across, b, rotation
        )
        if face < 0:  # the surface ends: use the nearest value on its border
            share, _ = nearest_on_edge(points, edge, there, across)
            row, column = place_on_edge(points, edge, share)
            rotation[0, 0] = rotation[1, 1] = 1.0
            rotation[0, 1] = rotation[1, 0] = 0.0
        cell = int(row) * nodes.shape[1] + int(column)
        down, across = row - int(row), column - int(column)
        if interpolate(nodes, known, nothing, cell, down, across, -1, b[:0]) <= _LITTLE:
            continue
        found.cells[i] = cell
        found.places[i, 0] = down
        found.places[i, 1] = across
        if normals:
            found.rotations[i] = rotation


@kernel
def _write_gutter(start, stop, gutter, nodes, known, values, coding, out):
    color, axes = np.empty(out.shape[1]), np.empty((3, 3))
    for i in range(start, stop):
        down, across = gutter.places[i]
        color[:] = 0.0
        interpolate(nodes, known, values, gutter.cells[i], down, across, -1, color)
        if coding.normals:
            turn_direction(gutter.rotations[i], color, 0.5)
            unit_normal(color)
        if coding.from_object:
            axes[:] = gutter.rotations[i]
            into_frame(axes, color)
        for c in range(out.shape[1]):
            out[gutter.texels[i], c] = _coded(color[c], coding)
