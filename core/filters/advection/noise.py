# SPDX-License-Identifier: GPL-3.0-or-later
"""Noise that moves with a flow, as gray frames (paper D, section 4)."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from ...base.parallel import kernel, run
from ...base.progress import ProgressCallback, one_of
from ...settings import NoiseSettings
from .convolution import short_convolution
from .loops import Frames, repeating
from .opacity import Look, checked_background, checked_colors
from .randomness import BESIDE, CHANGED, FIRST, random_bits, row_key, stream
from .velocity import ROWS, FieldOfTime, Flow, Motion, checked_frames, wraps

_Singles = npt.NDArray[np.float32]
_Bits = npt.NDArray[np.uint8]

_LEFT_OVER = 0.01
"""Share of the start that the first frame may still show."""

SHARES = 1 << 16
"""What `rates` count in: shares of cells are whole numbers of it."""


def advect_noise(
    velocity: npt.ArrayLike | FieldOfTime,
    settings: NoiseSettings | None = None,
    frames: int = 100,
    *,
    size: tuple[int, int] | None = None,
    mask: npt.ArrayLike | None = None,
    background: npt.ArrayLike | None = None,
    colors: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> Frames:
    """Show a flow as moving noise: each frame has streaks along it, and they move with it.

    Parameters
    ----------
    velocity : (h, w, 2) or (k, h, w, 2) array of float, or function
        To the right and up; rows go from top to bottom as in images. Steady; or at k moments that
        lie evenly in time, from the first frame to the last (in loops the first moment follows on
        the last); or a function of a time from 0 to 1 that returns (h, w, 2). NaN where the flow
        is undefined.
    settings : NoiseSettings, optional
    frames : int
        How many frames there are; see `flow_frames`.
    size : (int, int), optional
        Rows and columns of the frames; those of the velocity if left out. The velocity is
        interpolated.
    mask : (h, w) array of bool, optional
        Where the flow is defined, in the size of the velocity or of the frames.
    background : (h, w) or (h, w, 3) array of float, optional
        Shown where the flow is undefined and through `NoiseSettings.speed_mask` and `noise_mask`;
        black if left out.
    colors : (n, 3) array of float, optional
        A color map, from standing to fastest. Places then have the color of their speed, and the
        noise is their opacity: give a `noise_mask`.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Yields
    ------
    (h, w) float32
        In [0, 1]; (h, w, 3) with a colored background or `colors`.

    Raises
    ------
    InvalidSignal
        If the velocity, the mask, the background or the colors cannot be used.
    InvalidSettings
        If frames, size or the settings do not fit together.
    Cancelled
        If `progress` returned False.

    Notes
    -----
    Paper D, section 4, with injection that grows with the divergence, which it proposes. Memory
    does not grow with the number of frames; closing the iterator frees it. The frames depend on
    the seed, not on the number of threads. A function of time is asked at 33 moments for its
    greatest speed, and steps that are longer in between are cut to that.

    Examples
    --------
    Noise that turns round the middle, on a periodic image.

    >>> import numpy as np
    >>> from shock_filter import core
    >>> y, x = np.mgrid[1:-1:32j, -1:1:32j]
    >>> for frame in core.advect_noise(np.stack([-y, x], axis=-1), frames=3):
    ...     print(frame.shape, frame.dtype, round(float(frame.mean()), 1))
    (32, 32) float32 0.5
    (32, 32) float32 0.5
    (32, 32) float32 0.5
    """
    settings = settings or NoiseSettings()
    count = checked_frames(frames, settings.loop)
    flow = Flow(velocity, size, mask, settings.step, settings.periodic, count, settings.loop > 0)
    behind = checked_background(background, flow.size)
    look = Look(flow.longest, settings, behind, checked_colors(colors))
    return told(noise_frames(flow, settings, look), count, progress)


def told(frames: Frames, count: int, progress: ProgressCallback | None) -> Frames:
    """Yield frames, and report each."""
    for number in range(count):
        with one_of(progress, number, count, "Advecting noise"):
            frame = next(frames)
        yield frame


def noise_frames(flow: Flow, settings: NoiseSettings, look: Look) -> Frames:
    """Yield frames of noise for a flow that is ready; `advect_noise` says what they are."""

    def begin(first: int) -> Frames:
        return grays(Noise(flow.size, flow.longest, settings), flow.at, settings, first)

    for number, gray in enumerate(repeating(begin, flow.frames, settings.loop, mixed)):
        yield look.shown(gray, flow.at(number))


def grays(
    noise: Noise, motions: Callable[[float], Motion], settings: NoiseSettings, first: int
) -> Frames:
    """Yield the blended noise of the frames from `first` on; each is overwritten by the next."""
    # The start is the same for all frames of a loop, so that they go on from each other.
    number = -settings.loop - _run_in(settings.blending)
    while True:
        motion = motions(number)
        noise.step(motion, number)
        if number >= first:
            yield noise.smoothed(motion) if settings.convolution else noise.blended
        number += 1


def _run_in(blending: float) -> int:
    """Count the steps until hardly anything of the start shows."""
    return math.ceil(math.log(_LEFT_OVER) / math.log1p(-blending)) if blending < 1 else 1


def mixed(old: _Singles, new: _Singles, share: float) -> _Singles:
    """Mix noise of two frames."""
    # Both vary by as much and independently: roots of the shares keep the contrast.
    old_share, new_share = np.float32(math.sqrt(1.0 - share)), np.float32(math.sqrt(share))
    middle = np.float32(0.5)
    return middle + old_share * (old - middle) + new_share * (new - middle)


class Noise:
    """Noise on a grid, carried on from frame to frame.

    Each cell has a value, 0 or 1, and the place in it that is followed back: a fraction of the
    cell, which is what is left of its last step.

    Parameters
    ----------
    size : (int, int)
    longest : float
        Longest step, in cells.
    settings : NoiseSettings

    Attributes
    ----------
    blended : (h, w) float32
        What the frames so far show.
    rim : int
        Cells around the image.
    old : (h + 2 rim, w + 2 rim) uint8
        The noise.
    place_right, place_down : (h, w) float32
        The places in the cells.
    rates : (h, w) uint16
        How many cells change, see `SHARES`; those of the last step.
    """

    def __init__(self, size: tuple[int, int], longest: float, settings: NoiseSettings) -> None:
        self._settings = settings
        self._longest = longest
        self._wraps = wraps(settings.periodic)
        rows, columns = size
        # A step may end a cell farther than it is long, and is read with the cell after.
        self.rim = math.ceil(longest) + 2
        padded = rows + 2 * self.rim, columns + 2 * self.rim
        self.old: _Bits = np.empty(padded, dtype=np.uint8)
        self.new: _Bits = np.empty(padded, dtype=np.uint8)
        self.place_right: _Singles = np.empty(size, dtype=np.float32)
        self.place_down: _Singles = np.empty(size, dtype=np.float32)
        self.rates = np.empty(size, dtype=np.uint16)
        self._rates_of: Motion | None = None
        self.blended: _Singles = np.full(size, 0.5, dtype=np.float32)
        key = stream(settings.seed, 0, FIRST)
        run(
            _begin,
            padded[0],
            key,
            self.rim,
            self.old,
            self.place_right,
            self.place_down,
            chunk=ROWS,
        )
        self._fill_rim(self.old, -1)

    def step(self, motion: Motion, number: int) -> None:
        """Go on by a frame."""
        settings = self._settings
        if self._rates_of is not motion:
            run(_find_rates, len(self.rates), motion.right, motion.down, motion.defined,
                settings.injection, settings.divergence, self.rates, chunk=ROWS)  # fmt: skip
            self._rates_of = motion
        changed = stream(settings.seed, number, CHANGED)
        run(_carry, len(self.blended), self.rim, self.old, motion.right, motion.down,
            self.place_right, self.place_down, np.float32(settings.blending), self.new,
            self.blended, self.rates, changed, chunk=ROWS)  # fmt: skip
        self._fill_rim(self.new, number)
        self.old, self.new = self.new, self.old

    def smoothed(self, motion: Motion) -> _Singles:
        """Return the blended noise, smoothed along the flow."""
        settings = self._settings
        return short_convolution(
            motion, self._longest, self.blended, settings.convolution, self._wraps
        )

    def _fill_rim(self, noise: _Bits, number: int) -> None:
        key = stream(self._settings.seed, number, BESIDE)
        wrap_x, wrap_y = self._wraps
        inner = len(noise) - 2 * self.rim
        _fill_beside(self.rim, self.rim + inner, self.rim, wrap_x, key, noise)
        _fill_above_and_below(self.rim, wrap_x, wrap_y, key, noise)


@kernel
def _begin(start, stop, key, rim, noise, right, down):
    rows, columns = right.shape
    for i in range(start, stop):
        keys = row_key(key, i)
        for j in range(noise.shape[1]):
            bits = random_bits(keys, j)
            noise[i, j] = bits & np.uint32(1)
            if rim <= i < rim + rows and rim <= j < rim + columns:
                right[i - rim, j - rim] = np.float32((bits >> np.uint32(1)) & 0x7FFF) / SHARES * 2
                down[i - rim, j - rim] = np.float32(bits >> np.uint32(16)) / SHARES


@kernel
def _find_rates(start, stop, right, down, defined, injection, divergence, rates):
    # Where the flow is undefined, half of the cells change: that makes fresh noise of any.
    rows, columns = right.shape
    for i in range(start, stop):
        above = max(i - 1, 0)
        below = min(i + 1, rows - 1)
        for j in range(columns):
            before = max(j - 1, 0)
            after = min(j + 1, columns - 1)
            rate = 0.5
            if defined[i, j]:
                spread = 0.0
                if defined[i, before] and defined[i, after] and after > before:
                    spread += (right[i, after] - right[i, before]) / (after - before)
                if defined[above, j] and defined[below, j] and below > above:
                    spread += (down[below, j] - down[above, j]) / (below - above)
                # So many are copies of others, and half of them have the right value by chance.
                rate = injection + divergence * 0.5 * max(spread, 0.0) / (1.0 + max(spread, 0.0))
            rates[i, j] = np.uint16(min(rate, 0.5) * SHARES + 0.5)


@kernel
def _carry(
    start, stop, rim, old, right, down, place_right, place_down, alpha, new, blended, rates, key
):
    for i in range(start, stop):
        for j in range(right.shape[1]):
            x = place_right[i, j] - right[i, j]
            y = place_down[i, j] - down[i, j]
            left = np.floor(x)
            top = np.floor(y)
            x -= left
            y -= top
            place_right[i, j] = x
            place_down[i, j] = y
            row = np.uint64(i + rim + np.int32(top))
            column = np.uint64(j + rim + np.int32(left))
            a = old[row, column]
            one = np.uint64(1)
            upper = np.float32(a) + x * (np.float32(old[row, column + one]) - np.float32(a))
            c = np.float32(old[row + one, column])
            lower = c + x * (np.float32(old[row + one, column + one]) - c)
            shown = upper + y * (lower - upper)
            blended[i, j] += alpha * (shown - blended[i, j])
            new[i + rim, j + rim] = a
        keys = row_key(key, i)
        for j in range(right.shape[1]):
            changes = (random_bits(keys, j) & np.uint32(0xFFFF)) < rates[i, j]
            new[i + rim, j + rim] ^= np.uint8(changes)


@kernel
def _fill_beside(start, stop, rim, wrap_x, key, noise):
    # The rim to the left and to the right, in rows of the padded image.
    columns = noise.shape[1] - 2 * rim
    for i in range(start, stop):
        keys = row_key(key, i)
        for k in range(2 * rim):
            j = k if k < rim else columns + k
            if wrap_x:
                noise[i, j] = noise[i, rim + (j - rim) % columns]
            else:
                noise[i, j] = random_bits(keys, j) & np.uint32(1)


@kernel
def _fill_above_and_below(rim, wrap_x, wrap_y, key, noise):
    rows, columns = noise.shape[0] - 2 * rim, noise.shape[1] - 2 * rim
    for k in range(2 * rim):
        i = k if k < rim else rows + k
        keys = row_key(key, i)
        for j in range(noise.shape[1]):
            if wrap_y:
                noise[i, j] = noise[rim + (i - rim) % rows, j]
            else:
                place = rim + (j - rim) % columns if wrap_x else j
                noise[i, j] = random_bits(keys, place) & np.uint32(1)
