# SPDX-License-Identifier: GPL-3.0-or-later
"""A photograph of scikit-image's, blurred, in and out of Blender's images."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import numpy.typing as npt
import scipy.ndimage
import skimage.data
from PIL import Image

Pixels = npt.NDArray[np.float32]

BLUR = 2.0
"""Standard deviation in pixels."""


def blurred_photo() -> tuple[Pixels, Pixels]:
    """A part of the photo of Eileen Collins (NASA, public domain), and the same blurred."""
    original = skimage.data.astronaut()[:400, 60:400].astype(np.float32) / 255
    return original, scipy.ndimage.gaussian_filter(original, (BLUR, BLUR, 0))


def to_blender(name: str, pixels: Pixels, is_data: bool = False) -> bpy.types.Image:
    """Make a Blender image, whose rows begin at the bottom."""
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(name, width, height, alpha=pixels.shape[2] == 4, is_data=is_data)
    rgba = np.ones((height, width, 4), dtype=np.float32)
    rgba[..., : pixels.shape[2]] = pixels[::-1]
    image.pixels.foreach_set(rgba.reshape(-1))
    return image


def from_blender(image: bpy.types.Image) -> Pixels:
    """Read a Blender image."""
    width, height = image.size
    flat = np.empty(width * height * image.channels, dtype=np.float32)
    image.pixels.foreach_get(flat)
    return flat.reshape(height, width, -1)[::-1, :, :3]


def slope(pixels: Pixels) -> float:
    """How steep the steepest hundredth of all edges is, in brightness a pixel."""
    return float(np.percentile(np.hypot(*np.gradient(pixels.mean(axis=2))), 99))


def overshoot(before: Pixels, after: Pixels) -> float:
    """How far values leave the range that they had within 10 pixels."""
    window = (21, 21, 1)
    above = after - scipy.ndimage.maximum_filter(before, window)
    below = scipy.ndimage.minimum_filter(before, window) - after
    return float(max(above.max(), below.max(), 0.0))


def side_by_side(path: Path, pictures: list[Pixels]) -> Path:
    """Write pictures beside each other, with a white line between them."""
    line = np.ones((len(pictures[0]), 8, 3), dtype=np.float32)
    row = [pictures[0]]
    for pixels in pictures[1:]:
        row += [line, pixels]
    values = np.rint(np.clip(np.concatenate(row, axis=1), 0, 1) * 255)
    Image.fromarray(values.astype(np.uint8)).save(path)
    return path
