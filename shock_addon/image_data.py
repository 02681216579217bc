# SPDX-License-Identifier: GPL-3.0-or-later
"""Between Blender's images and arrays.

Pixels are read and written as Blender keeps them: bytes in the image's own color space, floats
linear in the scene's color space and multiplied by their opacity.
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
import numpy.typing as npt

from .picture import Picture
from .skipped import Skipped

_REFUSED = {
    "MOVIE": "it is a movie; save the frame as an image and open that",
    "SEQUENCE": "it is an image sequence; open its files one by one as single images",
    "TILED": "it has UDIM tiles, and scripts reach only the first; open the tiles one by one as"
    " single images",
    "VIEWER": "it is a render result or a viewer; save it (Image > Save As) and open the file",
}


@dataclass(frozen=True)
class ImageTarget:
    """An image as it was read, to find it again when the result is there."""

    name: str
    image_uid: int
    surface: Picture


@dataclass(frozen=True)
class _Overwritten:
    image_uid: int
    pixels: npt.NDArray[np.float32]


_overwritten: _Overwritten | None = None
"""The image that was replaced last, as it was before: Blender's undo does not bring it back."""


def refusal(image: bpy.types.Image) -> str:
    """Say why an image cannot be sharpened; empty if it can."""
    if image.library is not None or image.override_library is not None:
        return "it is linked from another file; make it local first"
    if image.type == "MULTILAYER":
        return "it has several layers; save the one you want as an image of its own"
    if image.source in _REFUSED:
        return _REFUSED[image.source]
    if not image.size[0] * image.size[1]:
        return "it has no pixels; check that its file exists"
    return ""


def read_image(image: bpy.types.Image) -> ImageTarget:
    """Read an image.

    Raises
    ------
    Skipped
        If it is none that can be sharpened.
    """
    reason = refusal(image)
    if reason:
        raise Skipped(reason)
    picture = Picture(
        pixels=read_pixels(image),
        opacity=image.alpha_mode,
        premultiplied=image.is_float,
        levels=0 if image.is_float else 255,
    )
    return ImageTarget(image.name, image.session_uid, picture)


def find(target: ImageTarget) -> bpy.types.Image:
    """Return the image that was read.

    Raises
    ------
    Skipped
        If it was removed, or its size or kind has changed.
    """
    image = next((i for i in bpy.data.images if i.session_uid == target.image_uid), None)
    if image is None:
        raise Skipped("it was removed meanwhile")
    if refusal(image) or not _fits(image, target.surface.pixels):
        raise Skipped("it was changed meanwhile; run again")
    return image


def read_pixels(image: bpy.types.Image) -> npt.NDArray[np.float32]:
    """Read the pixels, from the bottom up: (h, w, channels)."""
    flat = np.empty(len(image.pixels), dtype=np.float32)
    image.pixels.foreach_get(flat)
    return flat.reshape(image.size[1], image.size[0], -1)


def write_pixels(image: bpy.types.Image, pixels: npt.NDArray[np.float32], pack: bool) -> None:
    """Write the pixels, and pack them into the blend file if asked to."""
    if pack and image.is_float and not image.colorspace_settings.is_data:
        # Blender packs floats as they are in memory: linear, whatever their file was.
        image.colorspace_settings.name = _linear_space()
    image.pixels.foreach_set(np.ascontiguousarray(pixels).reshape(-1))
    image.update()
    if pack:
        image.pack()


def new_like(image: bpy.types.Image, name: str) -> bpy.types.Image:
    """Add an image of the same size and kind."""
    space = image.colorspace_settings
    new = bpy.data.images.new(
        name,
        *image.size,
        alpha=image.depth in {32, 128},
        float_buffer=image.is_float,
        is_data=space.is_data,
    )
    new.colorspace_settings.name = space.name
    new.alpha_mode = image.alpha_mode
    return new


def is_like(image: bpy.types.Image, other: bpy.types.Image) -> bool:
    """Whether an image can take the pixels of another one."""
    return not refusal(image) and (*image.size, image.is_float) == (*other.size, other.is_float)


def overwrite(image: bpy.types.Image, target: ImageTarget, pixels: npt.NDArray) -> None:
    """Write the pixels and keep the old ones for `restore`."""
    global _overwritten
    _overwritten = _Overwritten(target.image_uid, target.surface.pixels)
    write_pixels(image, pixels, image.packed_file is not None)


def restore(image: bpy.types.Image) -> None:
    """Undo the last `overwrite`, if it was of this image."""
    known = _overwritten is not None and _overwritten.image_uid == image.session_uid
    if known and _fits(image, _overwritten.pixels):
        write_pixels(image, _overwritten.pixels, image.packed_file is not None)


def forget() -> None:
    """Drop what is kept for `restore`."""
    global _overwritten
    _overwritten = None


def _fits(image: bpy.types.Image, pixels: npt.NDArray) -> bool:
    width, height = image.size
    return (height, width) == pixels.shape[:2]


def _linear_space() -> str:
    sample = bpy.data.images.new("sample", 1, 1, float_buffer=True)
    name = sample.colorspace_settings.name
    bpy.data.images.remove(sample)
    return name
