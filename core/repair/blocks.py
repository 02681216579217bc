# SPDX-License-Identifier: GPL-3.0-or-later
"""Removal of the blocks of JPEG compression, found by the grid of its rounded coefficients."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.checks import LARGEST, SCALES, by_keyword, checked_image, checked_weights
from ..base.findings import tell
from ..base.progress import ProgressCallback, ask, phase, reporting
from ..grid.channels import opacity_channel
from ..settings import BlockSettings, given_or_default

Floats = npt.NDArray[np.floating]

BLOCK = 8

_LUMA = np.array([0.299, 0.587, 0.114])

_STANDARD = np.array([
    [16, 11, 10, 16, 24, 40, 51, 61], [12, 12, 14, 19, 26, 58, 60, 55],
    [14, 13, 16, 24, 40, 57, 69, 56], [14, 17, 22, 29, 51, 87, 80, 62],
    [18, 22, 37, 56, 68, 109, 103, 77], [24, 35, 55, 64, 81, 104, 113, 92],
    [49, 64, 78, 87, 103, 121, 120, 101], [72, 92, 95, 98, 112, 100, 103, 99],
], dtype=np.float64)  # fmt: skip
"""The quantization table of brightness that nearly all encoders scale (ITU-T T.81, annex K)."""

_COLOR = np.full((8, 8), 99.0)
_COLOR[:4, :4] = [[17, 18, 24, 47], [18, 21, 26, 66], [24, 26, 56, 99], [47, 66, 99, 99]]
"""The quantization table of color."""

_STEPS = 3, 64
"""Smallest and largest quantization steps that are tested."""

_SURE = 6.0
"""Least fit of a quality to the coefficients, in standard errors."""

_FEW = 24
"""Fewest coefficients, larger than 3/4 of a step, from which the step is tested."""

_OTHER_GRIDS = (4, 4), (4, 0), (0, 4)
"""Shifts of grids on which the coefficients of a compressed picture are not multiples of steps."""

_ELSEWHERE = 0.5
"""Largest fit on those grids, over that on the picture's own grid. Soft pictures, which are not
compressed, fit alike on all grids."""

_SHIFTS = 2
"""Distance between the grids whose results are averaged, in pixels."""

_THRESHOLD = 0.3
"""Coefficients on other grids below this share of a step are set to 0 in the first estimate."""

_NOISE = 0.25
"""Standard deviation of the rounding, in steps."""


class Compression(NamedTuple):
    """The compression of a picture.

    Attributes
    ----------
    quality : float
        From 1 to 100, as in most encoders, which scale their table by it.
    offset : (int, int)
        Row and column of the first whole block.
    times : int
        By which whole factor pixels were repeated since.
    """

    quality: float
    offset: tuple[int, int]
    times: int


@by_keyword
def remove_blocks(
    image: npt.ArrayLike,
    settings: BlockSettings | None = None,
    *,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> npt.NDArray:
    """Remove the blocks and ringing of JPEG compression, and keep edges.

    Parameters
    ----------
    image : (h, w) or (h, w, c) array
        Bytes, 16 bits, or floats in [0, 1], as they were encoded: sRGB as sRGB.
    settings : BlockSettings, optional
    mask : (h, w) array of float in [0, 1], optional
        1 takes the result, less mixes it with the image, 0 keeps the image bit for bit.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    array like `image`
        Pictures without blocks stay bit for bit, and so does opacity. A strength of 0 changes
        nothing.

    Raises
    ------
    InvalidSignal
        If the image cannot be filtered.
    Cancelled
        If the callback says so.

    Notes
    -----
    In a compressed picture, the cosine coefficients of blocks of 8 x 8 pixels are near multiples of
    quantization steps, which reveals the grid and the quality. The original is estimated on shifted
    grids (Nosratinia 2001): a first estimate without small coefficients gives the signal power for
    a Wiener filter of the coefficients, and the results on all grids are averaged.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> image = np.random.default_rng(0).random((64, 64)).astype(np.float32)
    >>> bool((core.remove_blocks(image) == image).all())
    True
    """
    given = checked_image(image, LARGEST)
    settings = given_or_default(settings, BlockSettings)
    weights = checked_weights(mask, given)
    pixels = given.reshape(*given.shape[:2], -1)
    with reporting(progress):
        with phase(0.0, 0.2, "Looking for blocks"):
            found = None if settings.strength == 0 else compression_of(pixels)
        if found is None:
            if settings.strength > 0:
                tell("There are no blocks of JPEG compression.")
            return given.copy()
        tell("Blocks of JPEG compression of quality {quality:.0f}.", quality=found.quality)
        with phase(0.2, 1.0, "Removing blocks"):
            result = _without_blocks(pixels, found, settings.strength)
    if weights is not None:
        result = pixels + weights[..., None] * (result - pixels)
    if given.dtype.kind == "u":
        result = np.rint(result)
    result = np.clip(result, pixels.min(axis=(0, 1)), pixels.max(axis=(0, 1)))
    out = result.astype(given.dtype)
    if weights is not None:
        np.copyto(out, pixels, where=(weights == 0)[..., None])
    return out.reshape(given.shape)


def compression_of(pixels: npt.NDArray) -> Compression | None:
    """Find the compression of a picture (h, w, c); None if there are no traces of it."""
    times = _repeats(pixels)
    bright = _brightness(pixels[::times, ::times])
    if min(bright.shape) < 4 * BLOCK:
        return None
    offset = _phase_of(bright), _phase_of(bright.T)
    for place in dict.fromkeys([(0, 0), offset]):
        ask()
        quality = _quality(bright[place[0] :, place[1] :])
        if quality is not None:
            return Compression(quality, place, times)
    return None


def _repeats(pixels: npt.NDArray) -> int:
    # The largest whole factor by which pixels are repeated.
    for times in (8, 6, 4, 3, 2):
        height, width = (n - n % times for n in pixels.shape[:2])
        if min(height, width) < 4 * BLOCK * times or pixels.shape[:2] != (height, width):
            continue
        first = pixels[::times, ::times]
        if all((pixels[y::times, x::times] == first).all()
               for y in range(times) for x in range(times)):  # fmt: skip
            return times
    return 1


def _brightness(pixels: npt.NDArray) -> Floats:
    # The brightness, from 0 to 255.
    scale = 255.0 * SCALES[pixels.dtype.name]
    alpha = opacity_channel(pixels.shape[2], "auto")
    colors = pixels if alpha < 0 else pixels[..., :alpha]
    if colors.shape[2] == 3:
        return scale * (colors @ _LUMA)
    return scale * colors.mean(axis=2)


def _phase_of(bright: Floats) -> int:
    # The row, modulo the block size, at which steps exceed those beside them most.
    steps = np.abs(np.diff(bright, axis=0))
    beside = np.abs(steps[1:-1]) - 0.5 * (steps[:-2] + steps[2:])
    means = [beside[k::BLOCK].mean() for k in range(BLOCK)]
    return (int(np.argmax(means)) + 2) % BLOCK


def _quality(bright: Floats) -> float | None:
    # The quality that fits the coefficients of whole blocks best; None if none fits well, or if it
    # fits other grids too.
    coefficients = _coefficients(bright)
    if coefficients is None:
        return None
    fits = [(*_fit(coefficients, quality), quality) for quality in range(5, 96)]
    sure, mean, quality = max(fits)
    if sure <= _SURE or mean <= 0.3:
        return None
    for down, right in _OTHER_GRIDS:
        others = _coefficients(bright[down:, right:])
        if others is not None and _fit(others, quality)[0] > _ELSEWHERE * sure:
            return None
    # Repeated blocks, as on sheets of sprites, are counted once.
    distinct = np.unique(coefficients[:, :4, :4].reshape(-1, 16).round(3), axis=0)
    sure = _fit(distinct.reshape(-1, 4, 4), quality)[0]
    return float(quality) if sure > _SURE else None


def _coefficients(bright: Floats) -> Floats | None:
    # The cosine coefficients of all whole blocks, (n, 8, 8); None if there are too few.
    height, width = (n - n % BLOCK for n in bright.shape)
    if min(height, width) < 2 * BLOCK:
        return None
    return _transformed(_blocks(bright[:height, :width] - 128.0)).reshape(-1, 8, 8)


def _fit(coefficients: Floats, quality: int) -> tuple[float, float]:
    # How close coefficients are to multiples of the steps of a quality: the sum of cosines in
    # standard errors, and their mean.
    table = _table(_STANDARD, quality)
    total, count = 0.0, 0
    for v in range(4):
        for u in range(4):
            step = table[v, u]
            if not _STEPS[0] <= step <= _STEPS[1] or u + v == 0:
                continue
            values = coefficients[:, v, u]
            values = values[np.abs(values) > 0.75 * step]
            if len(values) < _FEW:
                continue
            total += np.cos(2 * np.pi / step * values).sum()
            count += len(values)
    return (total / np.sqrt(0.5 * count) if count >= _FEW else 0.0), total / max(count, 1)


def _table(standard: Floats, quality: float) -> Floats:
    # Scales a quantization table as the Independent JPEG Group does.
    factor = 5000.0 / quality if quality < 50 else 200.0 - 2.0 * quality
    return np.clip(np.floor((standard * factor + 50.0) / 100.0), 1.0, 255.0)


def _without_blocks(pixels: npt.NDArray, found: Compression, strength: float) -> Floats:
    times = found.times
    small = pixels[::times, ::times].astype(np.float64)
    scale = 255.0 * SCALES[pixels.dtype.name]
    alpha = opacity_channel(pixels.shape[2], "auto")
    colors = np.delete(small, alpha, axis=2) if alpha >= 0 else small
    planes = (np.moveaxis(colors, 2, 0) * scale).astype(np.float32)
    luma = strength * _table(_STANDARD, found.quality)
    chroma = strength * _table(_COLOR, found.quality)
    if len(planes) == 3:
        forward = np.array([_LUMA, [-0.168736, -0.331264, 0.5], [0.5, -0.418688, -0.081312]])
        planes = np.tensordot(forward.astype(np.float32), planes, 1)
        planes = np.stack([
            _smoothed(plane, luma if k == 0 else chroma, k / 3)
            for k, plane in enumerate(planes)
        ])  # fmt: skip
        planes = np.tensordot(np.linalg.inv(forward), planes, 1)
    else:
        planes = np.stack([_smoothed(plane, luma, k / len(planes)) for k, plane in
                           enumerate(planes)])  # fmt: skip
    result = small.copy()
    channels = [c for c in range(small.shape[2]) if c != alpha]
    result[..., channels] = np.moveaxis(planes, 0, 2) / scale
    return result.repeat(times, 0).repeat(times, 1)


def _smoothed(plane: Floats, table: Floats, done: float) -> Floats:
    # Thresholding, then a Wiener filter with the signal power that thresholding leaves.
    steps = table.reshape(-1).astype(np.float32)
    threshold, noise = _THRESHOLD * steps, (_NOISE * steps) ** 2

    def cut(coefficients: Floats, _: Floats) -> Floats:
        kept = np.abs(coefficients) > threshold
        kept[:, 0] = True
        return coefficients * kept

    def weigh(coefficients: Floats, guide: Floats) -> Floats:
        power = guide * guide
        share = power / (power + noise)
        share[:, 0] = 1.0
        return coefficients * share

    with phase(done, done, "Removing blocks"):
        first = _over_grids(plane, plane, cut)
        return _over_grids(plane, first, weigh)


def _over_grids(plane: Floats, guide: Floats, change: Callable[[Floats, Floats], Floats]) -> Floats:
    # Applies `change` to the coefficients of both images on shifted grids; averages the results.
    height, width = plane.shape
    below, right = -height % BLOCK + BLOCK, -width % BLOCK + BLOCK
    pad = ((BLOCK, below), (BLOCK, right))
    wide, leading = (np.pad(each, pad, mode="symmetric") for each in (plane, guide))
    total = np.zeros_like(wide)
    count = np.zeros_like(wide)
    for y in range(0, BLOCK, _SHIFTS):
        for x in range(0, BLOCK, _SHIFTS):
            ask()
            rows = slice(y, wide.shape[0] - BLOCK + y)
            columns = slice(x, wide.shape[1] - BLOCK + x)
            here = _transformed(_blocks(wide[rows, columns]))
            lead = here if guide is plane else _transformed(_blocks(leading[rows, columns]))
            size = wide[rows, columns].shape
            total[rows, columns] += _image(_back(change(here, lead)), size)
            count[rows, columns] += 1.0
    inner = slice(BLOCK, BLOCK + height), slice(BLOCK, BLOCK + width)
    return total[inner] / count[inner]


def _cosines() -> Floats:
    k = np.arange(BLOCK)
    one = np.cos(np.pi * (2 * k + 1) * k[:, None] / (2 * BLOCK)) * np.sqrt(2 / BLOCK)
    one[0] /= np.sqrt(2)
    return np.kron(one, one).astype(np.float32)


_BASIS = _cosines()


def _blocks(plane: Floats) -> Floats:
    # Whole blocks, one a row: (n, 64).
    height, width = plane.shape
    parts = plane.reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK)
    return parts.transpose(0, 2, 1, 3).reshape(-1, BLOCK * BLOCK)


def _image(blocks: Floats, shape: tuple[int, ...]) -> Floats:
    height, width = shape
    parts = blocks.reshape(height // BLOCK, width // BLOCK, BLOCK, BLOCK)
    return parts.transpose(0, 2, 1, 3).reshape(height, width)


def _transformed(blocks: Floats) -> Floats:
    return blocks @ _BASIS.T


def _back(coefficients: Floats) -> Floats:
    return coefficients @ _BASIS
