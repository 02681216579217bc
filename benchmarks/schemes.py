# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper's schemes that recompute the flow after each unit of time (A, 3.3), on images.

The core offers the fixed flow only, from which *composed* hardly differs; *naive* blurs.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from shock_filter import core
from shock_filter.core.base.checks import SCALES
from shock_filter.core.base.parallel import kernel, run
from shock_filter.core.base.unfinished import MOST_STEPS
from shock_filter.core.grid.channels import Channels, channel_groups
from shock_filter.core.grid.potential import ROWS, image_potential
from shock_filter.core.grid.sample import add_value, put_mean
from shock_filter.core.grid.walk import begin, walk_cells


def steps_of(time: float) -> list[float]:
    """Cut a time into steps of length 1 and a rest."""
    whole = math.floor(time)
    return [1.0] * whole + [time - whole] * (time > whole)


def naive(image: npt.NDArray, time: float) -> npt.NDArray:
    """Sharpen an image (h, w, c) of any type; each step reads what the last one has made."""
    scale = np.float32(SCALES[image.dtype.name])
    current = image.astype(np.float32) * scale
    for duration in steps_of(time):
        current = core.sharpen_image(current, core.ImageSettings(time=duration))
    return as_given(current / scale, image)


def composed(image: npt.NDArray, time: float) -> npt.NDArray:
    """Sharpen an image (h, w, c) of any type; flow-lines are joined, and the input is read once."""
    settings = core.ImageSettings()
    (channels,) = channel_groups(image.shape[2], settings)
    scale = SCALES[image.dtype.name]
    traced, current = TracedPixels(*image.shape[:2]), image.astype(np.float32)
    for duration in steps_of(time):
        traced.trace(image_potential(current, scale, channels, settings.smoothing_passes), duration)
        traced.read(image, channels, current)
    return as_given(current, image)


def as_given(values: npt.NDArray, image: npt.NDArray) -> npt.NDArray:
    """Round values to the type of the image."""
    return (np.rint(values) if image.dtype.kind == "u" else values).astype(image.dtype)


class TracedPixels:
    """Where each pixel's values come from: the ends of four traces."""

    def __init__(self, height: int, width: int) -> None:
        self._cells = np.empty((height, width, 4, 2), dtype=np.int32)
        self._places = np.empty((height, width, 4, 2), dtype=np.float32)
        run(_start_rows, height, self._cells, self._places, chunk=ROWS)

    def trace(self, potential: npt.NDArray[np.float32], time: float) -> None:
        """Trace on from where the traces ended."""
        run(_trace_rows, len(potential), potential, float(time), MOST_STEPS, self._cells,
            self._places, chunk=ROWS)  # fmt: skip

    def read(self, image: npt.NDArray, channels: Channels, out: npt.NDArray[np.float32]) -> None:
        """Read the image at the traces' ends."""
        run(_read_rows, len(image), image, channels, self._cells, self._places, out, chunk=ROWS)


@kernel
def _start_rows(start, stop, cells, places):
    height, width = cells.shape[:2]
    for y in range(start, stop):
        for x in range(width):
            for corner in range(4):
                place = begin(y, x, corner)
                _store(place, cells[y, x, corner], places[y, x, corner])
                row, column, _, _ = place
                if not (row >= 0 and column >= 0 and row < height - 1 and column < width - 1):
                    cells[y, x, corner, 0] = -1  # no cell there


@kernel
def _store(place, cell, within):
    cell[0], cell[1], within[0], within[1] = place


@kernel
def _stored(cell, within):
    return np.int64(cell[0]), np.int64(cell[1]), np.float64(within[0]), np.float64(within[1])


@kernel
def _trace_rows(start, stop, potential, time, most_steps, cells, places):
    for y in range(start, stop):
        for x in range(potential.shape[1]):
            for corner in range(4):
                cell, within = cells[y, x, corner], places[y, x, corner]
                if cell[0] >= 0:
                    place = _stored(cell, within)
                    place, _, _, _, _ = walk_cells(
                        potential, None, None, None, time, most_steps, place
                    )
                    _store(place, cell, within)


@kernel
def _read_rows(start, stop, image, channels, cells, places, out):
    total = np.empty(image.shape[2])
    for y in range(start, stop):
        for x in range(image.shape[1]):
            total[:] = 0.0
            opacity = 0.0
            for corner in range(4):
                cell = cells[y, x, corner]
                if cell[0] >= 0:
                    place = _stored(cell, places[y, x, corner])
                    opacity += add_value(image, channels, place, False, total)
            put_mean(image, y, x, channels, total, opacity, False, out)
