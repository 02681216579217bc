# SPDX-License-Identifier: GPL-3.0-or-later
"""Filter an image as a host program keeps it: opacity, multiplied floats, bytes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..base.parallel import blocks
from ..base.progress import ProgressCallback, aside, reporting
from .inputs import HostImage, Pixels
from .recolored import Recolored, recolored

_ROWS = 256
"""Rows of an image that are divided or multiplied by opacity at once."""


def filter_image(
    image: HostImage,
    alpha: str,
    function: Callable[[Pixels, str], Pixels],
    progress: ProgressCallback | None = None,
) -> Recolored:
    """Filter an image, with colors that are not multiplied by opacity.

    Parameters
    ----------
    image : HostImage
    alpha : str
        "none" to treat all four channels alike, whatever the fourth is, or "auto".
    function : callable
        ``function(pixels, alpha)`` returns new pixels; `alpha` says whether the fourth channel,
        if there is one, is opacity.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    Recolored
        Pixels that do not change stay bit for bit.

    Raises
    ------
    ShockError
        What `function` raises.
    """
    old = image.pixels
    with reporting(progress):
        if alpha == "none" or image.opacity == "CHANNEL_PACKED":
            new = function(old, "none")
        elif image.opacity == "NONE":
            new = old.copy()
            new[..., :3] = function(old[..., :3], "none")
        elif image.premultiplied:
            new = _filter_multiplied(old, function)
        else:
            new = function(old, "auto")
        return recolored(old, new, image.levels)


def _filter_multiplied(pixels: Pixels, function: Callable[[Pixels, str], Pixels]) -> Pixels:
    straight = np.empty_like(pixels)
    with aside("Preparing"):
        for band in blocks(len(pixels), _ROWS):
            straight[band] = pixels[band]
            straight[band, :, :3] /= _factor(pixels[band])
    new = function(straight, "auto")
    result = np.empty_like(pixels)
    with aside("Comparing colors"):
        for band in blocks(len(pixels), _ROWS):
            same = (new[band] == straight[band]).all(axis=-1, keepdims=True)
            multiplied = new[band].copy()
            multiplied[..., :3] *= _factor(multiplied)
            result[band] = np.where(same, pixels[band], multiplied)
    return result


def _factor(pixels: Pixels) -> Pixels:
    opacity = pixels[..., 3:]
    return np.where(opacity > 0, opacity, np.float32(1.0))
