# SPDX-License-Identifier: GPL-3.0-or-later
"""Records of how outputs were made, so that a later run makes only what is missing.

Each output has its own small file in the folder ``.shock-filter`` beside it, so that no two workers
write the same one. It is written before the output is moved to its place, and holds digests: of
everything that the output was made from, of the complete output, and of the file before it. A
damaged or missing record matches nothing, and only costs time.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from ... import __version__
from ..errors import ShockError
from ..files.output import is_same
from ..files.staging import held, is_temporary
from .inputs import files_named, whole

_FOLDER, _LOCK = ".shock-filter", "lock"
_ASIDE = {"command", "inputs", "output", "overwrite", "quiet", "cluster", "resume", "has_several"}
"""Flags that results do not depend on; the command is included by its name."""


def fingerprint(source: str, options: argparse.Namespace) -> str:
    """Digest everything an output is made from: version, command, flags, and the current files.

    Files are identified by name, size and time, also those beside a model that it names.
    """
    from ..files.formats.mesh.contents import side_files

    given = {name: value for name, value in sorted(whole(options).items()) if name not in _ASIDE}
    place = os.path.abspath(source)
    read = [place, *map(str, side_files(Path(place))), *files_named(given.values())]
    states = [(name, _state(Path(name))) for name in read]
    return _digest((__version__, options.command.command, given, states))


def check_folder(target: Path) -> None:
    """Refuse folders in which records cannot be kept, before anything is written."""
    folder = target.parent / _FOLDER
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise ShockError(
            f"{folder} is no folder, or a link, and records of outputs are kept there; rename it,"
            " or leave out --resume and --cluster."
        )
    if folder.exists() and not os.access(folder, os.W_OK | os.X_OK):
        raise ShockError(
            f"Cannot write to the folder {folder}, where records of outputs are kept; change its"
            " permissions, or leave out --resume and --cluster."
        )


def is_done(target: Path, made: str) -> bool:
    """Whether an output exists, was made like this, and is unchanged since."""
    found = _read(target)
    if not found or not target.exists():
        return False
    return found.get("made") == made and found.get("output") == _digest(_state(target))


def is_ours(target: Path) -> bool:
    """Whether an output was made here, with any settings, and is unchanged since.

    Also true if it is unchanged since before a run that was killed, or if the record is damaged,
    as nothing contradicts it.
    """
    if not _path(target).exists():
        return False
    found = _read(target)
    if not found:
        return True
    if "states" in found:
        return set(_state(target)) <= set(map(tuple, found["states"]))
    return _digest(_state(target)) in (found.get("output"), found.get("before"))


class Record:
    """Notes how outputs are made before they are moved to their places: kills cannot part them.

    The first output may bring others that appear with it in its folder; all others are announced by
    themselves. If an output is a folder whose files appear one by one, each file is noted before it
    is moved, until all are there.
    """

    def __init__(self, outputs: list[Path], made: str) -> None:
        self._target, *self._others = outputs
        self._made = made
        self._places = {Path(os.path.realpath(each)): each for each in outputs}
        self._real = Path(os.path.realpath(self._target))
        self._is_begun = self._is_whole = False

    @contextlib.contextmanager
    def guard(self, place: Path) -> Iterator[Callable[[Path], None]]:
        """Keep other runs from taking a place until its new file is noted; see `guarded`."""
        real = Path(os.path.realpath(place))
        folder = self._places.get(real, self._target).parent / _FOLDER
        folder.mkdir(exist_ok=True)
        with held(folder / _LOCK, wait=True):
            yield lambda new: self._note(new, real)

    def _note(self, new: Path, place: Path) -> None:
        if output := self._places.get(place):
            self._note_whole(output, _state(new))
            if output == self._target:
                self._is_whole = True
                self._note_others(new)
            return
        if not self._is_begun:
            self._is_begun = True
            _write(self._target, {"output": None, "states": _state(self._target)}, self._made)
        name = place.relative_to(self._real).as_posix()
        with _path(self._target).open("a", encoding="utf-8") as stream:
            stream.write("\n" + json.dumps([name, *_state(new)[0][1:]]))

    def _note_whole(self, output: Path, state: list[tuple[str, int, int]]) -> None:
        before = _digest(_state(output)) if output.exists() else None
        _write(output, {"output": _digest(state), "before": before}, self._made)

    def _note_others(self, first: Path) -> None:
        for output in self._others:
            new = first.with_name(output.name)
            if new.is_file():
                # Files with the same contents are not moved.
                self._note_whole(output, _state(output if is_same(new, output) else new))

    def complete(self) -> None:
        """Note that the first output is complete."""
        if not self._is_whole:
            with self.guard(self._target):
                _write(self._target, {"output": _digest(_state(self._target))}, self._made)


def _write(target: Path, fields: dict[str, Any], made: str) -> None:
    path = _path(target)
    new = path.with_suffix(".new")
    text = json.dumps({"file": target.name, "made": made, **fields})
    new.write_text(text, encoding="utf-8")
    os.replace(new, path)


def _path(target: Path) -> Path:
    # By a digest, as the longest file names have no room for an ending.
    return target.parent / _FOLDER / f"{_digest(target.name)}.json"


def _read(target: Path) -> dict[str, Any] | None:
    """Read a record, with the files that were noted since; None if it is damaged or missing.

    The last file is ignored if its line is truncated: it was not moved.
    """
    try:
        first, *lines = _path(target).read_bytes().split(b"\n")
        found = json.loads(first)
        states = [json.loads(line) for line in lines[:-1]]
        with contextlib.suppress(ValueError):
            states += [json.loads(line) for line in lines[-1:]]
        if "states" in found:
            found["states"] = [
                (str(name), size, time) for name, size, time in found["states"] + states
            ]
        return found if found["file"] == target.name and "made" in found else None
    except (OSError, ValueError, TypeError, KeyError):
        return None


def _state(path: Path) -> list[tuple[str, int, int]]:
    """Sizes and times of a file, or of all files in a folder; empty if it does not exist."""
    files = sorted(path.rglob("*")) if path.is_dir() else [path]
    named = [(file.relative_to(path), file) for file in files if file.is_file()]
    own = [(name, file.stat()) for name, file in named if not any(map(is_temporary, name.parts))]
    return [(str(name), status.st_size, status.st_mtime_ns) for name, status in own]


def _digest(value: Any) -> str:
    return hashlib.sha256(repr(value).encode()).hexdigest()[:32]
