# SPDX-License-Identifier: GPL-3.0-or-later
"""What HDF5 files, NetCDF-4 among them, take from other files: links, raw data, virtual datasets.

The library follows these wherever they lead. A file from a stranger could show any file of its
reader as numbers, so they may lead to the file's own folder only.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ...errors import ShockError
from ..reading import needed

_SAME_FILE = "."
_MOST_OBJECTS = 1_000_000


def check_hdf5(path: Path) -> None:
    """Refuse an HDF5 file that takes something from outside its folder; others pass.

    Raises
    ------
    ShockError
        Naming what it would read.
    """
    h5py = needed("h5py", path, "fields")
    waiting, seen = [path], set()
    while waiting:
        file = waiting.pop()
        if file.resolve() in seen or not h5py.is_hdf5(file):
            continue
        seen.add(file.resolve())
        with h5py.File(file, "r") as opened:
            for name in _named_files(opened):
                waiting += _found_inside(path, file.parent, name)


def _named_files(opened: Any) -> Iterator[str]:
    """Walk over all that a file names of other files, without following it."""
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
        if isinstance(thing, h5py.Dataset):
            yield from (name for name, _, _ in thing.external or ())
            if thing.is_virtual:
                yield from (source.file_name for source in thing.virtual_sources())
        elif isinstance(thing, h5py.Group):
            for name in thing:
                link = thing.get(name, getlink=True)
                if isinstance(link, h5py.ExternalLink):
                    yield link.filename
                elif isinstance(link, h5py.HardLink):
                    waiting.append(thing[name])


def _found_inside(path: Path, folder: Path, name: str) -> list[Path]:
    """Return the files that a name can mean; refuse those beyond the folder."""
    if name == _SAME_FILE:
        return []
    # Raw data are looked for from the working directory, the rest from the file's folder, too.
    found = [place for place in (folder / name, Path.cwd() / name) if place.exists()]
    for place in found:
        if not place.resolve().is_relative_to(path.parent.resolve()):
            raise ShockError(
                f"{path} takes data from {name}, which is not in its folder; copy them into the"
                " file, for example with h5repack or nccopy."
            )
    return found
