# SPDX-License-Identifier: GPL-3.0-or-later
"""What is known of how outputs were made, so that a later run makes only what is missing.

Each output has a small file of its own, in the folder ``.shock-filter`` beside it, so that no two
workers write the same one. It holds two digests: of all that the output was made from, and of what
the output was when it was complete. What is damaged or missing fits nothing, and costs time only.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import uuid
from pathlib import Path
from typing import Any

from ... import __version__
from .inputs import FileName, whole

_FOLDER = ".shock-filter"
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


def is_done(target: Path, made: str) -> bool:
    """Whether an output is there, was made like this, and is as it was then."""
    return _path(target).exists() and _read(target) == _content(target, made)


def is_ours(target: Path) -> bool:
    """Whether an output was made here, in whatever way, and is as it was then.

    Where its record is damaged, nothing speaks against that.
    """
    if not _path(target).exists():
        return False
    found = _read(target)
    return found is None or found == _content(target, found["made"])


def keep(target: Path, made: str) -> None:
    """Note that an output is complete, and how it was made."""
    path = _path(target)
    path.parent.mkdir(exist_ok=True)
    new = path.with_name(uuid.uuid4().hex)
    try:
        new.write_text(json.dumps(_content(target, made)), encoding="utf-8")
        os.replace(new, path)
    finally:
        new.unlink(missing_ok=True)


def _content(target: Path, made: Any) -> dict[str, Any]:
    return {"file": target.name, "made": made, "output": _digest(_state(target))}


def _path(target: Path) -> Path:
    # By a digest, as the longest names leave no room for an ending.
    return target.parent / _FOLDER / f"{_digest(target.name)}.json"


def _read(target: Path) -> dict[str, Any] | None:
    """Read a record; None where it is damaged."""
    try:
        found = json.loads(_path(target).read_bytes())
    except ValueError:
        return None
    return found if isinstance(found, dict) and "made" in found else None


def _state(path: Path) -> list[tuple[str, int, int]]:
    """Sizes and times of a file, or of all in a folder; none of what is not there."""
    files = sorted(path.rglob("*")) if path.is_dir() else [path]
    found = [(str(file.relative_to(path)), file.stat()) for file in files if file.is_file()]
    return [(name, about.st_size, about.st_mtime_ns) for name, about in found]


def _digest(value: Any) -> str:
    return hashlib.sha256(repr(value).encode()).hexdigest()[:32]
