# SPDX-License-Identifier: GPL-3.0-or-later
"""Conversion of an image's pixels to the colors on the screen."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..host.inputs import HostImage

Values = npt.NDArray[np.float32]


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


def decoded(values: Values) -> Values:
    """Convert sRGB values to linear ones."""
    curved = ((np.maximum(values, 0.0) + 0.055) / 1.055) ** 2.4
    return np.where(values <= 0.04045, values / 12.92, curved).astype(np.float32)
