# SPDX-License-Identifier: GPL-3.0-or-later
"""Conversion between Blender's images and arrays.

Pixels are read and written as Blender stores them: bytes in the image's own color space, floats
linear in the scene's color space and multiplied by their opacity.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
import numpy.typing as npt

from ....core.host import forgetting
from ....core.host.inputs import HostImage
from .. import arrays
from ..arrays import check_same_parts, read_pixels
from ..chosen import refusal
from ..skipped import Skipped, skip_if
from .tiles import Tiles, dress, new_tiled_like, read_tiles, write_tiles

_NUMBER = r"\.\d{3}$"
"""Pattern of the numbers that Blender adds to names."""

UNTILED = 0
"""The key of the pixels of an image without tiles, in the result of `read_parts`."""


@dataclass(frozen=True)
class ImageTarget:
    """An image as it was read, with what is needed to find it again and write the result.

    Attributes
    ----------
    surface : HostImage or TexturedSurface
        The input of the filter.
    parts : dict
        The pixels, as `read_parts` returns them.
    """

    name: str
    image_uid: int
    surface: Any
    parts: Tiles


_overwritten: dict[int, Tiles] = {}
"""The old pixels of images that the last run replaced, by uid; undo does not restore them."""

_undone = False
"""Whether there was an undo since, as by Adjust Last Operation, but not by Repeat Last."""

_written: dict[int, bytes] = {}
"""Digests of what was written, by the uid of the image, to tell later changes by the user."""


def read_image(image: bpy.types.Image) -> ImageTarget:
    """Read an image.

    Raises
    ------
    Skipped
        If the image cannot be sharpened.
    """
    skip_if(refusal(image))
    surface = host_image(image, read_pixels(image))
    return ImageTarget(image.name, image.session_uid, surface, {UNTILED: surface.pixels})


def host_image(image: bpy.types.Image, pixels: npt.NDArray[np.float32]) -> HostImage:
    """Wrap pixels of an image with their color space and opacity."""
    return HostImage(
        pixels=pixels,
        opacity=image.alpha_mode,
        premultiplied=image.is_float,
        levels=0 if image.is_float else 255,
    )


def find_image(target: ImageTarget) -> bpy.types.Image:
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
    """Return height and width of each part of an image, with the keys of `read_parts`."""
    if image.source != "TILED":
        return {UNTILED: (image.size[1], image.size[0])}
    return {tile.number: (tile.size[1], tile.size[0]) for tile in image.tiles if tile.size[0]}


def read_parts(image: bpy.types.Image) -> Tiles:
    """Read the pixels of all tiles, or of the image as its only part."""
    return read_tiles(image) if image.source == "TILED" else {UNTILED: read_pixels(image)}


def write_parts(image: bpy.types.Image, parts: Tiles, pack: bool) -> None:
    """Write the pixels of all parts, and pack them into the blend file; tiles are always packed."""
    if image.source == "TILED":
        write_tiles(image, parts)
        return
    if pack:
        dress(image, image)
    if part_sizes(image) != sizes_of(parts):
        height, width = parts[UNTILED].shape[:2]
        image.scale(width, height)
    arrays.write_pixels(image, parts[UNTILED])
    image.update()
    if pack:
        image.pack()


def add_or_reuse(
    source: bpy.types.Image,
    suffix: str,
    used: str,
    parts: Tiles,
    may_stand: Callable[[bpy.types.Image], bool],
) -> tuple[bpy.types.Image, bool]:
    """Write the parts into an image like `source`.

    This is the image named `used` if it fits and still holds what an earlier run wrote. Otherwise,
    it is one that a run has written under the same name, equals the result and may stand for it, or
    else a new one, named after `source` with the suffix. It is packed, because Blender does not
    save pixels that are neither in the blend file nor in a file.

    Returns
    -------
    image : bpy.types.Image
    was_there : bool
        Whether an equal one stands for the result.
    """
    name = name_with(source.name, suffix)
    if is_reusable(source, used, parts):
        image = bpy.data.images[used]
        write_parts(image, parts, pack=True)
        note_written(image)
        return image, False
    if source.source == "TILED":
        image = new_tiled_like(source, name, parts)
    else:
        height, width = parts[UNTILED].shape[:2]
        image = new_like(source, name, (width, height))
        write_parts(image, parts, pack=True)
    note_written(image)
    for other in bpy.data.images:
        is_written = other not in (image, source) and other.session_uid in _written
        is_named = re.sub(_NUMBER, "", other.name) == name
        if is_written and is_named and may_stand(other) and _are_equal(other, image):
            del _written[image.session_uid]
            bpy.data.images.remove(image)
            return other, True
    return image, False


def is_reusable(source: bpy.types.Image, used: str, parts: Tiles) -> bool:
    """Whether a result for an image can be written into the image named `used`."""
    image = bpy.data.images.get(used)
    fits = image is not None and image != source and _is_like(image, source, parts)
    return fits and is_as_written(image)


def _are_equal(image: bpy.types.Image, other: bpy.types.Image) -> bool:
    kinds = [
        (each.is_float, each.source, each.alpha_mode, each.depth, each.colorspace_settings.name)
        for each in (image, other)
    ]
    written = _written[image.session_uid] == _written[other.session_uid]
    return kinds[0] == kinds[1] and written and is_as_written(image)


def differ(image: bpy.types.Image, old: Tiles, new: Tiles) -> bool:
    """Whether an image that holds one of these would show anything else with the other."""
    if sizes_of(old) != sizes_of(new):
        return True
    levels = 0 if image.is_float else 255
    return any(
        not np.array_equal(_stored(old[number], levels), _stored(new[number], levels), True)
        for number in old
    )


def _stored(pixels: npt.NDArray[np.float32], levels: int) -> npt.NDArray[np.float32]:
    return np.rint(pixels * np.float32(levels)).clip(0, levels) if levels else pixels


def keep(image: bpy.types.Image) -> None:
    """Make the blend file keep an image that has no users, which Blender would not save.

    Editors that show an image, and painting on it, do not count as users.
    """
    users = bpy.data.user_map(subset={image})[image]
    if all(isinstance(user, bpy.types.Screen | bpy.types.Scene) for user in users):
        image.use_fake_user = True


def name_with(old: str, suffix: str) -> str:
    """Append the suffix to a name without its file ending, unless the name has it."""
    unnumbered = re.sub(_NUMBER, "", old)
    if unnumbered.endswith(f" {suffix}"):
        return unnumbered
    stem, ending = os.path.splitext(unnumbered)
    return f"{stem if ending.lower() in bpy.path.extensions_image else old} {suffix}"


def new_like(image: bpy.types.Image, name: str, size: Sequence[int]) -> bpy.types.Image:
    """Add an image of the same kind, of a width and height."""
    space = image.colorspace_settings
    new = bpy.data.images.new(
        name,
        *size,
        alpha=image.depth in {32, 128},
        float_buffer=image.is_float,
        is_data=space.is_data,
    )
    new.colorspace_settings.name = space.name
    new.alpha_mode = image.alpha_mode
    return new


def _is_like(image: bpy.types.Image, other: bpy.types.Image, parts: Tiles) -> bool:
    """Whether an image can take these parts of a result for another image."""
    fits = part_sizes(image) == sizes_of(parts) and image.is_float == other.is_float
    return fits and not refusal(image, tiles=True)


def keep_unsaved(targets: Sequence[ImageTarget]) -> None:
    """Pack what was painted on packed images since, and add a step of undo, before they change.

    Undo reads packed images anew: it would take away what was painted before a run, too.
    """
    kept = False
    for target in targets:
        image = next((i for i in bpy.data.images if i.session_uid == target.image_uid), None)
        if image and image.source != "TILED" and image.packed_file and image.is_dirty:
            with suppress(Skipped):
                check_same_parts(read_parts(image), target.parts)
                write_parts(image, target.parts, pack=True)
                kept = True
    if kept:
        bpy.ops.ed.undo_push(message="Keep Unsaved Pixels")


def overwrite(image: bpy.types.Image, old: Tiles, new: Tiles) -> bytes:
    """Write new parts, keep the old ones for `restore`, and return the digest of the new ones.

    See `forget_overwritten`.

    Raises
    ------
    Skipped
        If the image no longer holds the old parts.
    """
    global _undone
    check_same_parts(read_parts(image), old)
    _overwritten[image.session_uid], _undone = old, False
    if _note_undo not in bpy.app.handlers.undo_post:
        bpy.app.handlers.undo_post.append(_note_undo)
    write_parts(image, new, image.packed_file is not None)
    _written[image.session_uid] = digest_of(image)
    return _written[image.session_uid]


def restore(image: bpy.types.Image) -> None:
    """Undo `overwrite` of this image if Blender has undone the rest of the last run.

    An image that was painted on since stays as it is.
    """
    old = _overwritten.get(image.session_uid)
    painted = image.source == "TILED" and image.is_dirty  # its files are read, not its pixels
    if old is not None and _undone and not painted and is_as_written(image):
        write_parts(image, old, image.packed_file is not None)


def is_as_written(image: bpy.types.Image) -> bool:
    """Whether an image still holds exactly what a run has written."""
    written = _written.get(image.session_uid)
    return written is not None and written == digest_of(image)


def note_written(image: bpy.types.Image) -> None:
    """Remember the digest of what a run has written into an image."""
    _written[image.session_uid] = digest_of(image)


def digest_of(image: bpy.types.Image) -> bytes:
    """Return a digest of the pixels of an image."""
    digest = hashlib.blake2b(digest_size=16)
    for number, pixels in read_parts(image).items():
        digest.update(f"{number} {pixels.shape} ".encode())
        digest.update(pixels.data)
    return digest.digest()


def _note_undo(*_: object) -> None:
    global _undone
    _undone = True


def forget_overwritten() -> None:
    """Drop the parts that `overwrite` has kept, as only the last run can be undone."""
    _overwritten.clear()
    if _note_undo in bpy.app.handlers.undo_post:  # Blender drops it when it loads a file
        bpy.app.handlers.undo_post.remove(_note_undo)


def sizes_of(parts: Tiles) -> dict[int, tuple[int, int]]:
    """Return height and width of each part."""
    return {number: pixels.shape[:2] for number, pixels in parts.items()}


@forgetting.with_file
def forget() -> None:
    """Forget all images that were written."""
    _written.clear()
    forget_overwritten()
