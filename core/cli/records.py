# SPDX-License-Identifier: GPL-3.0-or-later
"""What is known of how outputs were made, so that a later run makes only what is missing.

Each output has a small file of its own, in the folder ``.shock-filter`` beside it, so that no two
workers write the same one. It is written before the output is moved to its place, and holds
digests: of all that the output was made from, of what it is when it is complete, and of what was
there before. What is damaged or missing fits nothing, and costs time only.
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
from ..files.staging import held, is_temporary
from .inputs import FileName, whole

_FOLDER, _LOCK = ".shock-filter", "lock"
_ASIDE = {"command", "inputs", "output", "overwrite", "quiet", "cluster", "resume"}
"""What no result depends on; the command counts by its name."""


def fingerprint(source: str, options: argparse.Namespace) -> str:
    """Digest what an output is made from: version, command, flags, and the files as they are now.

    Of files count name, size and time. Those that a mesh names, such as buffers, do not.
    """
    given = {name: value for name, value in sorted(whole(options).items()) if name not in _ASIDE}
    read = [os.path.abspath(source)]
    for value in given.values():
        values = value if isinstance(value, list) else [value]
        read += [each for each in values if isinstance(each, FileName)]
    states = [(name, _state(Path(name))) for name in read]
    return _digest((__version__, options.command.command, given, states))


def check_folder(target: Path) -> None:
    """Refuse to keep records where they cannot be, before anything is written."""
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
    """Whether an output is there, was made like this, and is as it was then."""
    found = _read(target)
    if not found or not target.exists():
        return False
    return found.get("made") == made and found.get("output") == _digest(_state(target))


def is_ours(target: Path) -> bool:
    """Whether an output was made here, in whatever way, and is as it was then.

    It is, too, while it is as it was before a run that was killed. Where the record is damaged,
    nothing speaks against it.
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
    """Notes how an output is made: before it is moved to its place, so that no kill parts the two.

    Of an output that is a folder of files which come one by one, each file is noted before it is
    moved, until all are there.
    """

    def __init__(self, target: Path, made: str) -> None:
        self._target, self._made = target, made
        self._real = Path(os.path.realpath(target))
        self._is_begun = self._is_whole = False

    @contextlib.contextmanager
    def guard(self, place: Path) -> Iterator[Callable[[Path], None]]:
        """Let no other run take a place before what is to be there is noted; see `guarded`."""
        folder = self._target.parent / _FOLDER
        folder.mkdir(exist_ok=True)
        with held(folder / _LOCK, wait=True):
            yield lambda new: self._note(new, Path(os.path.realpath(place)))

    def _note(self, new: Path, place: Path) -> None:
        if place == self._real:
            self._is_whole = True
            before = _digest(_state(self._target)) if self._target.exists() else None
            _write(self._target, {"output": _digest(_state(new)), "before": before}, self._made)
            return
        if not self._is_begun:
            self._is_begun = True
            _write(self._target, {"output": None, "states": _state(self._target)}, self._made)
        name = place.relative_to(self._real).as_posix()
        with _path(self._target).open("a", encoding="utf-8") as stream:
            stream.write("\n" + json.dumps([name, *_state(new)[0][1:]]))

    def complete(self) -> None:
        """Note that all of an output is there."""
        if not self._is_whole:
            with self.guard(self._target):
                _write(self._target, {"output": _digest(_state(self._target))}, self._made)


def _write(target: Path, about: dict[str, Any], made: str) -> None:
    path = _path(target)
    new = path.with_suffix(".new")
    text = json.dumps({"file": target.name, "made": made, **about})
    new.write_text(text, encoding="utf-8")
    os.replace(new, path)


def _path(target: Path) -> Path:
    # By a digest, as the longest names leave no room for an ending.
    return target.parent / _FOLDER / f"{_digest(target.name)}.json"


def _read(target: Path) -> dict[str, Any] | None:
    """Read a record, with the files that were noted since; None where it is damaged or not there.

    The last file is not counted if its line is cut: it was not moved.
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
    """Sizes and times of a file, or of all in a folder; none of what is not there."""
    files = sorted(path.rglob("*")) if path.is_dir() else [path]
    named = [(file.relative_to(path), file) for file in files if file.is_file()]
    own = [(name, file.stat()) for name, file in named if not any(map(is_temporary, name.parts))]
    return [(str(name), about.st_size, about.st_mtime_ns) for name, about in own]


def _digest(value: Any) -> str:
    return hashlib.sha256(repr(value).encode()).hexdigest()[:32]
