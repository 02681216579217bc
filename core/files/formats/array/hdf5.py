# SPDX-License-Identifier: GPL-3.0-or-later
"""References of HDF5 files (also NetCDF-4) to other files: links, raw data, virtual datasets.

The library follows these anywhere. A stranger's file could present any file of its reader as
numbers, so references may only lead to the file's own folder.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ....errors import ShockError
from ...reading import needed

_SAME_FILE = ("", ".")
_MOST_OBJECTS = 1_000_000
_UNPACK = {1, 4, 307, 32000, 32001, 32004, 32015, 32026}
"""Numbers of deflate, szip, bzip2, lzf, blosc, lz4, zstd and blosc2."""


def check_hdf5(path: Path) -> None:
    """Refuse an HDF5 file that reads anything outside its folder; accept other files.

    Raises
    ------
    ShockError
        If it does, naming the file, or if its chunks are compressed several times over.
    """
    h5py = needed("h5py", path, "fields")
    waiting, seen = [path], set()
    while waiting:
        file = waiting.pop()
        if file.resolve() in seen or not h5py.is_hdf5(file):
            continue
        seen.add(file.resolve())
        with h5py.File(file, "r") as opened:
            for thing in _objects(opened):
                if isinstance(thing, h5py.Dataset):
                    _check_packed(path, thing)
                for name in _named_files(thing):
                    waiting += _found_inside(path, file, name)


def _objects(opened: Any) -> Iterator[Any]:
    """Walk over all groups and datasets of a file, without leaving it."""
    import h5py

    waiting, seen = [opened], set()
    while waiting:
        thing = waiting.pop()
        address = h5py.h5o.get_info(thing.id).addr
        if address in seen:
            continue
        seen.add(address)
        if len(seen) > _MOST_OBJECTS:
            raise ShockError(f"{opened.filename} has too many parts; save its velocities alone.")
        yield thing
        if isinstance(thing, h5py.Group):
            for name in thing:
                if isinstance(thing.get(name, getlink=True), h5py.HardLink):
                    waiting.append(thing[name])


def _named_files(thing: Any) -> Iterator[str]:
    """Yield the names of other files that a group or dataset holds, without following them."""
    import h5py

    if isinstance(thing, h5py.Dataset):
        yield from (name for name, _, _ in thing.external or ())
        if thing.is_virtual:
            yield from (source.file_name for source in thing.virtual_sources())
    elif isinstance(thing, h5py.Group):
        links = (thing.get(name, getlink=True) for name in thing)
        yield from (link.filename for link in links if isinstance(link, h5py.ExternalLink))


def _found_inside(path: Path, file: Path, name: str) -> list[Path]:
    """Return the files that a name can mean; refuse any outside the folder, existing or not."""
    if name in _SAME_FILE:
        return []
    inside = path.parent.resolve()
    beside = [folder / name for folder in (file.parent, file.resolve().parent)]
    # Raw data are searched from the working directory, other files from there last.
    here = Path.cwd() / name
    places = [*beside, here] if here.exists() else beside
    # The library replaces "%" by numbers.
    if "%" in name or not all(place.resolve().is_relative_to(inside) for place in places):
        raise ShockError(
            f"{path} takes data from {name}, which is not in its folder; copy them into the"
            " file, for example with h5repack or nccopy."
        )
    # If there is no such file, the library uses one of that name in the folder.
    return [*places, *(place.parent / Path(name).name for place in (file, file.resolve()))]


def _check_packed(path: Path, dataset: Any) -> None:
    """Refuse data compressed twice: a few bytes could then unpack to any size."""
    filters = dataset.id.get_create_plist()
    numbers = [filters.get_filter(index)[0] for index in range(filters.get_nfilters())]
    if sum(number in _UNPACK for number in numbers) > 1:
        raise ShockError(
            f"{path}: {dataset.name} is packed several times over; save it with one compressor, or"
            " with none."
        )
