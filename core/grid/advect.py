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
from .part import LeftPart, Part
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
) -> None:
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

    Raises
    ------
    LeftPart
        If a trace of a wanted pixel leaves the known flow.
    """
    part = part or Part.whole(image.shape)
    unfinished = np.zeros(len(image), dtype=np.int64)
    left = np.zeros(part.rows.stop - part.rows.start, dtype=np.bool_)
    same, times = split_time(time)
    known = np.ascontiguousarray(potential[part.known()])
    run(_advect_rows, len(left), image, channels, known, part.window(), same, times, MOST_STEPS,
        nearest, out.dtype.kind == "u", out, unfinished, left, chunk=ROWS)  # fmt: skip
    warn_of_unfinished(unfinished)
    if left.any():
        raise LeftPart


def split_time(
    time: float | npt.NDArray[np.float32],
) -> tuple[float, npt.NDArray[np.float32]]:
    """Split a time for kernels into (time of all, times of each node); `times` is empty for one."""
    if isinstance(time, np.ndarray):
        return 0.0, time
    return float(time), np.empty((0, 0), np.float32)


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
def _advect_rows(
    start, stop, image, channels, potential, window, time, times, most_steps, nearest, rounded,
    out, unfinished, left,
):  # fmt: skip
    height, width = potential.shape
    total = np.empty(image.shape[2])
    for number in range(start, stop):
        y = window.row + number
        for x in range(window.column, window.end):
            total[:] = 0.0
            opacity = 0.0
            if times.size > 0:
                time = float(times[y, x])
            for corner in range(4):
                place = begin(y - window.top, x - window.left, corner)
                if not _exists(place, height, width):
                    left[number] |= _is_lost(place, window)
                    continue
                place, _, _, _, ending = walk_cells(
                    potential, None, None, None, time, most_steps, place
                )
                unfinished[y] += ending == UNFINISHED
                if ending == LEFT_DOWN or ending == LEFT_ACROSS:
                    left[number] |= _is_lost(place, window)
                row, column, down, across = place
                place = row + window.top, column + window.left, down, across
                opacity += add_value(image, channels, place, nearest, total)
            put_mean(image, y, x, channels, total, opacity, rounded, out)
