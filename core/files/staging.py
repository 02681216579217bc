# SPDX-License-Identifier: GPL-3.0-or-later
"""Temporary folders for incomplete output, and the moves that put it in its place.

Each folder is beside its target, holds a marker, and is locked while its process lives. So a later
run recognizes what a killed run has left, whatever else has such a name.

Several files cannot be replaced at once. Their moves are written down first: a later run completes
them. Needs no numerics, like :mod:`.output`.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import os
import re
import secrets
import shutil
import time
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from ..errors import ShockError

_PREFIX = ".shock-filter-"
_FILES, _OLD, _MOVES, _BESIDE = "files", "old", "moves.json", "beside"
_MARKER = "made-by-shock-filter"
_MARK = b"Shock Filter writes here. A later run in the same folder removes what is left.\n"
_NEW = 10.0  # seconds; a younger folder may not be marked yet

Move = tuple[Path, Path]
"""A file or folder below a temporary folder, and its target."""


# ------------------------------------------------------------------------------------------ names


def inside(name: str | PurePosixPath) -> PurePosixPath | None:
    """A name as a path that stays in the folder where it is looked up; None if it leaves."""
    text = str(name).strip().replace("\\", "/")
    path = PurePosixPath(text)
    if "\0" in text or ".." in path.parts or path.is_absolute() or PureWindowsPath(text).drive:
        return None
    return path if path.parts else None


def within(folder: Path, name: str | PurePosixPath) -> Path:
    """The path of a new file of this name in a temporary folder.

    Raises
    ------
    ShockError
        If the name leads out of the folder, or another file has it already.
    """
    path = inside(name)
    if path is None:
        raise ShockError(f"The name {str(name)!r} leads to another folder; rename the file.")
    place = folder / path
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise _taken(path) from error
    if not place.parent.resolve().is_relative_to(folder.resolve()):
        raise ShockError(f"The name {str(name)!r} leads to another folder; rename the file.")
    if os.path.lexists(place):
        raise _taken(path)
    return place


def _taken(path: PurePosixPath) -> ShockError:
    return ShockError(f"Two files would be written to {path}; rename one, or the output.")


# ---------------------------------------------------------------------------------------- folders


def temporary_folder(parent: Path, stack: contextlib.ExitStack) -> Path:
    """Make a folder that is removed at the end, or by a later run if this one is killed."""
    parent = Path(os.path.realpath(parent))
    tidy(parent)
    token = secrets.token_hex(4)
    folder = parent / f"{_PREFIX}{token}{_check(token)}"
    folder.mkdir(mode=0o700)
    # A later run removes what workers of a cluster still write to it.
    stack.callback(_remove, folder)
    stack.enter_context(_marked(folder))
    files = folder / _FILES
    files.mkdir(mode=0o700)
    return files


@contextlib.contextmanager
def beside(stage: Path, ending: str) -> Iterator[Path]:
    """Yield a file in the folder that `stage` will be moved to; removed at the end, like a stage.

    For writers that store the names of other files relative to their own.
    """
    folder = _folder_of(stage)
    path = folder.with_name(folder.name + ending)
    (folder / _BESIDE).write_text(ending, encoding="utf-8")
    try:
        yield path
    finally:
        path.unlink(missing_ok=True)


def is_temporary(name: str) -> bool:
    """Whether a folder has the name of a temporary folder."""
    found = re.fullmatch(re.escape(_PREFIX) + "([0-9a-f]{8})([0-9a-f]{8})", name)
    return found is not None and _check(found[1]) == found[2]


def is_at_work(parent: Path) -> bool:
    """Whether another process uses a temporary folder in a folder."""
    for folder in parent.glob(f"{_PREFIX}*"):
        with contextlib.suppress(OSError):
            if _is_marked(folder):
                with held(folder / _MARKER) as is_free:
                    if is_free is False:
                        return True
    return False


def _check(token: str) -> str:
    return hashlib.sha256(_PREFIX.encode() + token.encode()).hexdigest()[: len(token)]


def _folder_of(path: Path) -> Path:
    return next(folder for folder in path.parents if is_temporary(folder.name))


@contextlib.contextmanager
def _marked(folder: Path) -> Iterator[None]:
    """Lock a folder, then mark it: a folder that is marked but not locked has lost its process."""
    marker = folder / _MARKER
    marker.touch(exist_ok=False)
    with held(marker, wait=True):
        marker.write_bytes(_MARK)
        yield


def _is_marked(folder: Path) -> bool:
    marker = folder / _MARKER
    links = folder.is_symlink() or marker.is_symlink()
    return not links and marker.is_file() and marker.read_bytes() == _MARK


@contextlib.contextmanager
def held(path: Path, wait: bool = False) -> Iterator[bool | None]:
    """Lock a file, made if needed, while this process lives; yields whether no other one does.

    Yields None if the system or the disk has no locks.
    """
    try:
        import fcntl
    except ImportError:  # Windows
        yield None
        return
    is_free: bool | None = True
    number = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
    try:
        try:
            fcntl.flock(number, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            is_free = False
        except OSError:
            is_free = None
        yield is_free
    finally:
        os.close(number)


def _remove(folder: Path) -> None:
    """Remove a temporary folder; its marker last, so that a kill leaves a recognizable folder."""
    with contextlib.suppress(OSError):
        (folder / _MOVES).unlink(missing_ok=True)
        for name in (_FILES, _OLD):
            shutil.rmtree(folder / name, ignore_errors=True)
        with contextlib.suppress(FileNotFoundError):
            ending = (folder / _BESIDE).read_text(encoding="utf-8")
            if inside(ending) == PurePosixPath(ending) and "/" not in ending:
                folder.with_name(folder.name + ending).unlink(missing_ok=True)
            (folder / _BESIDE).unlink()
        (folder / f"{_MOVES}.new").unlink(missing_ok=True)
        if {path.name for path in folder.iterdir()} <= {_MARKER}:
            (folder / _MARKER).unlink(missing_ok=True)
            folder.rmdir()


# ------------------------------------------------------------------------------------------- moves


def move_all(moves: Sequence[Move]) -> None:
    """Move files from a temporary folder to their places: all of them, or none.

    Existing files are replaced, and folders by folders. If the system refuses a move, those before
    it are undone. If the process is killed in between, `tidy` completes them.
    """
    folder = _folder_of(moves[0][0])
    replaces = [place.is_dir() for _, place in moves]
    several = len(moves) > 1
    if several or any(replaces):
        _write_down(folder, moves)
    undo = contextlib.ExitStack()
    try:
        for number, (new, place) in enumerate(moves):
            for parent in reversed([p for p in place.parents if not p.exists()]):
                parent.mkdir(exist_ok=True)
                undo.callback(_suppressed, parent.rmdir)
            old = folder / _OLD / str(number)
            if place.is_dir():
                old.parent.mkdir(exist_ok=True)
                undo.callback(_put_back, old, place)
            elif several and place.exists():
                old.parent.mkdir(exist_ok=True)
                _keep_copy(place, old)
                undo.callback(_put_back, old, place)
            elif several:
                undo.callback(place.unlink, missing_ok=True)
            _move(new, place, old)
    except BaseException:
        (folder / _MOVES).unlink(missing_ok=True)
        undo.close()
        raise
    (folder / _MOVES).unlink(missing_ok=True)


def _move(new: Path, place: Path, old: Path) -> None:
    if place.is_dir():
        os.replace(place, old)
    os.replace(new, place)


def _put_back(old: Path, place: Path) -> None:
    if old.exists() and not place.is_dir():
        os.replace(old, place)


def _suppressed(remove: Any) -> None:
    with contextlib.suppress(OSError):
        remove()


def _keep_copy(path: Path, copy: Path) -> None:
    try:
        os.link(path, copy)
    except (OSError, NotImplementedError):  # disks without hard links
        shutil.copy2(path, copy)


def _write_down(folder: Path, moves: Sequence[Move]) -> None:
    """Note the moves to be made, and the state of the files that they replace."""
    rows = [
        (
            new.relative_to(folder / _FILES).as_posix(),
            place.relative_to(folder.parent).as_posix(),
            _state(place),
        )
        for new, place in moves
    ]
    path = folder / f"{_MOVES}.new"
    path.write_text(json.dumps(rows), encoding="utf-8")
    os.replace(path, folder / _MOVES)


def _state(path: Path) -> list[int] | None:
    """Distinguishes a file or folder from another one of its name; None if there is none."""
    try:
        status = path.stat()
    except FileNotFoundError:
        return None
    return [0 if path.is_dir() else status.st_size, status.st_mtime_ns]


# --------------------------------------------------------------------------------------- left-overs


def tidy(parent: Path) -> None:
    """Finish or remove what killed runs have left in a folder."""
    _tidy(Path(os.path.realpath(parent)))


@functools.cache  # once per folder, since searching it takes a while
def _tidy(parent: Path) -> None:
    for folder in sorted(parent.glob(f"{_PREFIX}*")):
        with contextlib.suppress(OSError):
            if _is_marked(folder):
                with held(folder / _MARKER) as is_free:
                    if is_free and _finish(folder):
                        _remove(folder)
            elif is_temporary(folder.name) and not folder.is_symlink():
                _remove_unmarked(folder)


def _remove_unmarked(folder: Path) -> None:
    """Remove an empty folder whose process was killed before it was marked."""
    found = list(folder.iterdir())
    is_bare = all(path.name == _MARKER and _MARK.startswith(path.read_bytes()) for path in found)
    if is_bare and time.time() - folder.stat().st_mtime > _NEW:
        for path in found:
            path.unlink()
        folder.rmdir()


def _finish(folder: Path) -> bool:
    """Complete the moves that a killed run has noted; returns whether the folder can go.

    Does not move anything onto files that somebody has changed since.
    """
    if not (folder / _MOVES).exists():
        return True
    moves = _noted(folder)
    if moves is None:
        return False
    left = [(*move, number) for number, move in enumerate(moves) if os.path.lexists(move[0])]
    if not all(_may_move(folder, new, place, state) for new, place, state, _ in left):
        return False
    for new, place, _, number in left:
        place.parent.mkdir(parents=True, exist_ok=True)
        (folder / _OLD).mkdir(exist_ok=True)
        _move(new, place, folder / _OLD / str(number))
    return True


def _may_move(folder: Path, new: Path, place: Path, state: Any) -> bool:
    """Whether a noted move leads out of a folder to beside it, onto the noted state."""
    if new.is_symlink() or place.is_symlink() or _state(place) not in (None, state):
        return False
    is_own = new.parent.resolve().is_relative_to(folder / _FILES)
    return is_own and place.parent.resolve().is_relative_to(folder.parent)


def _noted(folder: Path) -> list[tuple[Path, Path, Any]] | None:
    """The moves that a folder notes; None if the note is damaged or they lead elsewhere."""
    moves = []
    try:
        for new, place, state in json.loads((folder / _MOVES).read_bytes()):
            source, target = (isinstance(name, str) and inside(name) for name in (new, place))
            if not source or not target:
                return None
            moves.append((folder / _FILES / source, folder.parent / target, state))
    except (ValueError, TypeError):
        return None
    return moves
