# SPDX-License-Identifier: GPL-3.0-or-later
"""Noise that moves with a flow, as gray frames (paper D, section 4)."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from ..base.checks import by_keyword
from ..base.parallel import kernel, run
from ..base.progress import ProgressCallback, one_of
from ..settings import NoiseSettings, given_or_default
from .convolution import short_convolution
from .loops import Frames, repeating
from .opacity import Look, checked_background, checked_colors
from .randomness import BESIDE, CHANGED, FIRST, random_bits, row_key, stream
from .velocity import ROWS, FieldOfTime, Flow, Motion, checked_frames, wraps

_Singles = npt.NDArray[np.float32]
_Bits = npt.NDArray[np.uint8]

_LEFT_OVER = 0.01
"""Largest share of the initial noise in the first frame."""

SHARES = 1 << 16
"""Unit of `rates`: shares of cells are multiples of it."""

# The fractional parts of multiples of the golden and the silver ratio are spread most evenly.
_TURN_X, _TURN_Y = 0.5 * (math.sqrt(5.0) - 1.0), math.sqrt(2.0) - 1.0


@by_keyword
def advect_noise(
    velocity: npt.ArrayLike | FieldOfTime,
    settings: NoiseSettings | None = None,
    *,
    frames: int = 100,
    size: tuple[int, int] | None = None,
    mask: npt.ArrayLike | None = None,
    background: npt.ArrayLike | None = None,
    colors: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> Frames:
    """Show a flow as moving noise: frames with streaks along the flow that move with it.

    Parameters
    ----------
    velocity : (h, w, 2) or (k, h, w, 2) array of float, or function
        To the right and up; rows go from top to bottom as in images. A steady velocity; or k key
        frames at even times, from the first frame to the last (in loops, the last key frame is
        followed by the first); or a function of a time from 0 to 1 that returns (h, w, 2). NaN
        where the flow is undefined.
    settings : NoiseSettings, optional
    frames : int
        Number of frames; see `flow_frames`.
    size : (int, int), optional
        Rows and columns of the frames, to which the velocity is interpolated. Default: those of the
        velocity.
    mask : (h, w) array of bool, optional
        Where the flow is defined, in the size of the velocity or of the frames.
    background : (h, w) or (h, w, 3) array of float, optional
        Shown where the flow is undefined, and through `NoiseSettings.speed_mask` and `noise_mask`.
        Default: black.
    colors : (n, 3) array of float, optional
        A color map of the speed, from 0 to the fastest. Pixels have the color of their speed, and
        the noise is their opacity, which needs a `noise_mask`.
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
    Paper D, section 4, with injection that grows with the divergence, as proposed there. Memory
    does not grow with the number of frames; closing the iterator frees it. The frames depend on
    the seed, not on the number of threads. The greatest speed of a function of time is that at 33
    times; longer steps in between are limited to it.

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
    settings = given_or_default(settings, NoiseSettings)
    count = checked_frames(frames, settings.loop)
    flow = Flow(velocity, size, mask, settings.step, settings.periodic, count, settings.loop > 0)
    behind = checked_background(background, flow.size)
    look = Look(flow.longest, settings, behind, checked_colors(colors))
    return reported(noise_frames(flow, settings, look), count, progress)


def reported(frames: Frames, count: int, progress: ProgressCallback | None) -> Frames:
    """Yield frames, and report the progress of each."""
    for number in range(count):
        with one_of(progress, number, count, "Advecting noise"):
            frame = next(frames)
        yield frame


def noise_frames(flow: Flow, settings: NoiseSettings, look: Look) -> Frames:
    """Yield the frames of `advect_noise` for a prepared flow."""

    def begin(first: int) -> Frames:
        return grays(Noise(flow.size, flow.longest, settings), flow.at, settings, first)

    for number, gray in enumerate(repeating(begin, flow.frames, settings.loop, mixed)):
        yield look.shown(gray, flow.at(number))


def grays(
    noise: Noise, motions: Callable[[float], Motion], settings: NoiseSettings, first: int
) -> Frames:
    """Yield the blended noise of the frames from `first` on; each is overwritten by the next."""
    # The start is the same for all frames of a loop, so that each frame continues the previous one.
    number = -settings.loop - _warm_up(settings.blending)
    while True:
        motion = motions(number)
        noise.step(motion, number)
        if number >= first:
            yield noise.smoothed(motion) if settings.convolution else noise.blended
        number += 1


def _warm_up(blending: float) -> int:
    """Return the number of steps after which the initial noise is hardly visible."""
    return math.ceil(math.log(_LEFT_OVER) / math.log1p(-blending)) if blending < 1 else 1


def mixed(old: _Singles, new: _Singles, share: float) -> _Singles:
    """Mix noise of two frames."""
    # Both are independent with equal variance; roots of the shares keep the contrast.
    old_share, new_share = np.float32(math.sqrt(1.0 - share)), np.float32(math.sqrt(share))
    middle = np.float32(0.5)
    return middle + old_share * (old - middle) + new_share * (new - middle)


class Noise:
    """Noise on a grid that moves from frame to frame.

    A cell has a value, 0 or 1, which it copies from another cell: steps are whole numbers of cells.
    The fraction of the step is the share of frames that round it up, so that the mean speed of the
    noise is that of the flow. Paper D, section 4.8, accumulates the fractions in each cell instead.
    Neighbors then step at different times, and values move faster than the flow: twice as fast
    where it is slow.

    Parameters
    ----------
    size : (int, int)
    longest : float
        Longest step, in cells.
    settings : NoiseSettings
    more : int
        Number of places outside the image from which cells may copy, for subclasses.

    Attributes
    ----------
    blended : (h, w) float32
        The blend of all frames so far.
    quads : (padded cells + more,) uint8
        The values that steps read: each cell with its neighbors to the right, below and both, in
        four bits, and the same for further places.
    places : (h, w) uint32
        Index in these of the source of each cell, by the motion of the last step.
    """

    def __init__(
        self, size: tuple[int, int], longest: float, settings: NoiseSettings, more: int = 0
    ) -> None:
        self._settings = settings
        self._longest = longest
        self._wraps = wraps(settings.periodic)
        rows, columns = size
        # A step may end a cell farther than it is long, and is read with the cell after.
        self._rim = math.ceil(longest) + 2
        padded = rows + 2 * self._rim, columns + 2 * self._rim
        self._noise: _Bits = np.empty(padded, dtype=np.uint8)
        self.quads: _Bits = np.zeros(padded[0] * padded[1] + more, dtype=np.uint8)
        self.places = np.zeros(size, dtype=np.uint32)
        self._rates = np.empty(size, dtype=np.uint16)
        self._motion: Motion | None = None
        self.blended: _Singles = np.full(size, 0.5, dtype=np.float32)
        key = stream(settings.seed, 0, FIRST)
        run(_begin, padded[0], key, self._noise, chunk=ROWS)
        self.make_ready(-(1 << 40))

    def step(self, motion: Motion, number: int) -> None:
        """Advance by a frame."""
        settings = self._settings
        if self._motion is not motion:
            self._motion = motion
            run(_find_rates, len(self._rates), motion.right, motion.down, motion.defined,
                settings.injection, settings.divergence, self._rates, chunk=ROWS)  # fmt: skip
            self.find_places(motion)
        run(_carry, len(self.blended), self._rim, self.quads, self.places, motion.right,
            motion.down, np.float32(number * _TURN_X % 1.0),
            np.float32(number * _TURN_Y % 1.0), np.float32(settings.blending), self._noise,
            self.blended, self._rates, stream(settings.seed, number, CHANGED),
            chunk=ROWS)  # fmt: skip
        self.make_ready(number)

    @property
    def cells(self) -> _Bits:
        """The values of the cells, 0 or 1: (h, w)."""
        rows, columns = self.blended.shape
        return self._noise[self._rim : self._rim + rows, self._rim : self._rim + columns]

    def smoothed(self, motion: Motion) -> _Singles:
        """Return the blended noise, smoothed along the flow."""
        settings = self._settings
        return short_convolution(
            motion, self._longest, self.blended, settings.convolution, self._wraps
        )

    def find_places(self, motion: Motion) -> None:
        """Find the source of each cell."""
        stride = self._noise.shape[1]
        run(_find_places, len(self.places), self._rim, stride, motion.right, motion.down,
            self.places, chunk=ROWS)  # fmt: skip

    def make_ready(self, number: int) -> None:
        """Fill the rim, and set `quads` for the next step."""
        key = stream(self._settings.seed, number, BESIDE)
        wrap_x, wrap_y = self._wraps
        inner = len(self._noise) - 2 * self._rim
        _fill_beside(self._rim, self._rim + inner, self._rim, wrap_x, key, self._noise)
        _fill_above_and_below(self._rim, wrap_x, wrap_y, key, self._noise)
        quads = self.quads[: self._noise.size].reshape(self._noise.shape)
        run(_join_quads, len(self._noise), self._noise, quads, chunk=8 * ROWS)


@kernel
def _begin(start, stop, key, noise):
    for i in range(start, stop):
        keys = row_key(key, i)
        for j in range(noise.shape[1]):
            noise[i, j] = random_bits(keys, j) & np.uint32(1)


@kernel
def _find_rates(start, stop, right, down, defined, injection, divergence, rates):
    # Where the flow is undefined, half of the cells change, which makes the noise new.
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
                # This share are copies of others; half of these have the right value by chance.
                rate = injection + divergence * 0.5 * max(spread, 0.0) / (1.0 + max(spread, 0.0))
            rates[i, j] = np.uint16(min(rate, 0.5) * SHARES + 0.5)


@kernel
def _find_places(start, stop, rim, stride, right, down, places):
    # A place lies between four cells, of which the first is read with the others.
    for i in range(start, stop):
        base = (i + rim - 1) * stride + rim - 1
        for j in range(right.shape[1]):
            whole_x, whole_y = np.floor(right[i, j]), np.floor(down[i, j])
            places[i, j] = base + j - int(whole_y) * stride - int(whole_x)


@kernel
def _carry(
    start, stop, rim, quads, places, right, down, turn_x, turn_y, alpha, new, blended, rates,
    key,
):  # fmt: skip
    # Loops over each row: the first reads the sources of its cells, and the compiler vectorizes the
    # others, which have 32 bits throughout.
    columns = right.shape[1]
    found = np.empty(columns, dtype=np.int32)
    one, first = np.float32(1), np.int32(1)
    bit, none, two = np.uint32(1), np.uint32(0), np.uint32(2)
    for i in range(start, stop):
        for j in range(columns):
            found[j] = quads[places[i, j]]
        for j in range(columns):
            quad = found[j]
            x = one - (right[i, j] - np.floor(right[i, j]))
            y = one - (down[i, j] - np.floor(down[i, j]))
            a, b = np.float32(quad & first), np.float32((quad >> first) & first)
            c = np.float32((quad >> np.int32(2)) & first)
            d = np.float32((quad >> np.int32(3)) & first)
            upper = a + x * (b - a)
            lower = c + x * (d - c)
            shown = upper + y * (lower - upper)
            blended[i, j] += alpha * (shown - blended[i, j])
        keys = row_key(key, i)
        for j in range(columns):
            x = right[i, j] - np.floor(right[i, j])
            y = down[i, j] - np.floor(down[i, j])
            # The step is a cell longer in a share of the frames that is its fraction.
            shift = (bit if x + turn_x < one else none) | (two if y + turn_y < one else none)
            share = random_bits(keys, np.uint32(j)) & np.uint32(0xFFFF)
            changes = bit if share < np.uint32(rates[i, j]) else none
            new[i + rim, j + rim] = np.uint8(((np.uint32(found[j]) >> shift) ^ changes) & bit)


@kernel
def _join_quads(start, stop, noise, quads):
    # Each cell with its neighbors to the right, below and both, in four bits: one is read.
    for i in range(start, min(stop, noise.shape[0] - 1)):
        for j in range(noise.shape[1] - 1):
            quads[i, j] = (
                noise[i, j]
                | (noise[i, j + 1] << 1)
                | (noise[i + 1, j] << 2)
                | (noise[i + 1, j + 1] << 3)
            )


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
