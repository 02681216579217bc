# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpen an image as Blender keeps it: opacity, multiplied floats, bytes. Needs no bpy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ... import core
from .recolored import Recolored, recolored

Pixels = npt.NDArray[np.float32]

_ROWS = 256
"""Rows of an image that are divided or multiplied by opacity at once."""


@dataclass(frozen=True)
class Picture:
    """An image's pixels.

    Attributes
    ----------
    pixels : (h, w, 4) float32
        From the bottom up.
    opacity : str
        What the fourth channel is, in Blender's words: "STRAIGHT" or "PREMUL" for opacity,
        "CHANNEL_PACKED" for one more channel like the others, "NONE" for nothing.
    premultiplied : bool
        Whether colors are multiplied by opacity, if there is one.
    levels : int
        Bytes have 255 steps; 0 for floats.
    """

    pixels: Pixels
    opacity: str
    premultiplied: bool
    levels: int

    @property
    def size(self) -> int:
        """How much work it is, beside others."""
        return self.pixels.shape[0] * self.pixels.shape[1]


def sharpen_picture(
    picture: Picture,
    settings: core.ImageSettings,
    progress: Callable[[float, str], bool] | None,
) -> Recolored:
    """Sharpen an image; opacity stays.

    Parameters
    ----------
    picture : Picture
    settings : core.ImageSettings
        With ``alpha="none"``, all four channels are filtered alike, whatever the fourth is.
    progress : callable or None
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    Recolored
        Pixels that do not change stay bit for bit.

    Raises
    ------
    core.ShockError
        See `core.sharpen_image`.
    """

    def sharpen(pixels: Pixels, alpha: str) -> Pixels:
        return core.sharpen_image(pixels, replace(settings, alpha=alpha), progress=progress)

    return filter_picture(picture, settings.alpha, sharpen, progress)


def filter_picture(
    picture: Picture,
    alpha: str,
    function: Callable[[Pixels, str], Pixels],
    progress: Callable[[float, str], bool] | None,
) -> Recolored:
    """Filter an image, with colors that are not multiplied by opacity.

    Parameters
    ----------
    picture : Picture
    alpha : str
        "none" to treat all four channels alike, whatever the fourth is, or "auto".
    function : callable
        ``function(pixels, alpha)`` returns new pixels; `alpha` says whether the fourth channel,
        if there is one, is opacity.
    progress : callable or None
        ``progress(fraction, message) -> bool``; False cancels.
    """
    old = picture.pixels
    if alpha == "none" or picture.opacity == "CHANNEL_PACKED":
        new = function(old, "none")
    elif picture.opacity == "NONE":
        new = old.copy()
        new[..., :3] = function(old[..., :3], "none")
    elif picture.premultiplied:
        new = _filter_multiplied(old, function, progress)
    else:
        new = function(old, "auto")
    return recolored(old, new, picture.levels, progress)


def _filter_multiplied(
    pixels: Pixels,
    function: Callable[[Pixels, str], Pixels],
    progress: Callable[[float, str], bool] | None,
) -> Pixels:
    from ..base.parallel import Progress, blocks

    phases = Progress.of(progress)
    straight = np.empty_like(pixels)
    for band in blocks(len(pixels), _ROWS, phases.part(0.0, 0.0, "Preparing")):
        straight[band] = pixels[band]
        straight[band, :, :3] /= _factor(pixels[band])
    new = function(straight, "auto")
    result = np.empty_like(pixels)
    for band in blocks(len(pixels), _ROWS, phases.part(1.0, 1.0, "Comparing colors")):
        same = (new[band] == straight[band]).all(axis=-1, keepdims=True)
        multiplied = new[band].copy()
        multiplied[..., :3] *= _factor(multiplied)
        result[band] = np.where(same, pixels[band], multiplied)
    return result


def _factor(pixels: Pixels) -> Pixels:
    opacity = pixels[..., 3:]
    return np.where(opacity > 0, opacity, np.float32(1.0))
