# SPDX-License-Identifier: GPL-3.0-or-later
"""Conversion of a texture's values to a function on its surface, and back (see `matrices`)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..atlas.ghosts import fill_ghosts, interpolate
from ..atlas.sheet import NOTHING
from ..base.checks import Floats
from ..base.parallel import kernel, run
from ..base.progress import aside
from ..sparse.matrix import applied, with_rows
from .matrices import TextureSpace

_Single = npt.NDArray[np.float32]


def surface_values(space: TextureSpace, values: _Single, corners: Floats) -> _Single:
    """Convert a sheet's values to a function on the surface.

    Parameters
    ----------
    space : TextureSpace
    values : (rows, columns, c) float32
        Values of the nodes.
    corners : (v, c) float64
        Values at the corners of the pieces; see `corner_values`.

    Returns
    -------
    (n, c) float32
        A point on a seam has the mean of the values on its sides.
    """
    cut = space.cut_cells
    at_points = _means(cut.pieces.points, corners, len(cut.kinds))
    _spread(space, at_points)
    flat = values.reshape(-1, values.shape[2])
    result = np.zeros((space.size, flat.shape[1]), dtype=np.float32)
    run(_copy_nodes, len(flat), space.labels.reshape(-1), flat, result)
    result[cut.unknowns] = at_points[cut.free]
    return result


def painted_values(space: TextureSpace, image: _Single) -> _Single:
    """Read an image (h, w, c) as a function on the surface: (n, c)."""
    atlas = space.atlas
    sheet = atlas.gather(image)
    known = fill_ghosts(atlas.sheet, atlas.sources, sheet)
    return surface_values(space, sheet, corner_values(space, sheet, known))


def corner_values(
    space: TextureSpace, values: _Single, known: npt.NDArray[np.bool_], alpha: int = -1
) -> Floats:
    """Interpolate a sheet's values at the corners of the pieces, each in its own chart.

    Parameters
    ----------
    space : TextureSpace
    values : (rows, columns, c) float32
        Values of nodes and ghosts.
    known : (g,) bool
        Ghosts whose values are used.
    alpha : int
        The opacity channel, which weights the others. -1: none.

    Returns
    -------
    (v, c) float64
        NaN where nothing is known, and in faces without area in the texture.
    """
    pieces = space.cut_cells.pieces
    flat = values.reshape(-1, values.shape[2])
    found = np.full((len(pieces.points), flat.shape[1]), np.nan)
    with aside("Comparing texels"):
        run(_read_corners, len(pieces.faces), pieces, space.atlas.sheet.nodes, known, flat, alpha,
            found)  # fmt: skip
    return found


@kernel
def _read_corners(start, stop, pieces, nodes, known, values, alpha, out):
    columns = nodes.shape[1]
    for piece in range(start, stop):
        cell = pieces.cells[piece]
        if cell < 0:
            continue
        row, column = divmod(cell, columns)
        for n in range(pieces.start[piece], pieces.start[piece + 1]):
            down = min(max(pieces.places[n, 0] - row, 0.0), 1.0)
            across = min(max(pieces.places[n, 1] - column, 0.0), 1.0)
            out[n] = 0.0
            if interpolate(nodes, known, values, cell, down, across, alpha, out[n]) <= 0:
                out[n] = np.nan


def _means(points: npt.NDArray[np.int64], corners: Floats, count: int) -> Floats:
    # Mean over the corners at each point; NaN if none is known.
    known = ~np.isnan(corners[:, 0])
    numbers = np.bincount(points[known], minlength=count)
    sums = [np.bincount(points[known], column[known], count) for column in corners.T]
    with np.errstate(invalid="ignore"):
        return np.stack(sums, axis=1) / numbers[:, None]


def _spread(space: TextureSpace, at_points: Floats) -> None:
    # Points without a value receive the mean of those around them.
    pieces = space.cut_cells.pieces
    points = pieces.points
    piece = np.repeat(np.arange(len(pieces.faces)), np.diff(pieces.start))
    while True:
        missing = np.isnan(at_points[:, 0])
        if not missing.any():
            return
        beside = np.zeros(len(pieces.faces), dtype=np.bool_)
        beside[piece[missing[points]]] = True
        points, piece = points[beside[piece]], piece[beside[piece]]
        means = _means(piece, at_points[points], len(pieces.faces))
        found = _means(points, means[piece], len(at_points))[missing]
        if np.isnan(found[:, 0]).all():
            break
        at_points[missing] = found
    at_points[np.isnan(at_points[:, 0])] = 0.0


def sheet_values(space: TextureSpace, values: _Single, sheet: _Single) -> None:
    """Write a function on the surface to the nodes inside charts of a sheet.

    Parameters
    ----------
    space : TextureSpace
    values : (n, c) float32
    sheet : (rows, columns, c) float32
        Overwritten at nodes inside charts.
    """
    flat = sheet.reshape(-1, sheet.shape[2])
    run(_copy_nodes, len(flat), space.labels.reshape(-1), values, flat)
    hidden_values(space, values, sheet)


def hidden_values(space: TextureSpace, values: _Single, sheet: _Single) -> None:
    """Write a function on the surface to the nodes that are no unknowns, as `sheet_values` does."""
    flat = sheet.reshape(-1, sheet.shape[2])
    cut = space.cut_cells
    at_points = applied(with_rows(cut.interpolation, cut.hidden[:, 1]), values[cut.unknowns])
    flat[cut.hidden[:, 0]] = at_points


def added_to_sheet(
    space: TextureSpace,
    sheet: _Single,
    values: _Single,
    change: _Single,
    factor: float,
    alpha: int = -1,
) -> _Single:
    """Return a sheet plus a change of the function that was read from it.

    Parameters
    ----------
    space : TextureSpace
    sheet : (rows, columns, c) float32
    values : (n, c) float32
        The function, without the channel `alpha`.
    change : (n, c) float32
        Added with the weight `factor`.
    factor : float
    alpha : int
        A channel of the sheet that is not changed; -1: none.
    """
    result = np.empty_like(sheet)
    flat, scale = result.reshape(-1, sheet.shape[2]), np.float32(factor)
    given = sheet.reshape(flat.shape)
    with aside("Filling the gutter"):
        run(_add_to_nodes, len(flat), space.labels.reshape(-1), given, change, scale, alpha, flat)
    cut = space.cut_cells
    nodes, points = cut.hidden.T
    whole = values[cut.unknowns] + scale * change[cut.unknowns]
    channels = np.flatnonzero(np.arange(flat.shape[1]) != alpha)
    flat[nodes[:, None], channels] = applied(with_rows(cut.interpolation, points), whole)
    return result


@kernel
def _add_to_nodes(start, stop, labels, sheet, change, factor, alpha, out):
    for i in range(start, stop):
        for c in range(out.shape[1]):
            out[i, c] = sheet[i, c]
        if labels[i] == NOTHING:
            continue
        for c in range(change.shape[1]):
            out[i, c + (0 <= alpha <= c)] += factor * change[i, c]


@kernel
def _copy_nodes(start, stop, labels, values, out):
    for i in range(start, stop):
        if labels[i] != NOTHING:
            for c in range(out.shape[1]):
                out[i, c] = values[i, c]
