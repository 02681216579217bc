# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpen an image as Blender keeps it: opacity, multiplied floats, bytes. Needs no bpy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from .. import core
from .recolored import Recolored, recolored


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

    pixels: npt.NDArray[np.float32]
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
    old = picture.pixels
    if settings.alpha == "none" or picture.opacity == "CHANNEL_PACKED":
        new = core.sharpen_image(old, replace(settings, alpha="none"), progress=progress)
        return recolored(old, new, picture.levels)
    new = old.copy()
    if picture.opacity == "NONE":
        new[..., :3] = core.sharpen_image(old[..., :3], settings, progress=progress)
    elif picture.premultiplied:
        new[..., :3] = _sharpen_multiplied(old, settings, progress)
    else:
        new = core.sharpen_image(old, settings, progress=progress)
    return recolored(old, new, picture.levels)


def _sharpen_multiplied(
    pixels: npt.NDArray[np.float32],
    settings: core.ImageSettings,
    progress: Callable[[float, str], bool] | None,
) -> npt.NDArray[np.float32]:
    opacity = pixels[..., 3:]
    factor = np.where(opacity > 0, opacity, np.float32(1.0))
    straight = pixels.copy()
    straight[..., :3] /= factor
    sharp = core.sharpen_image(straight, settings, progress=progress)[..., :3]
    return np.where(sharp == straight[..., :3], pixels[..., :3], sharp * factor)
