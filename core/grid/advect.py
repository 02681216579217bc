# SPDX-License-Identifier: GPL-3.0-or-later
"""Advection on images: sample values where the flow-lines come from (paper A, Appendix A).

Only P is stored beside the image, one float32 per pixel: the flow is computed from it on the fly,
and values are read from the image itself, whatever its type. So an image that is mapped from disk
takes 8 bytes per pixel while it is filtered.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..base.unfinished import MOST_STEPS, warn_of_unfinished
from .channels import Channels
from .part import Part
from .potential import ROWS
from .sample import add_value, put_mean
from .walk import LEFT_ACROSS, LEFT_DOWN, UNFINISHED, begin, walk_cells


def advect_pixels(
    image: npt.NDArray,
    channels: Channels,
    potential: npt.NDArray[np.float32],
    time: float | npt.NDArray[np.float32],
    out: npt.NDArray,
    *,
    nearest: bool = False,
    part: Part | None = None,
) -> npt.NDArray[np.int64]:
    """Sample the image where the flow-lines come from ("Vertex Advection", on squares).

    From each pixel a trace begins in each adjacent cell; the pixel's new value is the mean of
    the values at their ends, weighted by opacity.

    Parameters
    ----------
    image : (h, w, c) array
    channels : Channels
        Only these channels of `out` are written.
    potential : (h, w) float32
    time : float or (h, w) float32
        Flow time, of all pixels or of each; infinity walks until the flow ends.
    out : (h, w, c) array
        Receives the result, in the image's range; whole numbers are rounded.
    nearest : bool
        Take the nearest pixel's value at the ends instead of interpolating linearly.
    part : Part, optional
        The wanted pixels, if the image is a part of another one.

    Returns
    -------
    (rows,) int64
        For each wanted row, the largest distance from the end of the known flow of a pixel whose
        traces leave it, so that its value is wrong; 0 if there is none.
    """
    part = part or Part.whole(image.shape)
    unfinished = np.zeros(len(image), dtype=np.int64)
    depths = np.zeros(part.rows.stop - part.rows.start, dtype=np.int64)
    same, times = split_time(time)
    known = np.ascontiguousarray(potential[part.known()])
    run(_advect_rows, len(depths), image, channels, known, part.window(), same, times, MOST_STEPS,
        nearest, _rounds(out), out, unfinished, depths, chunk=ROWS)  # fmt: skip
    warn_of_unfinished(unfinished)
    return depths


def split_time(
    time: float | npt.NDArray[np.float32],
) -> tuple[float, npt.NDArray[np.float32]]:
    """Split a time for kernels into (time of all, times of each node); `times` is empty for one."""
    if isinstance(time, np.ndarray):
        return 0.0, time
    return float(time), np.empty((0, 0), np.float32)


class TracedPixels:
    """Where each pixel's values come from, traced through several flows (paper A, 3.3).

    Holds the ends of all traces, 48 bytes a pixel.
    """

    def __init__(self, height: int, width: int) -> None:
        self._cells = np.empty((height, width, 4, 2), dtype=np.int32)
        self._places = np.empty((height, width, 4, 2), dtype=np.float32)
        run(_start_rows, height, self._cells, self._places, chunk=ROWS)

    def trace(
        self, potential: npt.NDArray[np.float32], time: float, part: Part | None = None
    ) -> npt.NDArray[np.int64]:
        """Continue the traces from their ends; parameters and result as in `advect_pixels`."""
        part = part or Part.whole(potential.shape)
        unfinished = np.zeros(len(potential), dtype=np.int64)
        depths = np.zeros(part.rows.stop - part.rows.start, dtype=np.int64)
        known = np.ascontiguousarray(potential[part.known()])
        run(_trace_rows, len(depths), known, part.window(), float(time), MOST_STEPS, self._cells,
            self._places, unfinished, depths, chunk=ROWS)  # fmt: skip
        warn_of_unfinished(unfinished)
        return depths

    def read(
        self, image: npt.NDArray, channels: Channels, out: npt.NDArray, *, nearest: bool = False
    ) -> None:
        """Sample the image at the traces' ends; parameters as in `advect_pixels`."""
        run(_read_rows, len(image), image, channels, self._cells, self._places, nearest,
            _rounds(out), out, chunk=ROWS)  # fmt: skip


def _rounds(out: npt.NDArray) -> bool:
    return bool(np.issubdtype(out.dtype, np.integer))


@kernel
def _exists(place, height, width):
    row, column, _, _ = place
    return row >= 0 and column >= 0 and row < height - 1 and column < width - 1


@kernel
def _is_lost(place, window):
    """Whether the picture continues beyond the cell where a trace left the known flow."""
    row, column, _, _ = place
    return (
        row <= window.first_row or row >= window.last_row
        or column <= window.first_column or column >= window.last_column
    )  # fmt: skip


@kernel
def _depth(y, x, window):
    """Distance of a pixel from the end of the known flow, counted from 1."""
    down = min(y - window.first_row, window.last_row + 1 - y)
    across = min(x - window.first_column, window.last_column + 1 - x)
    return min(down, across) + 1


@kernel
def _advect_rows(
    start, stop, image, channels, potential, window, time, times, most_steps, nearest, rounded,
    out, unfinished, depths,
):  # fmt: skip
    height, width = potential.shape
    total = np.empty(image.shape[2])
    for number in range(start, stop):
        y = window.row + number
        for x in range(window.column, window.end):
            total[:] = 0.0
            opacity = 0.0
            lost = False
            if times.size > 0:
                time = float(times[y, x])
            for corner in range(4):
                place = begin(y - window.top, x - window.left, corner)
                if not _exists(place, height, width):
                    lost |= _is_lost(place, window)
                    continue
                place, _, _, _, ending = walk_cells(
                    potential, None, None, None, time, most_steps, place
                )
                unfinished[y] += ending == UNFINISHED
                if ending == LEFT_DOWN or ending == LEFT_ACROSS:
                    lost |= _is_lost(place, window)
                row, column, down, across = place
                place = row + window.top, column + window.left, down, across
                opacity += add_value(image, channels, place, nearest, total)
            put_mean(image, y, x, channels, total, opacity, rounded, out)
            if lost:
                depth = _depth(y - window.top, x - window.left, window)
                depths[number] = max(depths[number], depth)


@kernel
def _start_rows(start, stop, cells, places):
    height, width = cells.shape[:2]
    for y in range(start, stop):
        for x in range(width):
            for corner in range(4):
                place = begin(y, x, corner)
                _store(place, cells[y, x, corner], places[y, x, corner])
                if not _exists(place, height, width):
                    cells[y, x, corner, 0] = -1  # no cell there


@kernel
def _store(place, cell, within):
    cell[0], cell[1], within[0], within[1] = place


@kernel
def _stored(cell, within):
    return np.int64(cell[0]), np.int64(cell[1]), np.float64(within[0]), np.float64(within[1])


@kernel
def _trace_rows(
    start, stop, potential, window, time, most_steps, cells, places, unfinished, depths
):
    height, width = potential.shape
    for number in range(start, stop):
        y = window.row + number
        for x in range(window.column, window.end):
            lost = False
            for corner in range(4):
                cell, within = cells[y, x, corner], places[y, x, corner]
                if cell[0] < 0:
                    continue
                row, column, down, across = _stored(cell, within)
                place = row - window.top, column - window.left, down, across
                if not _exists(place, height, width):
                    lost = True
                    continue
                place, _, _, _, ending = walk_cells(
                    potential, None, None, None, time, most_steps, place
                )
                unfinished[y] += ending == UNFINISHED
                if ending == LEFT_DOWN or ending == LEFT_ACROSS:
                    lost |= _is_lost(place, window)
                row, column, down, across = place
                _store((row + window.top, column + window.left, down, across), cell, within)
            if lost:
                depth = _depth(y - window.top, x - window.left, window)
                depths[number] = max(depths[number], depth)


@kernel
def _read_rows(start, stop, image, channels, cells, places, nearest, rounded, out):
    width = image.shape[1]
    total = np.empty(image.shape[2])
    for y in range(start, stop):
        for x in range(width):
            total[:] = 0.0
            opacity = 0.0
            for corner in range(4):
                cell = cells[y, x, corner]
                if cell[0] >= 0:
                    place = _stored(cell, places[y, x, corner])
                    opacity += add_value(image, channels, place, nearest, total)
            put_mean(image, y, x, channels, total, opacity, rounded, out)
