# SPDX-License-Identifier: GPL-3.0-or-later
"""The files that a mesh file names: materials, textures, buffers.

The names may come from a stranger. So only plain files in or below the folder of the mesh are read:
no devices, and nothing elsewhere that a link or ``..`` leads to.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable
from pathlib import Path, PurePosixPath, PureWindowsPath
from urllib.parse import unquote, urlsplit

from ..errors import ShockError
from .staging import inside, within

_MISSING = "left behind, as no plain files beside the input: {}"


def located(folder: Path, name: str) -> PurePosixPath | None:
    """A name as a path below the folder of a mesh, also in Windows notation; None if elsewhere.

    Names may be absolute, or file URLs, as some exporters write them.
    """
    text = name.strip()
    if text[:5].lower() == "file:":
        address = urlsplit(text)
        text = unquote(address.path) if address.netloc in ("", "localhost") else text
    text = text.replace("\\", "/")
    for root in (os.path.abspath(folder), os.path.realpath(folder)):
        start = root.replace("\\", "/").rstrip("/") + "/"
        if os.path.normcase(text).startswith(os.path.normcase(start)):
            return inside(text[len(start) :])
    return inside(text)


def is_absolute(name: str) -> bool:
    """Whether a name is independent of the folder of the mesh."""
    text = name.strip().replace("\\", "/")
    return text[:5].lower() == "file:" or text.startswith("/") or bool(PureWindowsPath(text).drive)


def find(folder: Path, name: str) -> Path | None:
    """The plain file with this name; None if there is none in or below the folder."""
    try:
        place = located(folder, name)
        if place is None:
            return None
        path = (folder / place).resolve()
        return path if path.is_relative_to(folder.resolve()) and path.is_file() else None
    except (OSError, RuntimeError, ValueError):  # too long, circular links, a null byte
        return None


def read(folder: Path, name: str, size: int) -> bytes:
    """Read the first bytes of a file that the model needs."""
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


def copy_beside(source: Path, names: Iterable[str], stage: Path) -> tuple[list[Path], list[str]]:
    """Copy files that a mesh file names; returns the copies, and a note on failures."""
    copies: dict[PurePosixPath, Path] = {}
    missing = []
    for name in dict.fromkeys(names):
        found, place = find(source.parent, name), located(source.parent, name)
        if found is None or place is None or stage.parent / place == stage:
            missing.append(name)
        elif place not in copies:
            copies[place] = within(stage.parent, place)
            shutil.copyfile(found, copies[place])
    notes = [_MISSING.format(", ".join(missing))] if missing else []
    return list(copies.values()), notes


def are_beside(source: Path, target: Path) -> bool:
    """Whether two files are in one folder, so that relative names mean the same for both."""
    return os.path.realpath(source.parent) == os.path.dirname(os.path.realpath(target))


class Resolver:
    """Gives trimesh the files that a file names."""

    def __init__(self, path: Path, known: dict[str, bytes]) -> None:
        self.file_name = path.stem  # by which trimesh calls what has no name
        self._folder = path.parent
        self._known = known  # files that were read already, by name
        self._missing: list[str] = []

    def get(self, name: str) -> bytes:
        """Read a file, or note that it is missing."""
        if name in self._known:
            return self._known[name]
        path = self._find(name)
        if path is None:
            raise FileNotFoundError(f"{name} is no plain file in the model's folder")
        return path.read_bytes()

    __getitem__ = get

    def has(self, name: str) -> bool:
        """Whether a file can be read; notes that it is missing otherwise."""
        return self._find(name) is not None

    def _find(self, name: str) -> Path | None:
        path = find(self._folder, name) or find(self._folder, unquote(name))
        if path is None:
            self._missing.append(name)
        return path

    def notes(self) -> list[str]:
        """Notes on files that were missing."""
        return [_MISSING.format(", ".join(self._missing))] if self._missing else []

    def keys(self) -> list[str]:
        """No names: only files that are asked for are read."""
        return []
