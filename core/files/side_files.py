# SPDX-License-Identifier: GPL-3.0-or-later
"""The files that a mesh file names: materials, textures, buffers.

Names come with the file, maybe from a stranger. So only plain files in or below the folder of the
mesh are read: no devices, and nothing that a link or ``..`` leads to elsewhere.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

from ..errors import ShockError

_MISSING = "left behind, as no plain files beside the input: {}"


def relative(name: str) -> PurePosixPath:
    """A name as a path, also if it was written on Windows."""
    return PurePosixPath(name.strip().replace("\\", "/"))


def find(folder: Path, name: str) -> Path | None:
    """The plain file that a name means; None if there is none in or below the folder."""
    if ".." in relative(name).parts:
        return None
    try:
        path = (folder / relative(name)).resolve()
        return path if path.is_relative_to(folder.resolve()) and path.is_file() else None
    except (OSError, RuntimeError, ValueError):  # too long, links in a circle, a zero in it
        return None


def read(folder: Path, name: str, size: int) -> bytes:
    """Read the first bytes of a file that the model cannot do without."""
    path = find(folder, name)
    if path is None:
        raise ShockError(
            f"The file {name!r}, which the model needs, is not in the model's folder or below it;"
            " put it there, or export the model as one file (.glb)."
        )
    if path.stat().st_size < size:
        raise ShockError(f"{path} is shorter than the model says; copy or export it again.")
    with path.open("rb") as stream:
        return stream.read(size)


def copy_beside(source: Path, names: Iterable[str], target: Path) -> list[str]:
    """Copy files that a mesh file names; returns a note on those that cannot be."""
    missing = []
    for name in dict.fromkeys(names):
        found, copy = find(source.parent, name), target.parent / relative(name)
        if found is None or copy == target:
            missing.append(name)
            continue
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(found, copy)
    return [_MISSING.format(", ".join(missing))] if missing else []


class Resolver:
    """Hands trimesh what a file names."""

    def __init__(self, path: Path, known: dict[str, bytes]) -> None:
        self._folder = path.parent
        self._known = known  # what was read already, by name
        self._missing: list[str] = []

    def get(self, name: str) -> bytes:
        """Read a file, or note that it is missing."""
        if name in self._known:
            return self._known[name]
        path = find(self._folder, name) or find(self._folder, unquote(name))
        if path is None:
            self._missing.append(name)
            raise FileNotFoundError(f"{name} is no plain file in the model's folder")
        return path.read_bytes()

    __getitem__ = get

    def notes(self) -> list[str]:
        """What is to be said of files that were missing."""
        return [_MISSING.format(", ".join(self._missing))] if self._missing else []

    def keys(self) -> list[str]:
        """No names: what is not asked for is not looked for."""
        return []
