# SPDX-License-Identifier: GPL-3.0-or-later
"""Advection on images: values are read where the flow-lines come from (paper A, Appendix A).

What is kept beside the image is P alone, one float32 a pixel: the flow is taken from it on the fly,
and values are read from the image itself, whatever its type. So an image that is mapped from disk
costs 8 bytes a pixel while it is filtered.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..base.unfinished import MOST_STEPS, warn_of_unfinished
from .channels import Channels
from .potential import ROWS
from .sample import add_value, put_mean
from .walk import UNFINISHED, begin, walk_cells


def advect_pixels(
    image: npt.NDArray,
    channels: Channels,
    potential: npt.NDArray[np.float32],
    time: float | npt.NDArray[np.float32],
    out: npt.NDArray,
    *,
    nearest: bool = False,
) -> None:
    """Read the image where the flow-lines come from ("Vertex Advection", on squares).

    From each pixel a trace begins in each adjacent cell; the pixel's new value is the mean of
    the values at their ends, each as much as it is opaque.

    Parameters
    ----------
    image : (h, w, c) array
    channels : Channels
        The others are left as they are in `out`.
    potential : (h, w) float32
    time : float or (h, w) float32
        Flow time, or that of each pixel; infinity walks until the flow ends.
    out : (h, w, c) array
        Where the result goes, in the image's range; whole numbers are rounded.
    nearest : bool
        Take the nearest pixel's value at the ends instead of interpolating linearly.
    """
    unfinished = np.zeros(len(image), dtype=np.int64)
    same, times = split_time(time)
    run(_advect_rows, len(image), image, channels, potential, same, times, MOST_STEPS, nearest,
        _rounds(out), out, unfinished, chunk=ROWS)  # fmt: skip
    warn_of_unfinished(unfinished)


def split_time(
    time: float | npt.NDArray[np.float32],
) -> tuple[float, npt.NDArray[np.float32]]:
    """Give kernels one time for all, and those of each node, which are none if it is one."""
    if isinstance(time, np.ndarray):
        return 0.0, time
    return float(time), np.empty((0, 0), np.float32)


class TracedPixels:
    """Where each pixel's values come from, while flows that change lead on (paper A, 3.3).

    Holds the ends of all traces, 48 bytes a pixel.
    """

    def __init__(self, height: int, width: int) -> None:
        self._cells = np.empty((height, width, 4, 2), dtype=np.int32)
        self._places = np.empty((height, width, 4, 2), dtype=np.float32)
        run(_start_rows, height, self._cells, self._places, chunk=ROWS)

    def trace(self, potential: npt.NDArray[np.float32], time: float) -> None:
        """Trace on from where the traces ended."""
        unfinished = np.zeros(len(potential), dtype=np.int64)
        run(_trace_rows, len(potential), potential, float(time), MOST_STEPS, self._cells,
            self._places, unfinished, chunk=ROWS)  # fmt: skip
        warn_of_unfinished(unfinished)

    def read(
        self, image: npt.NDArray, channels: Channels, out: npt.NDArray, *, nearest: bool = False
    ) -> None:
        """Read the image at the traces' ends; parameters as in `advect_pixels`."""
        run(_read_rows, len(image), image, channels, self._cells, self._places, nearest,
            _rounds(out), out, chunk=ROWS)  # fmt: skip


def _rounds(out: npt.NDArray) -> bool:
    return bool(np.issubdtype(out.dtype, np.integer))


@kernel
def _exists(place, height, width):
    row, column, _, _ = place
    return row >= 0 and column >= 0 and row < height - 1 and column < width - 1


@kernel
def _advect_rows(
    start, stop, image, channels, potential, time, times, most_steps, nearest, rounded, out,
    unfinished,
):  # fmt: skip
    height, width = image.shape[:2]
    total = np.empty(image.shape[2])
    for y in range(start, stop):
        for x in range(width):
            total[:] = 0.0
            opacity = 0.0
            if times.size > 0:
                time = float(times[y, x])
            for corner in range(4):
                place = begin(y, x, corner)
                if not _exists(place, height, width):
                    continue
                place, _, _, _, ending = walk_cells(
                    potential, None, None, None, time, most_steps, place
                )
                unfinished[y] += ending == UNFINISHED
                opacity += add_value(image, channels, place, nearest, total)
            put_mean(image, y, x, channels, total, opacity, rounded, out)


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
def _trace_rows(start, stop, potential, time, most_steps, cells, places, unfinished):
    width = cells.shape[1]
    for y in range(start, stop):
        for x in range(width):
            for corner in range(4):
                cell, within = cells[y, x, corner], places[y, x, corner]
                if cell[0] < 0:
                    continue
                place, _, _, _, ending = walk_cells(
                    potential, None, None, None, time, most_steps, _stored(cell, within)
                )
                unfinished[y] += ending == UNFINISHED
                _store(place, cell, within)


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
