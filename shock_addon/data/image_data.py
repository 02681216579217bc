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

from ..filters.picture import Picture
from ..skipped import Skipped
from .tiles import Tiles, linear_space, new_tiled_like, read_tiles, write_tiles

_REFUSED = {
    "MOVIE": "it is a movie; save the frame as an image and open that",
    "SEQUENCE": "it is an image sequence; open its files one by one as single images",
    "TILED": "it has UDIM tiles; Sharpen Texture takes these, or open them one by one as single"
    " images",
    "VIEWER": "it is a render result or a viewer; save it (Image > Save As) and open the file",
}


UNTILED = 0
"""The number under which `read_parts` gives the pixels of an image without tiles."""


@dataclass(frozen=True)
class ImageTarget:
    """An image as it was read, to find it again when the result is there."""

    name: str
    image_uid: int
    surface: Picture

    @property
    def parts(self) -> Tiles:
        """The pixels as `read_parts` gives them."""
        return {UNTILED: self.surface.pixels}


@dataclass(frozen=True)
class _Overwritten:
    image_uid: int
    parts: Tiles


_overwritten: _Overwritten | None = None
"""The image that was replaced last, as it was before: Blender's undo does not bring it back."""


def edited_image(context: bpy.types.Context) -> bpy.types.Image | None:
    """Return the image that the Image Editor shows, if the context is one."""
    space = context.space_data
    return space.image if space is not None and space.type == "IMAGE_EDITOR" else None


def refusal(image: bpy.types.Image, tiles: bool = False) -> str:
    """Say why an image cannot be sharpened; empty if it can. UDIM tiles can be allowed."""
    if image.library is not None or image.override_library is not None:
        return "it is linked from another file; make it local first"
    if image.type == "MULTILAYER":
        return "it has several layers; save the one you want as an image of its own"
    if image.source in _REFUSED and not (tiles and image.source == "TILED"):
        return _REFUSED[image.source]
    is_saved = image.filepath_raw or image.packed_files
    if image.source == "TILED" and (image.is_dirty or not is_saved):
        return "it has tiles that are not saved; save it first (Image > Save)"
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
    picture = picture_of(image, read_pixels(image))
    return ImageTarget(image.name, image.session_uid, picture)


def picture_of(image: bpy.types.Image, pixels: npt.NDArray[np.float32]) -> Picture:
    """Say what pixels that were read from an image mean."""
    return Picture(
        pixels=pixels,
        opacity=image.alpha_mode,
        premultiplied=image.is_float,
        levels=0 if image.is_float else 255,
    )


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
    if refusal(image, UNTILED not in target.parts) or part_sizes(image) != sizes_of(target.parts):
        raise Skipped("it was changed meanwhile; run again")
    return image


def part_sizes(image: bpy.types.Image) -> dict[int, tuple[int, int]]:
    """Return height and width of each part of an image, as `read_parts` gives them."""
    if image.source != "TILED":
        return {UNTILED: (image.size[1], image.size[0])}
    return {tile.number: (tile.size[1], tile.size[0]) for tile in image.tiles if tile.size[0]}


def read_parts(image: bpy.types.Image) -> Tiles:
    """Read the pixels of all tiles, or of the image as its only part."""
    return read_tiles(image) if image.source == "TILED" else {UNTILED: read_pixels(image)}


def write_parts(image: bpy.types.Image, parts: Tiles, pack: bool) -> None:
    """Write the pixels of all parts. Tiles are always packed into the blend file."""
    if image.source == "TILED":
        write_tiles(image, parts)
    else:
        write_pixels(image, parts[UNTILED], pack)


def read_pixels(image: bpy.types.Image) -> npt.NDArray[np.float32]:
    """Read the pixels, from the bottom up: (h, w, channels)."""
    flat = np.empty(len(image.pixels), dtype=np.float32)
    image.pixels.foreach_get(flat)
    return flat.reshape(image.size[1], image.size[0], -1)


def write_pixels(image: bpy.types.Image, pixels: npt.NDArray[np.float32], pack: bool) -> None:
    """Write the pixels, and pack them into the blend file if asked to."""
    if pack and image.is_float and not image.colorspace_settings.is_data:
        # Blender packs floats as they are in memory: linear, whatever their file was.
        image.colorspace_settings.name = linear_space()
    image.pixels.foreach_set(np.ascontiguousarray(pixels).reshape(-1))
    image.update()
    if pack:
        image.pack()


def add_or_reuse(source: bpy.types.Image, name: str, used: str, parts: Tiles) -> bpy.types.Image:
    """Write the parts into an image like `source`: the one named `used` if it can take them."""
    pack = source.packed_file is not None
    image = bpy.data.images.get(used)
    if image is not None and image != source and is_like(image, source):
        write_parts(image, parts, pack)
        return image
    if source.source == "TILED":
        return new_tiled_like(source, name, parts)
    image = new_like(source, name)
    write_pixels(image, parts[UNTILED], pack)
    return image


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
    fits = part_sizes(image) == part_sizes(other) and image.is_float == other.is_float
    return fits and not refusal(image, tiles=True)


def overwrite(image: bpy.types.Image, old: Tiles, new: Tiles) -> None:
    """Write new parts and keep the old ones for `restore`.

    Raises
    ------
    Skipped
        If the image does not hold the old parts any more.
    """
    global _overwritten
    now = read_parts(image)
    if not all(np.array_equal(now[number], pixels) for number, pixels in old.items()):
        raise Skipped("it was changed meanwhile; run again")
    _overwritten = _Overwritten(image.session_uid, old)
    write_parts(image, new, image.packed_file is not None)


def restore(image: bpy.types.Image) -> None:
    """Undo the last `overwrite`, if it was of this image."""
    known = _overwritten is not None and _overwritten.image_uid == image.session_uid
    if known and part_sizes(image) == sizes_of(_overwritten.parts):
        write_parts(image, _overwritten.parts, image.packed_file is not None)


def sizes_of(parts: Tiles) -> dict[int, tuple[int, int]]:
    """Return height and width of each part."""
    return {number: pixels.shape[:2] for number, pixels in parts.items()}


def forget() -> None:
    """Drop what is kept for `restore`."""
    global _overwritten
    _overwritten = None
