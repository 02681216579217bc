# SPDX-License-Identifier: GPL-3.0-or-later
"""Images as meshes of squares: the potential, flow-lines and advection (paper A, Appendix A).

Pixels are the vertices, and four adjacent pixels make a square in which the flow is constant;
lengths are in pixels. What is kept beside the image is P alone, one float32 a pixel: the flow is
taken from it on the fly, and values are read from the image itself, whatever its type. So an
image that is mapped from disk costs 8 bytes a pixel while it is filtered.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..base.parallel import Progress, kernel, run

OFFSET = 0.001
"""How far into each adjacent square the trace of a pixel begins: the paper's epsilon."""

_ROWS = 16
_NEIGHBOUR = math.exp(-1.0)  # the Gaussian umbrella's weight at distance 1


@dataclass(frozen=True)
class Channels:
    """Which channels of an image are filtered, and how they guide the flow.

    Attributes
    ----------
    start, stop : int
        The channels ``start <= c < stop``.
    alpha : int
        The channel that is opacity, or -1.
    brightness : (k,) float32
        Weights of the channels in one guiding brightness; empty: each channel guides.
    """

    start: int
    stop: int
    alpha: int
    brightness: npt.NDArray[np.float32]


def image_potential(
    image: npt.NDArray,
    scale: float,
    channels: Channels,
    passes: int,
    progress: Progress | None = None,
) -> npt.NDArray[np.float32]:
    """Compute P = sum over channels of the squared gradient, smoothed before and after.

    Parameters
    ----------
    image : (h, w, c) array of any real type
        h and w at least 2.
    scale : float
        Factor that brings values to [0, 1], such as 1 / 255.
    channels : Channels
        Colors count as much as they are opaque.
    passes : int
        Smoothing passes on the signal and on P.

    Returns
    -------
    (h, w) float32
    """
    progress = progress or Progress(None)
    height, width = image.shape[:2]
    potential = np.empty((height, width), dtype=np.float32)
    run(_potential_rows, height, image, np.float32(scale), channels.start, channels.stop,
        channels.alpha, channels.brightness, passes, potential, chunk=_ROWS,
        progress=progress.part(0.0, 0.8, "Computing the flow"))  # fmt: skip
    spare = np.empty_like(potential) if passes else potential
    last = progress.part(0.8, 1.0, "Computing the flow")
    for _ in range(passes):
        run(_smooth_rows, height, potential, spare, chunk=_ROWS, progress=last)
        potential, spare = spare, potential
    progress.update(1.0)
    return potential


def advect_pixels(
    image: npt.NDArray,
    channels: Channels,
    potential: npt.NDArray[np.float32],
    time: float,
    out: npt.NDArray,
    *,
    nearest: bool = False,
    step: float | None = None,
    progress: Progress | None = None,
) -> None:
    """Read the image where the flow-lines come from ("Vertex Advection", on squares).

    From each pixel a trace begins in each adjacent square; the pixel's new value is the mean of
    the values at their ends, each as much as it is opaque.

    Parameters
    ----------
    image : (h, w, c) array
    channels : Channels
        The others are left as they are in `out`.
    potential : (h, w) float32
    time : float
        Flow time; infinity walks until the flow ends.
    out : (h, w, c) array
        Where the result goes, in the image's range; whole numbers are rounded.
    nearest : bool
        Take the nearest pixel's value at the ends instead of interpolating linearly.
    step : float, optional
        Walk literally, in steps of this length in pixels (the paper's is 0.1). None walks
        exactly from square to square.
    """
    literal = 0.0 if step is None else float(step)
    run(_advect_rows, image.shape[0], image, channels.start, channels.stop, channels.alpha,
        potential, float(time), literal, nearest, _rounds(out), out, chunk=_ROWS,
        progress=progress)  # fmt: skip


class Sources:
    """Where each pixel's values come from, while flows that change carry them on (paper 3.3).

    Holds the ends of all traces, 48 bytes a pixel.
    """

    def __init__(self, height: int, width: int, progress: Progress | None = None) -> None:
        self._cells = np.empty((height, width, 4, 2), dtype=np.int32)
        self._places = np.empty((height, width, 4, 2), dtype=np.float32)
        run(_start_rows, height, self._cells, self._places, chunk=_ROWS, progress=progress)

    def carry(
        self, potential: npt.NDArray[np.float32], time: float, progress: Progress | None = None
    ) -> None:
        """Trace on from where the traces ended."""
        run(_carry_rows, len(potential), potential, float(time), self._cells, self._places,
            chunk=_ROWS, progress=progress)  # fmt: skip

    def read(
        self,
        image: npt.NDArray,
        channels: Channels,
        out: npt.NDArray,
        *,
        nearest: bool = False,
        progress: Progress | None = None,
    ) -> None:
        """Read the image at the traces' ends; parameters as in `advect_pixels`."""
        run(_read_rows, len(image), image, channels.start, channels.stop, channels.alpha,
            self._cells, self._places, nearest, _rounds(out), out, chunk=_ROWS,
            progress=progress)  # fmt: skip


def _rounds(out: npt.NDArray) -> bool:
    return bool(np.issubdtype(out.dtype, np.integer))


@kernel
def _potential_rows(
    start, stop, image, scale, first_channel, last_channel, alpha, brightness, passes, potential
):
    # Planar working copy of the rows that this band depends on.
    height, width = image.shape[:2]
    first = max(start - 1 - passes, 0)
    last = min(stop + 1 + passes, height)
    rows = last - first
    signal = np.empty((rows, width), np.float32)
    spare = np.empty((rows, width), np.float32)
    top = max(start - 1, 0)  # squares top .. bottom - 1 touch the band
    bottom = min(stop, height - 1)
    energy = np.zeros((bottom - top, width - 1), np.float32)
    guides = 1 if brightness.size > 0 else last_channel - first_channel
    for guide in range(guides):
        for y in range(rows):
            if brightness.size > 0:
                for x in range(width):
                    total = np.float32(0.0)
                    for c in range(brightness.size):
                        total += brightness[c] * np.float32(image[first + y, x, first_channel + c])
                    signal[y, x] = scale * total
            else:
                for x in range(width):
                    signal[y, x] = scale * np.float32(image[first + y, x, first_channel + guide])
            if alpha >= 0:
                for x in range(width):
                    signal[y, x] *= scale * np.float32(image[first + y, x, alpha])
        for _ in range(passes):
            for y in range(rows):
                _smooth_row(signal, y, spare)
            signal, spare = spare, signal
        for r in range(bottom - top):
            y = top + r - first
            for x in range(width - 1):
                across = signal[y, x + 1] - signal[y, x] + signal[y + 1, x + 1] - signal[y + 1, x]
                down = signal[y + 1, x] - signal[y, x] + signal[y + 1, x + 1] - signal[y, x + 1]
                energy[r, x] += np.float32(0.25) * (across * across + down * down)
    for y in range(start, stop):
        above = max(y - 1, 0) - top
        below = min(y, height - 2) - top
        for x in range(width):
            left = max(x - 1, 0)
            right = min(x, width - 2)
            # At borders the same square counts twice, which leaves the mean of those there are.
            total = energy[above, left] + energy[above, right]
            total += energy[below, left] + energy[below, right]
            potential[y, x] = min(np.float32(0.25) * total, np.float32(1e30))


@kernel
def _smooth_row(values, y, out):
    # One umbrella pass on a row; neighbours are the pixels up, down, left and right.
    height, width = values.shape
    weight = np.float32(_NEIGHBOUR)
    vertical = np.float32(0.0)
    up, down = max(y - 1, 0), min(y + 1, height - 1)
    has_up = np.float32(up != y)
    has_down = np.float32(down != y)
    vertical = has_up + has_down
    inner = np.float32(1.0) / (np.float32(1.0) + weight * (vertical + np.float32(2.0)))
    outer = np.float32(1.0) / (np.float32(1.0) + weight * (vertical + np.float32(1.0)))
    for x in range(1, width - 1):
        around = values[y, x - 1] + values[y, x + 1]
        around += has_up * values[up, x] + has_down * values[down, x]
        out[y, x] = (values[y, x] + weight * around) * inner
    for x, beside in ((0, 1), (width - 1, width - 2)):
        around = values[y, beside] + has_up * values[up, x] + has_down * values[down, x]
        out[y, x] = (values[y, x] + weight * around) * outer


@kernel
def _smooth_rows(start, stop, values, out):
    for y in range(start, stop):
        _smooth_row(values, y, out)


@kernel
def _flow(potential, row, column, turned):
    # v = -grad(P) / 2 in a square: (down, across), or (across, down) if turned.
    if turned:
        row, column = column, row
    a = potential[row, column]
    b = potential[row, column + 1]
    c = potential[row + 1, column]
    d = potential[row + 1, column + 1]
    down = -0.25 * (float(c - a) + float(d - b))
    across = -0.25 * (float(b - a) + float(d - c))
    return (across, down) if turned else (down, across)


@kernel
def _walk(potential, time, row, column, down, across):
    # From square to square: (row, column) is the square's first pixel, (down, across) the point
    # in it. Returns where the walk ends. Numbers rather than arrays: these stay in registers.
    left = time
    v, w = _flow(potential, row, column, False)
    y = down + v * left
    x = across + w * left
    if 0.0 < y < 1.0 and 0.0 < x < 1.0:
        return row, column, y, x
    # The walk crosses the lines between squares along the first axis; i, a and v belong to it.
    # To cross along the other one, both are exchanged.
    i, j, a, b = row, column, down, across
    turned = False
    sliding = False  # along a line between squares, that is, along the second axis
    for _ in range(1000000):
        if not sliding:
            reach_a = reach(a, v)
            reach_b = reach(b, w)
            if left <= min(reach_a, reach_b):
                if left < np.inf:
                    a += v * left
                    b += w * left
                break
            if reach_b < reach_a:
                turned = not turned
                i, j, a, b, v, w = j, i, b, a, w, v
                reach_a = reach_b
            left -= reach_a
            ahead = 1 if v > 0 else -1
            a = 1.0 if v > 0 else 0.0
            b = min(max(b + w * reach_a, 0.0), 1.0)
            beyond = i + ahead
            if beyond < 0 or beyond > potential.shape[1 if turned else 0] - 2:
                break
            next_v, next_w = _flow(potential, beyond, j, turned)
            if v * next_v + w * next_w <= 0:
                break
            if v * next_v > 0:
                i = beyond
                a = 1.0 - a
                v, w = next_v, next_w
                continue
            # Both squares flow into the line between them: slide on it, at the combination of
            # both flows that stays there (Filippov). The line belongs to the lower square.
            share = -next_v / (v - next_v)
            w = share * w + (1.0 - share) * next_w
            i = min(i, beyond)
            a = 1.0
            sliding = True
        reached = (1.0 - b) / w if w > 0 else b / -w
        if reached >= left:
            b += w * left
            break
        left -= reached
        ahead = 1 if w > 0 else -1
        b = 1.0 if w > 0 else 0.0
        beyond = j + ahead
        if beyond < 0 or beyond > potential.shape[0 if turned else 1] - 2:
            break
        j = beyond
        b = 1.0 - b
        # Past a pixel: the squares on both sides of the line decide.
        v, w = _flow(potential, i, j, turned)
        next_v, next_w = _flow(potential, i + 1, j, turned)
        if v >= 0 and next_v <= 0:
            total = v - next_v
            share = -next_v / total if total > 0 else 0.5
            w = share * w + (1.0 - share) * next_w
        else:
            if next_v > 0 and next_v > -v:
                i += 1
                a = 0.0
                v, w = next_v, next_w
            sliding = False
        if w * ahead <= 0:
            break
    return (j, i, b, a) if turned else (i, j, a, b)


@kernel
def reach(place, speed):
    """Time until the end of the square, along one axis."""
    if speed > 1e-30:
        return (1.0 - place) / speed
    if speed < -1e-30:
        return place / -speed
    return np.inf


@kernel
def _walk_literal(potential, time, step, row, column, down, across):
    left = time
    most_y = potential.shape[0] - 1
    most_x = potential.shape[1] - 1
    v, w = _flow(potential, row, column, False)
    for _ in range(1000000):
        speed = np.sqrt(v * v + w * w)
        if left <= 0 or speed < 1e-30:
            break
        pace = min(left, step / speed)
        left -= pace
        y = row + down + v * pace
        x = column + across + w * pace
        if y < 0 or y > most_y or x < 0 or x > most_x:
            left = 0.0  # the walk ends at the border
            y = min(max(y, 0.0), float(most_y))
            x = min(max(x, 0.0), float(most_x))
        row = min(int(y), most_y - 1)
        column = min(int(x), most_x - 1)
        down = y - row
        across = x - column
        next_v, next_w = _flow(potential, row, column, False)
        if v * next_v + w * next_w <= 0:
            break
        v, w = next_v, next_w
    return row, column, down, across


@kernel
def _begin(y, x, corner):
    # The start beside pixel (y, x) in one of its four squares.
    up = corner >> 1
    left = corner & 1
    down = 1.0 - 0.5 * OFFSET if up else 0.5 * OFFSET
    across = 1.0 - 0.5 * OFFSET if left else 0.5 * OFFSET
    return y - up, x - left, down, across


@kernel
def _exists(row, column, height, width):
    return row >= 0 and column >= 0 and row < height - 1 and column < width - 1


@kernel
def add_sample(image, first, last, alpha, row, column, down, across, nearest, total):
    """Add the values at a point, times opacity, to `total`; returns the opacity."""
    if nearest:
        row += down > 0.5
        column += across > 0.5
        opacity = 1.0 if alpha < 0 else float(image[row, column, alpha])
        for c in range(first, last):
            total[c] += opacity * image[row, column, c]
        return opacity
    k = down * across
    j = down - k
    i = across - k
    h = 1.0 - down - i
    if alpha >= 0:
        h *= image[row, column, alpha]
        i *= image[row, column + 1, alpha]
        j *= image[row + 1, column, alpha]
        k *= image[row + 1, column + 1, alpha]
    for c in range(first, last):
        total[c] += (
            h * image[row, column, c] + i * image[row, column + 1, c]
            + j * image[row + 1, column, c] + k * image[row + 1, column + 1, c]
        )  # fmt: skip
    return h + i + j + k


@kernel
def _put(image, y, x, first, last, total, weight, rounded, out):
    for c in range(first, last):
        if weight > 0:
            value = total[c] / weight
            out[y, x, c] = np.floor(value + 0.5) if rounded else value
        else:
            out[y, x, c] = image[y, x, c]  # fully transparent all around


@kernel
def _advect_rows(
    start, stop, image, first, last, alpha, potential, time, step, nearest, rounded, out
):
    height, width = potential.shape
    total = np.empty(image.shape[2])
    for y in range(start, stop):
        for x in range(width):
            total[:] = 0.0
            weight = 0.0
            for corner in range(4):
                row, column, down, across = _begin(y, x, corner)
                if not _exists(row, column, height, width):
                    continue
                if step > 0:
                    row, column, down, across = _walk_literal(
                        potential, time, step, row, column, down, across
                    )
                else:
                    row, column, down, across = _walk(potential, time, row, column, down, across)
                weight += add_sample(
                    image, first, last, alpha, row, column, down, across, nearest, total
                )
            _put(image, y, x, first, last, total, weight, rounded, out)


@kernel
def _start_rows(start, stop, cells, places):
    height, width = cells.shape[:2]
    for y in range(start, stop):
        for x in range(width):
            for corner in range(4):
                row, column, down, across = _begin(y, x, corner)
                if not _exists(row, column, height, width):
                    row = -1  # no square there
                cells[y, x, corner, 0] = row
                cells[y, x, corner, 1] = column
                places[y, x, corner, 0] = down
                places[y, x, corner, 1] = across


@kernel
def _stored(cells, places, y, x, corner):
    return (
        np.int64(cells[y, x, corner, 0]),
        np.int64(cells[y, x, corner, 1]),
        np.float64(places[y, x, corner, 0]),
        np.float64(places[y, x, corner, 1]),
    )


@kernel
def _carry_rows(start, stop, potential, time, cells, places):
    width = potential.shape[1]
    for y in range(start, stop):
        for x in range(width):
            for corner in range(4):
                row, column, down, across = _stored(cells, places, y, x, corner)
                if row < 0:
                    continue
                row, column, down, across = _walk(potential, time, row, column, down, across)
                cells[y, x, corner, 0] = row
                cells[y, x, corner, 1] = column
                places[y, x, corner, 0] = down
                places[y, x, corner, 1] = across


@kernel
def _read_rows(start, stop, image, first, last, alpha, cells, places, nearest, rounded, out):
    width = image.shape[1]
    total = np.empty(image.shape[2])
    for y in range(start, stop):
        for x in range(width):
            total[:] = 0.0
            weight = 0.0
            for corner in range(4):
                row, column, down, across = _stored(cells, places, y, x, corner)
                if row < 0:
                    continue
                weight += add_sample(
                    image, first, last, alpha, row, column, down, across, nearest, total
                )
            _put(image, y, x, first, last, total, weight, rounded, out)
