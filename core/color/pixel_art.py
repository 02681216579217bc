# SPDX-License-Identifier: GPL-3.0-or-later
"""Detects pixel art, which stays as it is, and is enlarged by repeating pixels.

Not in the papers. Pixel art is small, and has few colors with hard steps between them. Antialiased
drawings, logos and texts have intermediate colors at their steps, and photos have many colors.
`benchmarks/pixel_art.py` measures how well these are separated.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.checks import SCALES
from ..base.findings import tell
from ..base.progress import aside
from ..grid.channels import opacity_channel
from ..settings import ImageSettings

LARGEST_PIXEL_ART = 1 << 18
"""Images of this many pixels or more are not pixel art."""

_PIXELS = 1 << 17, LARGEST_PIXEL_ART
"""Ramp of the number of pixels: up to the first value an image may be pixel art, from the second on
it is not. The following pairs are such ramps too."""

_COLORS = 128, 256
_COLORS_PER_PIXEL = 0.1, 0.2

_BETWEEN = 0.12, 0.16
"""Share of the steps between neighbors in rows and columns that the next step continues in the same
direction."""

_STEP = 0.08, 0.04
"""Median size of the steps, in the channel that differs most; values are in [0, 1]."""

_SAME_DIRECTION = 0.9
"""Least cosine between two steps of the same direction, as vectors of colors."""


def is_for_pixel_art(settings: ImageSettings, has_guide: bool) -> bool:
    """Return whether to test for pixel art: not if a time, What, a width or a guide is given."""
    by_itself = settings.by_width and settings.what == "auto" and settings.width == 0
    return by_itself and not (has_guide or settings.is_neutral)


def told_pixel_art(pixels: npt.NDArray, settings: ImageSettings) -> float:
    """Call `pixel_art` for an image, and report if it is."""
    with aside("Enlarging" if settings.enlarge > 1 else "Sharpening"):
        share = pixel_art(pixels, opacity_channel(pixels.shape[2], settings.alpha))
    if share >= 0.5 and settings.enlarge == 1:
        tell("Taken for pixel art, which is sharp. To sharpen it still, set What to Drawing.")
    elif share >= 0.5:
        tell("Taken for pixel art: pixels became squares. For smooth outlines set What to Drawing.")
    return share


def pixel_art(pixels: npt.NDArray, alpha: int = -1) -> float:
    """Estimate whether an image is pixel art.

    Parameters
    ----------
    pixels : (h, w, c) array
    alpha : int
        The channel that is opacity, or -1; colors are multiplied by it.

    Returns
    -------
    float
        1 if it is, 0 if not; seldom in between.
    """
    height, width = pixels.shape[:2]
    if not 0 < height * width < _PIXELS[1]:
        return 0.0
    values = pixels * np.float64(SCALES[pixels.dtype.name])
    if alpha >= 0:
        visible = np.arange(values.shape[2]) != alpha
        values[..., visible] *= values[..., alpha, None]
    count = _number_of_colors(values)
    share = (
        _ramp(height * width, *_PIXELS)
        * _ramp(count, *_COLORS)
        * _ramp(count / (height * width), *_COLORS_PER_PIXEL)
    )
    if share == 0:
        return 0.0
    sizes, between = [], 0
    for axis in (0, 1):
        steps = np.diff(values, axis=axis)
        size = np.abs(steps).max(axis=2)
        sizes.append(size[size > 0])
        one, next_ = (steps[:-1], steps[1:]) if axis == 0 else (steps[:, :-1], steps[:, 1:])
        along = (one * next_).sum(axis=2)
        lengths = np.sqrt((one * one).sum(axis=2) * (next_ * next_).sum(axis=2))
        between += np.count_nonzero((along > _SAME_DIRECTION * lengths) & (lengths > 0))
    found = np.concatenate(sizes)
    if not found.size:
        return 0.0
    share *= _ramp(between / found.size, *_BETWEEN)
    return float(share * _ramp(float(np.median(found)), *_STEP))


def put_pixels(
    pixels: npt.NDArray, share: float, times: int, alpha: int, target: npt.NDArray
) -> None:
    """Mix an enlarged image with one that is enlarged by repeating pixels.

    Parameters
    ----------
    pixels : (h, w, c) array
    share : float
        Weight of the repeated pixels; 1 replaces all values.
    times : int
    alpha : int
        The channel that is opacity, or -1.
    target : (times * h, times * w, c) array of float
        In the range of colors; overwritten.
    """
    with aside("Enlarging"):
        squares = (pixels * target.dtype.type(SCALES[pixels.dtype.name])).repeat(times, 0)
        squares = squares.repeat(times, 1)
        if share == 1:
            target[...] = squares
            return
        shares = np.full((*target.shape[:2], 1), share, target.dtype)
        if alpha >= 0:  # hidden pixels add no color
            shown = share * squares[..., alpha, None]
            both = shown + (1.0 - share) * target[..., alpha, None]
            shares = np.where(both > 0, shown / np.where(both > 0, both, 1.0), shares)
            shares = shares.repeat(target.shape[2], axis=2)
            shares[..., alpha] = share
        target += shares * (squares - target)


def _number_of_colors(values: npt.NDArray[np.float64]) -> int:
    # Distinct colors have distinct sums, except by a chance of about 2^-50.
    sums = np.zeros(values.shape[:2])
    for channel in range(values.shape[2]):
        sums += np.sqrt(channel + 2.0) * values[..., channel]
    return len(np.unique(sums))


def _ramp(value: float, one: float, zero: float) -> float:
    return min(max((value - zero) / (one - zero), 0.0), 1.0)
