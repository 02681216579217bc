# SPDX-License-Identifier: GPL-3.0-or-later
"""Line integral convolution: averages along the flow (Cabral, Leedom 1993; paper D, 4.10.1)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...base.checks import as_array
from ...base.parallel import kernel, run
from ...base.progress import ProgressCallback, phase, reporting
from ...errors import InvalidSignal
from ...settings import ConvolutionSettings
from .opacity import DEVIATION
from .randomness import FIRST, random_bits, row_key, stream
from .velocity import ROWS, Flow, Motion, wraps

_Singles = npt.NDArray[np.float32]
_Wraps = tuple[bool, bool]


def line_integral_convolution(
    velocity: npt.ArrayLike,
    noise: npt.ArrayLike | None = None,
    settings: ConvolutionSettings | None = None,
    *,
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
        What is averaged, any image; random values if left out.
    settings : ConvolutionSettings, optional
    size : (int, int), optional
        Rows and columns of the picture; those of `noise`, or of the velocity, if left out.
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
    settings = settings or ConvolutionSettings()
    with reporting(progress), phase(0.0, 1.0, "Drawing streaks"):
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
        joined = wraps(settings.periodic)
        rim = half + 2
        ways = _ways(motion, None, rim, joined)
        if given is None:
            values = np.empty(ways.shape[:2], dtype=np.float32)
            key = stream(settings.seed, 0, FIRST)
            run(_make_noise, len(values), key, rim, joined, values, chunk=ROWS)
        else:
            values = padded(given, rim, joined)
        out = np.empty(flow.size, dtype=np.float32)
        run(_convolve, len(out), ways, values, rim, half, out, chunk=ROWS)
        if settings.contrast > 0 and half > 0:
            _stretch(out, motion.defined, settings.contrast)
        out[~motion.defined] = 0.0
        return out


def short_convolution(
    motion: Motion, longest: float, values: _Singles, length: int, joined: _Wraps
) -> _Singles:
    """Average values along the flow, less far where it is slow.

    Parameters
    ----------
    motion : Motion
    longest : float
        The step of the fastest places, which go a pixel from sample to sample.
    values : (h, w) float32
    length : int
        In pixels; one sample more is taken.
    joined : (bool, bool)
        As `wraps` tells.

    Returns
    -------
    (h, w) float32
    """
    rim = length // 2 + 2
    ways = _ways(motion, longest, rim, joined)
    out = np.empty(values.shape, dtype=np.float32)
    run(_convolve, len(out), ways, padded(values, rim, joined), rim, length // 2, out, chunk=ROWS)
    return out


def padded(values: npt.NDArray, rim: int, joined: _Wraps) -> npt.NDArray:
    """Return an array with a rim: of what is on the other side, or of its outermost values."""
    rest = [(0, 0)] * (values.ndim - 2)
    wrap_x, wrap_y = joined
    wide = np.pad(values, [(0, 0), (rim, rim), *rest], mode="wrap" if wrap_x else "edge")
    return np.pad(wide, [(rim, rim), (0, 0), *rest], mode="wrap" if wrap_y else "edge")


def _ways(motion: Motion, longest: float | None, rim: int, joined: _Wraps) -> _Singles:
    # Steps (right, down) from sample to sample, at most a pixel long: (h + 2 rim, w + 2 rim, 2).
    ways = np.stack([motion.right, motion.down], axis=-1)
    if longest is None:
        length = np.hypot(motion.right, motion.down)[..., None]
        ways /= np.where(length > 0, length, np.float32(1.0))
    elif longest > 0:
        ways *= np.float32(1.0 / longest)
    return padded(ways, rim, joined)


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
def _convolve(start, stop, ways, values, rim, half, out):
    # Steps are of second order (Adams, Bashforth): they go on from the last two ways.
    for i in range(start, stop):
        for j in range(out.shape[1]):
            total = values[i + rim, j + rim]
            count = np.float32(1)
            for turn in range(2):
                sign = np.float32(1 - 2 * turn)
                u = ways[i + rim, j + rim, 0] * sign
                v = ways[i + rim, j + rim, 1] * sign
                x = np.float32(j + rim) + u
                y = np.float32(i + rim) + v
                for _ in range(half):
                    column = np.uint64(x)
                    row = np.uint64(y)
                    one = np.uint64(1)
                    across = x - np.float32(column)
                    down = y - np.float32(row)
                    a = values[row, column]
                    a += across * (values[row, column + one] - a)
                    b = values[row + one, column]
                    b += across * (values[row + one, column + one] - b)
                    total += a + down * (b - a)
                    count += np.float32(1)
                    a = ways[row, column, 0]
                    a += across * (ways[row, column + one, 0] - a)
                    b = ways[row + one, column, 0]
                    b += across * (ways[row + one, column + one, 0] - b)
                    new_u = sign * (a + down * (b - a))
                    a = ways[row, column, 1]
                    a += across * (ways[row, column + one, 1] - a)
                    b = ways[row + one, column, 1]
                    b += across * (ways[row + one, column + one, 1] - b)
                    new_v = sign * (a + down * (b - a))
                    x += np.float32(1.5) * new_u - np.float32(0.5) * u
                    y += np.float32(1.5) * new_v - np.float32(0.5) * v
                    u = new_u
                    v = new_v
            out[i, j] = total / count
