# SPDX-License-Identifier: GPL-3.0-or-later
"""The pixels of images with UDIM tiles.

Scripts can access only the pixels of the first tile in Blender. So tiles are read from their files,
and written as packed files: bytes as PNG and floats as OpenEXR, both lossless.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np
import numpy.typing as npt

from ..arrays import check_same, read_pixels, write_pixels
from ..skipped import Skipped

Tiles = dict[int, npt.NDArray[np.float32]]
"""The pixels of each tile, from the bottom up, under the tile's number."""

_NUMBER, _COLUMN_AND_ROW = "<UDIM>", "<UVTILE>"
_FORMATS = {False: ("PNG", ".png"), True: ("OPEN_EXR", ".exr")}


def read_tiles(image: bpy.types.Image) -> Tiles:
    """Read all tiles with pixels, from the blend file or their own files.

    Raises
    ------
    Skipped
        If one of them cannot be read.
    """
    numbers = sorted(tile.number for tile in image.tiles if tile.size[0])
    packed = {each.tile_number: each.packed_file.data for each in image.packed_files}
    tiles = {}
    with tempfile.TemporaryDirectory(prefix="shock_filter_") as folder:
        for number in numbers:
            path = bpy.path.abspath(_numbered(image.filepath_raw, number))
            if number in packed:
                path = str(Path(folder, f"{number}{Path(path).suffix}"))
                Path(path).write_bytes(packed[number])
            tiles[number] = _read(path, number, image)
    return tiles


def write_tiles(image: bpy.types.Image, tiles: Tiles) -> None:
    """Replace the pixels of all tiles, and pack them into the blend file.

    Raises
    ------
    Skipped
        If the disk has no room for the tiles; nothing has changed then.
    """
    path = image.filepath_raw
    with _files(image, tiles) as pattern:
        if image.packed_files:
            image.unpack(method="REMOVE")
        dress(image, image)
        image.filepath_raw = str(pattern)
        image.reload()
        image.pack()
    _name_files(image, path)


def new_tiled_like(image: bpy.types.Image, name: str, tiles: Tiles) -> bpy.types.Image:
    """Add an image of the same kind with these tiles, packed into the blend file."""
    with _files(image, tiles) as pattern:
        new = bpy.data.images.load(_numbered(pattern, min(tiles)))
        new.name = name
        new.source = "TILED"
        dress(new, image)
        new.pack()
    _name_files(new, "")
    return new


def _name_files(image: bpy.types.Image, path: str) -> None:
    """Set the file names for unpacking: those of the path, or made from the image's name."""
    stem = os.path.splitext(path)[0]
    if _NUMBER not in stem and _COLUMN_AND_ROW not in stem:
        stem = f"//{bpy.path.clean_name(image.name)}.{_NUMBER}"
    image.filepath_raw = stem + _FORMATS[image.is_float][1]
    for packed in image.packed_files:
        packed.filepath = _numbered(image.filepath_raw, packed.tile_number)


def dress(new: bpy.types.Image, image: bpy.types.Image) -> None:
    """Give `new` the color space and opacity of `image`, for pixels saved as in memory."""
    space, alpha = image.colorspace_settings.name, image.alpha_mode
    if image.is_float and not image.colorspace_settings.is_data:
        space = _linear_space()
    if alpha in {"STRAIGHT", "PREMUL"}:  # in memory, and so in files, only floats are multiplied
        alpha = "PREMUL" if image.is_float else "STRAIGHT"
    new.colorspace_settings.name = space
    new.alpha_mode = alpha


@contextmanager
def _files(image: bpy.types.Image, tiles: Tiles) -> Iterator[Path]:
    """Yield a pattern for the files of tiles, in a temporary folder."""
    with tempfile.TemporaryDirectory(prefix="shock_filter_") as folder:
        file_format, suffix = _FORMATS[image.is_float]
        pattern = Path(folder, f"tile.{_NUMBER}{suffix}")
        for number, pixels in tiles.items():
            height, width = pixels.shape[:2]
            part = bpy.data.images.new(
                "tile", width, height, alpha=True, float_buffer=image.is_float, is_data=True
            )
            try:
                part.alpha_mode = "CHANNEL_PACKED"  # nothing is multiplied
                write_pixels(part, pixels)
                part.file_format = file_format
                _save(part, _numbered(pattern, number), number)
            finally:
                bpy.data.images.remove(part)
        yield pattern


def _save(part: bpy.types.Image, path: str, number: int) -> None:
    """Save a tile and read it back, as Blender does not always report a full disk.

    Raises
    ------
    Skipped
        If the file does not hold the pixels of the tile.
    """
    try:
        part.save(filepath=path)
        saved = _read(path, number, part)
        check_same(saved, read_pixels(part))
    except (RuntimeError, Skipped) as error:
        raise Skipped(
            "its tile {number} cannot be saved; make room on the disk of {folder}",
            number=number,
            folder=tempfile.gettempdir(),
        ) from error


def _numbered(pattern: Path | str, number: int) -> str:
    row, column = divmod(number - 1001, 10)
    named = str(pattern).replace(_COLUMN_AND_ROW, f"u{column + 1}_v{row + 1}")
    return named.replace(_NUMBER, str(number))


def _read(path: str, number: int, image: bpy.types.Image) -> npt.NDArray[np.float32]:
    try:
        part = bpy.data.images.load(path)
    except RuntimeError as error:
        raise Skipped(
            "its tile {number} cannot be read; check that {path} exists", number=number, path=path
        ) from error
    try:
        part.colorspace_settings.name = image.colorspace_settings.name
        part.alpha_mode = image.alpha_mode
        if not part.size[0] * part.size[1]:
            raise Skipped(
                "its tile {number} cannot be read; check that {path} is an image",
                number=number,
                path=path,
            )
        if part.is_float != image.is_float:
            raise Skipped(
                "its tile {number} has another depth than the first; save them alike",
                number=number,
            )
        return read_pixels(part)
    finally:
        bpy.data.images.remove(part)


def _linear_space() -> str:
    """Return the color space that floats have in memory."""
    sample = bpy.data.images.new("sample", 1, 1, float_buffer=True)
    name = sample.colorspace_settings.name
    bpy.data.images.remove(sample)
    return name
