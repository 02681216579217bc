# SPDX-License-Identifier: GPL-3.0-or-later
"""Conversion of an image's pixels to the colors on the screen."""

from __future__ import annotations

import numpy as np

from ..base.srgb import Values, decoded
from ..host.inputs import HostImage


def screen_colors(image: HostImage, encoded: bool, multiply_encoded: bool) -> Values:
    """Convert pixels to linear colors, multiplied by opacity if they have any: (h, w, 4).

    Parameters
    ----------
    image : HostImage
    encoded : bool
        Whether colors are sRGB values, and not linear ones or data.
    multiply_encoded : bool
        Whether colors are multiplied before they are decoded, as in Blender before 5.0.
    """
    height, width, channels = image.pixels.shape
    new = np.ones((height, width, 4), dtype=np.float32)
    colors = image.pixels[..., : 3 if channels > 2 else 1]
    new[..., :3] = colors
    if channels == 4:
        new[..., 3] = image.pixels[..., 3]
    multiplies = is_transparent(image) and not image.premultiplied
    if multiplies and multiply_encoded:
        new[..., :3] *= new[..., 3:]
    if encoded:
        new[..., :3] = decoded(new[..., :3])
    if multiplies and not multiply_encoded:
        new[..., :3] *= new[..., 3:]
    return new


def is_transparent(image: HostImage) -> bool:
    """Whether the fourth channel is opacity."""
    return image.opacity in {"STRAIGHT", "PREMUL"}
