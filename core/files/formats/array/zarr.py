# SPDX-License-Identifier: GPL-3.0-or-later
"""Zarr arrays, which are folders, as images of any size."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ....errors import ShockError
from ...reading import needed, reading
from ..image.image_file import ImageFile
from .zarr_metadata import FILES, check_zarr

ENDING = ".zarr"
_ABOUT = (*FILES, ".zattrs", ".zmetadata")


@dataclass(frozen=True)
class _Place:
    """The folder that was opened, and the picture's path in it; empty for the folder itself."""

    folder: Path
    name: str


def open_zarr(path: Path, any_size: bool = False) -> ImageFile:
    """Open a folder that is an array or a group with one picture; pixels stay a Zarr array.

    Raises
    ------
    ShockError
        As `check_zarr`, and if a group has no picture or several pictures.
    """
    with reading(path, any_size):
        check_zarr(path)
    zarr = needed("zarr", path, "cluster")
    with reading(path):
        found = zarr.open(zarr.storage.LocalStore(path.absolute(), read_only=True), mode="r")
        arrays = dict(found.arrays()) if isinstance(found, zarr.Group) else {"": found}
    # Arrays of one axis are coordinates of the picture's axes.
    pictures = {name: array for name, array in arrays.items() if not name or array.ndim > 1}
    if len(pictures) != 1:
        raise ShockError(
            f"{path} is a group of {len(arrays)} arrays, {len(pictures)} of them pictures; save one"
            " of them as a Zarr array alone."
        )
    ((name, array),) = pictures.items()
    return ImageFile(array, "Zarr", own=_Place(path, name))


def create_zarr(path: Path, shape: tuple[int, ...], kind: np.dtype, chunks: tuple[int, ...]) -> Any:
    """Make an empty array."""
    zarr = needed("zarr", path, "cluster")
    store = zarr.storage.LocalStore(path.absolute())
    return zarr.open_array(store, mode="w", shape=shape, dtype=kind, chunks=chunks)


def create_zarr_like(
    path: Path, source: ImageFile, shape: tuple[int, ...]
) -> tuple[Any, list[str]]:
    """Make an empty array like the source's, with its metadata and the arrays beside it.

    The metadata equal those of the source, except for the shape: names of dimensions, fill value,
    codecs, shards, attributes, and the group with its own. Coordinates are copied unless the shape
    differs.

    Returns
    -------
    zarr.Array
    list of str
        Notes on what was left behind.
    """
    zarr = needed("zarr", path, "cluster")
    place: _Place = source.own
    is_as_large = tuple(shape) == tuple(source.pixels.shape)
    left = []
    path.mkdir()
    for part in sorted(place.folder.iterdir()):
        if part.name in _ABOUT:
            shutil.copyfile(part, path / part.name)
        elif place.name and part.name != place.name and part.is_dir():
            if is_as_large:
                shutil.copytree(part, path / part.name)
            else:
                left.append(part.name)
    if place.name:
        (path / place.name).mkdir()
        for name in _ABOUT:
            if (place.folder / place.name / name).is_file():
                shutil.copyfile(place.folder / place.name / name, path / place.name / name)
    if not is_as_large:
        _resize(path, place.name, shape, left)
    notes = [f"{', '.join(left)} did not fit the new size: left behind"] if left else []
    with reading(place.folder):
        array = zarr.open_array(zarr.storage.LocalStore(path.absolute() / place.name), mode="r+")
        # Not all codecs that can be read can be written: try one pixel, overwritten later.
        array[(0,) * array.ndim] = 0 if array.fill_value else 1
    return array, notes


def _resize(path: Path, name: str, shape: tuple[int, ...], left: list[str]) -> None:
    """Write another shape to all metadata of an array, and remove the metadata of `left`."""
    for file in ("zarr.json", ".zarray"):
        if (path / name / file).is_file():
            with _edited(path / name / file) as array:
                array["shape"] = list(shape)
    if not name:
        return
    if (path / ".zmetadata").is_file():
        with _edited(path / ".zmetadata") as consolidated:
            known = consolidated["metadata"]
            known[f"{name}/.zarray"]["shape"] = list(shape)
            for key in [key for key in known if key.partition("/")[0] in left]:
                del known[key]
    if (path / "zarr.json").is_file():
        with _edited(path / "zarr.json") as group:
            known = (group.get("consolidated_metadata") or {}).get("metadata", {})
            if name in known:
                known[name]["shape"] = list(shape)
            for key in [key for key in known if key.partition("/")[0] in left]:
                del known[key]


@contextmanager
def _edited(path: Path) -> Iterator[dict[str, Any]]:
    document = json.loads(path.read_bytes())
    yield document
    path.write_text(json.dumps(document, indent=2), encoding="utf-8")
