# SPDX-License-Identifier: GPL-3.0-or-later
"""Zarr arrays, which are folders, as pictures of any size."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...errors import ShockError
from ..image_file import ImageFile
from ..reading import needed, reading

ENDING = ".zarr"
_FILES = ("zarr.json", ".zarray", ".zgroup")


def is_zarr(path: Path) -> bool:
    """Whether a folder holds Zarr's own files."""
    return any((path / name).is_file() for name in _FILES)


def open_zarr(path: Path) -> ImageFile:
    """Open a folder that is an array, or a group of one; the pixels are Zarr's array."""
    if not path.exists():
        raise ShockError(f"There is no file {path}; check its name and folder.")
    if not is_zarr(path):
        raise ShockError(f"{path} is no Zarr array; save the picture as one, or as a tiled TIFF.")
    zarr = needed("zarr", path, "cluster")
    with reading(path):
        found = zarr.open(str(path), mode="r")
        arrays = dict(found.arrays()) if isinstance(found, zarr.Group) else {"": found}
    if len(arrays) != 1:
        raise ShockError(
            f"{path} is a group of {len(arrays)} arrays; save one of them as a Zarr array alone."
        )
    (array,) = arrays.values()
    return ImageFile(array, "Zarr", own=dict(array.attrs))


def create_zarr(
    path: Path, source: ImageFile, shape: tuple[int, ...], kind: np.dtype, chunks: tuple[int, ...]
) -> Any:
    """Make an empty array, in the format and with the attributes of the source if that is one."""
    zarr = needed("zarr", path, "cluster")
    is_zarr = source.format == "Zarr"
    words: dict[str, Any] = {}
    if is_zarr and hasattr(source.pixels, "metadata"):  # Zarr 3 writes two formats
        words["zarr_format"] = source.pixels.metadata.zarr_format
    array = zarr.open_array(str(path), mode="w", shape=shape, dtype=kind, chunks=chunks, **words)
    array.attrs.update(source.own if is_zarr else {})
    return array
