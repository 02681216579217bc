# SPDX-License-Identifier: GPL-3.0-or-later
"""Line integral convolution: averages along the flow (Cabral, Leedom 1993; paper D, 4.10.1)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.checks import as_array, by_keyword, checked_size
from ..base.parallel import kernel, run
from ..base.progress import ProgressCallback, phase, reporting
from ..errors import InvalidSignal
from ..settings import ConvolutionSettings, given_or_default
from .opacity import DEVIATION
from .randomness import FIRST, random_bits, row_key, stream
from .velocity import ROWS, Flow, Motion, wraps

_Singles = npt.NDArray[np.float32]
_Wraps = tuple[bool, bool]

_STEP_SCALE, _VALUE_SCALE = np.float32(32767), np.float32(1 << 23)
_BLOCK = 256


@by_keyword
def line_integral_convolution(
    velocity: npt.ArrayLike,
    settings: ConvolutionSettings | None = None,
    *,
    noise: npt.ArrayLike | None = None,
    size: tuple[int, int] | None = None,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> _Singles:
    """Draw a still picture of a flow: noise, averaged along it.

    Parameters
    ----------
    velocity : (h, w, 2) array of float
        To the right and up; rows go from top to bottom as in images. Only its direction counts.
        NaN where the flow is undefined.
    noise : (h, w) array of float in [0, 1], optional
        The image to average. Default: random values.
    settings : ConvolutionSettings, optional
    size : (int, int), optional
        Rows and columns of the picture. Default: those of `noise`, or else of the velocity.
    mask : (h, w) array of bool, optional
        Where the flow is defined, in the size of the velocity or of the picture.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    (h, w) float32
        In [0, 1]; 0 where the flow is undefined. A length of 0 returns the noise there.

    Raises
    ------
    InvalidSignal
        If the velocity, the noise or the mask cannot be used.
    InvalidSettings
        If the size cannot be used.
    Cancelled
        If `progress` returned False.

    Examples
    --------
    Streaks from left to right:

    >>> import numpy as np
    >>> from shock_filter import core
    >>> streaks = core.line_integral_convolution(np.full((64, 64, 2), [1.0, 0.0]))
    >>> rough = [float(np.abs(np.diff(streaks, axis=axis)).mean()) for axis in (0, 1)]
    >>> rough[0] > 4 * rough[1]
    True
    """
    settings = given_or_default(settings, ConvolutionSettings)
    with reporting(progress), phase(0.0, 1.0, "Drawing streaks"):
        size = None if size is None else checked_size(size)
        given = None if noise is None else _checked_noise(noise, size)
        if given is not None:
            size = given.shape  # type: ignore[assignment]
        flow = Flow(velocity, size, mask, 1.0, settings.periodic)
        if not flow.steady:
            raise InvalidSignal(
                "The velocity changes with time; give the (h, w, 2) of one moment, or use"
                " advect_noise."
            )
        motion = flow.at(0)
        half = round(0.5 * settings.length)
        rim = half + 2
        joined = wraps(settings.periodic)
        # Random values continue beyond the border, so that streaks do not change there.
        if given is None:
            values = np.empty([count + 2 * rim for count in flow.size], dtype=np.float32)
            key = stream(settings.seed, 0, FIRST)
            run(_make_noise, len(values), key, rim, joined, values, chunk=ROWS)
        else:
            values = given
        out = _convolved(motion, values, rim, half, joined)
        if settings.contrast > 0 and half > 0:
            _stretch(out, motion.defined, settings.contrast)
        out[~motion.defined] = 0.0
        return out


def short_convolution(
    motion: Motion, longest: float, values: _Singles, length: int, joined: _Wraps
) -> _Singles:
    """Average values along the flow, over shorter distances where it is slow.

    Parameters
    ----------
    motion : Motion
    longest : float
        The largest step of the flow. Samples are a pixel apart there.
    values : (h, w) float32
    length : int
        In pixels; one sample more is taken.
    joined : (bool, bool)
        As returned by `wraps`.

    Returns
    -------
    (h, w) float32
    """
    half = length // 2
    rim = half + 2
    wide = np.empty([count + 2 * rim for count in values.shape], dtype=np.float32)
    run(_widen, len(wide), values, motion.defined, rim, joined, wide, chunk=ROWS)
    out = np.empty(values.shape, dtype=np.float32)
    scale = np.float32(1.0 / longest if longest > 0 else 0.0)
    run(_convolve_straight, len(out), wide.reshape(-1), wide.shape[1], rim, half, motion.right,
        motion.down, scale, out, chunk=ROWS)  # fmt: skip
    return out


def _convolved(motion: Motion, values: _Singles, rim: int, half: int, joined: _Wraps) -> _Singles:
    # Each step is one pixel long.
    size = motion.right.shape
    packed = np.empty([count + 2 * rim for count in size], dtype=np.int64)
    run(_pack, len(packed), *motion, values, rim, joined, packed, chunk=ROWS)
    out = np.empty(size, dtype=np.float32)
    run(_convolve, len(out), packed.reshape(-1), packed.shape[1], rim, half, out,
        chunk=ROWS)  # fmt: skip
    return out


def _checked_noise(noise: npt.ArrayLike, size: tuple[int, int] | None) -> _Singles:
    given = as_array(noise, "noise")
    if given.ndim != 2 or given.size == 0 or (size is not None and given.shape != tuple(size)):
        wanted = "(h, w)" if size is None else f"{tuple(size)}"
        raise InvalidSignal(f"The noise has the shape {given.shape}; give {wanted}.")
    if given.dtype.kind != "f" or not np.isfinite(given).all():
        raise InvalidSignal("The noise holds NaN, infinity or no floats; give values in [0, 1].")
    return np.clip(given, 0.0, 1.0).astype(np.float32)


def _stretch(values: _Singles, defined: npt.NDArray[np.bool_], contrast: float) -> None:
    inside = values[defined]
    if len(inside) == 0:
        return
    mean = inside.mean(dtype=np.float64)
    deviation = inside.std(dtype=np.float64)
    gain = contrast * DEVIATION / deviation if deviation > 1e-6 else 1.0
    values -= np.float32(mean)
    values *= np.float32(gain)
    values += np.float32(mean)
    np.clip(values, 0.0, 1.0, out=values)


@kernel
def _make_noise(start, stop, key, rim, joined, values):
    wrap_x, wrap_y = joined
    rows, columns = values.shape[0] - 2 * rim, values.shape[1] - 2 * rim
    for i in range(start, stop):
        keys = row_key(key, (i - rim) % rows if wrap_y else i)
        for j in range(values.shape[1]):
            bits = random_bits(keys, (j - rim) % columns if wrap_x else j)
            values[i, j] = np.float32(bits >> np.uint32(8)) * np.float32(2.0**-24)


@kernel
def _pack(start, stop, right, down, defined, values, rim, joined, packed):
    # A direction and a value share 64 bits, so that memory is read once for both. The value's bits
    # are inverted where an average ends, which makes it negative.
    rows, columns = right.shape
    wrap_x, wrap_y = joined
    everywhere = values.shape[0] > rows
    directions = np.empty(columns, dtype=np.int32)
    for i in range(start, stop):
        y = (i - rim) % rows if wrap_y else min(max(i - rim, 0), rows - 1)
        beyond = y != i - rim and not wrap_y and not everywhere
        for j in range(columns):
            u, v = right[y, j], down[y, j]
            factor = np.float32(1) / np.sqrt(max(u * u + v * v, np.float32(1e-37)))
            low = np.int32(np.rint(u * factor * _STEP_SCALE)) & np.int32(0xFFFF)
            directions[j] = np.int32(
                low | np.int32(np.int32(np.rint(v * factor * _STEP_SCALE)) << 16)
            )
        for j in range(columns):
            value = values[i, j + rim] if everywhere else values[y, j]
            high = np.int32(value * _VALUE_SCALE)
            high = high if defined[y, j] and not beyond else np.int32(~high)
            packed[i, j + rim] = (np.int64(high) << 32) | np.int64(np.uint32(directions[j]))
        for k in range(2 * rim):
            j = k if k < rim else columns + k
            if wrap_x:
                packed[i, j] = packed[i, rim + (j - rim) % columns]
            else:
                x = 0 if k < rim else columns - 1
                high = np.int32((values[i, j] if everywhere else values[y, x]) * _VALUE_SCALE)
                high = high if everywhere and defined[y, x] else np.int32(~high)
                packed[i, j] = (np.int64(high) << 32) | np.int64(np.uint32(packed[i, rim + x]))


@kernel
def _widen(start, stop, values, defined, rim, joined, wide):
    # Values with a rim; where an average ends, -1 minus the value.
    rows, columns = values.shape
    wrap_x, wrap_y = joined
    for i in range(start, stop):
        y = (i - rim) % rows if wrap_y else min(max(i - rim, 0), rows - 1)
        beyond = y != i - rim and not wrap_y
        for j in range(columns):
            value = values[y, j]
            wide[i, j + rim] = value if defined[y, j] and not beyond else -np.float32(1) - value
        for k in range(2 * rim):
            j = k if k < rim else columns + k
            if wrap_x:
                wide[i, j] = wide[i, rim + (j - rim) % columns]
            else:
                value = values[y, 0 if k < rim else columns - 1]
                wide[i, j] = -np.float32(1) - value


@kernel
def _convolve_straight(start, stop, values, stride, rim, half, right, down, scale, out):
    # The flow hardly turns over so few pixels. Blocks of pixels take each sample together, in short
    # loops over few arrays, which the compiler vectorizes.
    columns = out.shape[1]
    total, count = np.empty(_BLOCK, np.float32), np.empty(_BLOCK, np.float32)
    across, below = np.empty(_BLOCK, np.float32), np.empty(_BLOCK, np.float32)
    alive = np.empty(_BLOCK, np.float32)
    index = np.empty(_BLOCK, np.uint32)
    read = np.empty((4, _BLOCK), np.float32)
    one, row = np.uint64(1), np.uint64(stride)
    for i in range(start, stop):
        for first in range(0, columns, _BLOCK):
            size = min(_BLOCK, columns - first)
            u, v = right[i, first : first + size], down[i, first : first + size]
            here = values[(i + rim) * stride + first + rim :][:size]
            for j in range(size):
                total[j] = max(here[j], -np.float32(1) - here[j])
                count[j] = 1
            for side in range(2):
                for j in range(size):
                    alive[j] = here[j] >= 0 and (u[j] != 0 or v[j] != 0)
                for sample in range(1, half + 1):
                    far = scale * np.float32(sample - 2 * sample * side)
                    for j in range(size):
                        x = np.float32(first + rim + j) + far * u[j]
                        y = np.float32(i + rim) + far * v[j]
                        cell_x, cell_y = np.int32(x), np.int32(y)
                        across[j] = x - np.float32(cell_x)
                        below[j] = y - np.float32(cell_y)
                        index[j] = np.uint32(cell_y * np.int32(stride) + cell_x)
                    for j in range(size):
                        place = np.uint64(index[j])
                        read[0, j] = values[place]
                        read[1, j] = values[place + one]
                        read[2, j] = values[place + row]
                        read[3, j] = values[place + row + one]
                    _add_read(size, read, across, below, alive, total, count)
            for j in range(size):
                out[i, first + j] = total[j] / count[j]


@kernel
def _add_read(size, read, across, below, alive, total, count):
    a, b, c, d = read[0], read[1], read[2], read[3]
    half, one = np.float32(0.5), np.float32(1)
    for j in range(size):
        upper = a[j] if across[j] < half else b[j]
        lower = c[j] if across[j] < half else d[j]
        alive[j] = alive[j] if (upper if below[j] < half else lower) >= 0 else np.float32(0)
    for j in range(size):
        e, f = max(a[j], -one - a[j]), max(b[j], -one - b[j])
        g, h = max(c[j], -one - c[j]), max(d[j], -one - d[j])
        total[j] += alive[j] * _between(e, f, g, h, across[j], below[j])
        count[j] += alive[j]


@kernel
def _convolve(start, stop, packed, stride, rim, half, out):
    # Blocks of pixels take each sample together, in short loops over few arrays, which the compiler
    # vectorizes.
    columns = out.shape[1]
    x, y = np.empty(_BLOCK, np.float32), np.empty(_BLOCK, np.float32)
    u, v = np.empty(_BLOCK, np.float32), np.empty(_BLOCK, np.float32)
    total, count = np.empty(_BLOCK, np.float32), np.empty(_BLOCK, np.float32)
    across, below = np.empty(_BLOCK, np.float32), np.empty(_BLOCK, np.float32)
    flow_x, flow_y = np.empty(_BLOCK, np.float32), np.empty(_BLOCK, np.float32)
    alive = np.empty(_BLOCK, np.float32)
    index = np.empty(_BLOCK, np.uint32)
    words = np.empty((4, _BLOCK), np.int64)
    directions = np.empty((4, _BLOCK), np.int32)
    values = np.empty((4, _BLOCK), np.float32)
    wide = np.int32(stride)
    one, row = np.uint64(1), np.uint64(stride)
    for i in range(start, stop):
        for first in range(0, columns, _BLOCK):
            size = min(_BLOCK, columns - first)
            base = (i + rim) * stride + first + rim
            for j in range(size):
                here = packed[np.uint64(base + j)]
                high = np.int32(here >> 32)
                total[j] = np.float32(high ^ np.int32(high >> 31)) / _VALUE_SCALE
                count[j] = 1
            for side in range(2):
                sign = np.float32(1 - 2 * side)
                for j in range(size):
                    here = packed[np.uint64(base + j)]
                    u[j] = _right(np.int32(here)) * (sign / _STEP_SCALE)
                    v[j] = _down(np.int32(here)) * (sign / _STEP_SCALE)
                    x[j] = np.float32(first + j + rim) + u[j]
                    y[j] = np.float32(i + rim) + v[j]
                    alive[j] = here >= 0 and (u[j] != 0 or v[j] != 0)
                for sample in range(half):
                    _locate(size, x, across, index, np.int32(1), np.uint32(0))
                    _locate(size, y, below, index, wide, np.uint32(1))
                    for j in range(size):
                        place = np.uint64(index[j])
                        words[0, j] = packed[place]
                        words[1, j] = packed[place + one]
                        words[2, j] = packed[place + row]
                        words[3, j] = packed[place + row + one]
                    for corner in range(4):
                        _split(size, words[corner], directions[corner], values[corner])
                    _end(size, words, across, below, alive)
                    _add(size, values, across, below, alive, total, count)
                    if sample == half - 1:
                        break
                    _interpolate(size, directions, across, below, flow_x, flow_y)
                    for j in range(size):
                        square = flow_x[j] * flow_x[j] + flow_y[j] * flow_y[j]
                        across[j] = sign / np.sqrt(max(square, np.float32(1)))
                    _advance(size, x, u, flow_x, across, alive)
                    _advance(size, y, v, flow_y, across, alive)
            for j in range(size):
                out[i, first + j] = total[j] / count[j]


@kernel
def _locate(size, x, share, index, stride, keep):
    for j in range(size):
        cell = np.int32(x[j])
        share[j] = x[j] - np.float32(cell)
        index[j] = keep * index[j] + np.uint32(cell * stride)


@kernel
def _split(size, words, directions, values):
    for j in range(size):
        high = np.int32(words[j] >> 32)
        directions[j] = np.int32(words[j])
        values[j] = np.float32(high ^ np.int32(high >> 31)) * (np.float32(1) / _VALUE_SCALE)


@kernel
def _end(size, words, across, below, alive):
    a, b, c, d = words[0], words[1], words[2], words[3]
    half = np.float32(0.5)
    for j in range(size):
        upper = a[j] if across[j] < half else b[j]
        lower = c[j] if across[j] < half else d[j]
        nearest = upper if below[j] < half else lower
        alive[j] = alive[j] if nearest >= 0 else np.float32(0)


@kernel
def _add(size, values, across, below, alive, total, count):
    a, b, c, d = values[0], values[1], values[2], values[3]
    for j in range(size):
        total[j] += alive[j] * _between(a[j], b[j], c[j], d[j], across[j], below[j])
    for j in range(size):
        count[j] += alive[j]


@kernel
def _interpolate(size, directions, across, below, flow_x, flow_y):
    a, b, c, d = directions[0], directions[1], directions[2], directions[3]
    for j in range(size):
        flow_x[j] = _between(
            _right(a[j]), _right(b[j]), _right(c[j]), _right(d[j]), across[j], below[j]
        )
    for j in range(size):
        flow_y[j] = _between(
            _down(a[j]), _down(b[j]), _down(c[j]), _down(d[j]), across[j], below[j]
        )


@kernel
def _advance(size, x, last, direction, factor, alive):
    # A second-order step (Adams-Bashforth), from this direction and the previous one.
    for j in range(size):
        new = direction[j] * factor[j]
        x[j] += alive[j] * (np.float32(1.5) * new - np.float32(0.5) * last[j])
        last[j] = new


@kernel
def _right(direction):
    return np.float32(np.int32(np.int32(direction << 16) >> 16))


@kernel
def _down(direction):
    return np.float32(np.int32(direction >> 16))


@kernel
def _between(a, b, c, d, across, below):
    upper = a + across * (b - a)
    lower = c + across * (d - c)
    return upper + below * (lower - upper)
