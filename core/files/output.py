# SPDX-License-Identifier: GPL-3.0-or-later
"""Output files that appear complete or not at all, and the outcome that is reported.

Needs no numerics, since Blender's command line chooses the folder of kernels before they load.
"""

from __future__ import annotations

import contextlib
import errno
import filecmp
import os
import shutil
import tempfile
from collections.abc import Callable, Collection, Iterator, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path

from ..base.progress import ProgressCallback
from ..errors import Cancelled, ShockError
from .staging import Move, move_all, temporary_folder


@dataclass(frozen=True)
class Options:
    """The options of a run besides the names of files.

    Attributes
    ----------
    mask : str, optional
        For meshes: a vertex property of PLY files, where 0 leaves a vertex as it is and 1 changes
        it fully; whole numbers are divided by their type's largest value. For images: a gray image
        file of the same size, where black stays and white is filtered fully.
    invert_mask : bool
        Use one minus the mask.
    guide : str, optional
        An image file of the same size whose flow moves the values of images and textures.
    gain_map : str, optional
        A gray image file of the same size that says where detail is raised and where it is
        smoothed; see `texture.painted_gain.gains_of`.
    gain : float
        The gain of white in it.
    others : sequence of str
        Further image files, if one image is made of several.
    material : str, optional
        Name of the material that shows the texture; if left out, all faces do.
    overwrite : bool
        Replace files that exist.
    any_size : bool
        Also read files whose header claims far more data than their size can hold.
    progress : callable, optional
        Called with (fraction, message); returns False to cancel.
    """

    mask: str | Path | None = None
    invert_mask: bool = False
    guide: str | Path | None = None
    gain_map: str | Path | None = None
    gain: float = 1.0
    others: Sequence[str | Path] = ()
    material: str | None = None
    overwrite: bool = False
    any_size: bool = False
    progress: ProgressCallback | None = None


DEFAULTS = Options()


@dataclass(frozen=True)
class Outcome:
    """The result of filtering a file.

    Attributes
    ----------
    total, changed : int
        Number of vertices or pixels, and of those that changed.
    notes : tuple of str
        What a person should know: what was lost, what was recomputed.
    done : str
        Sentence with placeholders for both numbers.
    """

    total: int
    changed: int
    notes: tuple[str, ...] = ()
    done: str = "moved {changed} of {total} vertices"

    def __str__(self) -> str:
        """Return the sentence."""
        return self.done.format(changed=self.changed, total=self.total)


class Unfinished(Cancelled):
    """A run was cancelled after some of its files were complete; these stay."""

    def __init__(self, done: int, count: int, folder: Path) -> None:
        super().__init__(
            "Interrupted; {done} of {count} frames are in {folder}.",
            done=done,
            count=count,
            folder=folder,
        )


Announce = Callable[[Path], None]
Guard = Callable[[Path], contextlib.AbstractContextManager[Announce]]
"""Opened for a place that will be taken; yields a function to call with the new file."""


@contextlib.contextmanager
def _unguarded(_place: Path) -> Iterator[Announce]:
    yield lambda _new: None


_guard: ContextVar[Guard] = ContextVar("guard", default=_unguarded)


@contextlib.contextmanager
def guarded(guard: Guard) -> Iterator[None]:
    """Announce the outputs of this thread to a guard before they are moved to their places."""
    token = _guard.set(guard)
    try:
        yield
    finally:
        _guard.reset(token)


def taking(place: Path) -> contextlib.AbstractContextManager[Announce]:
    """Announce to the current guard that a place will be taken."""
    return _guard.get()(place)


@contextlib.contextmanager
def staged(target: Path, overwrite: bool, own: Collection[str] = ()) -> Iterator[Path]:
    """Yield a path to write to, and move the file written there to `target` at the end.

    Files written beside it (materials, textures) are moved, too. They do not replace an existing,
    different file unless it is named in `own` or its name begins with the target's name and a dot:
    files under other names may belong to another file.

    If anything fails, or the disk is full, nothing is left of it and nothing is changed. If the
    process is killed, `target` is unchanged, or a later run completes the moves.

    Files that are replaced pass on their permissions. If `target` is a link, the file it points to
    is replaced or made, and the other files are written beside that one.
    """
    real = real_place(target)
    check_plain(real)
    check_writable(real.parent)
    is_alike = real.suffix.lower() == target.suffix.lower()
    name = real.name if is_alike else target.name  # its ending selects the format
    with contextlib.ExitStack() as stack:
        folder = temporary_folder(real.parent, stack)
        stage = folder / name
        with room(real.parent):
            yield stage
        if stage.is_symlink() or not stage.is_file():
            raise ShockError(f"{target} was not written; choose another name or folder.")
        moves = [*_side_moves(folder, stage, real), (stage, real)]
        with taking(target) as announce:
            moves = [move for move in moves if move[0] == stage or not is_same(*move)]
            for new, place in moves:
                _check_free(new.relative_to(folder).as_posix(), new == stage, place, name, own)
                if place.exists() and not overwrite:
                    raise _exists(target if new == stage else place)
            announce(stage)
            for new, place in moves:
                if place.exists():
                    shutil.copymode(place, new)
            move_all(moves)


@contextlib.contextmanager
def staged_folder(target: Path, overwrite: bool) -> Iterator[Path]:
    """Yield a folder to make and fill, which becomes `target` at the end; see `staged`.

    An existing folder is replaced as a whole if `overwrite` is set.
    """
    real = real_place(target)
    if not real.is_dir():
        check_plain(real)
    check_writable(real.parent)
    with contextlib.ExitStack() as stack:
        stage = temporary_folder(real.parent, stack) / target.name
        with room(real.parent):
            yield stage
        with taking(target) as announce:
            if real.exists() and not overwrite:
                raise _exists(target)
            announce(stage)
            move_all([(stage, real)])


def real_place(target: Path) -> Path:
    """The path that a name is written to: the target of a link, otherwise itself."""
    real = Path(os.path.realpath(target))
    if target.is_symlink() and (real.is_symlink() or not real.parent.is_dir()):
        raise ShockError(f"{target} is a link to {real}, where no file can be; remove the link.")
    return real


def check_plain(place: Path) -> None:
    """Refuse to put a file where something else than a file exists."""
    if place.is_dir():
        raise ShockError(f"{place} is a folder; name a file.")
    if place.exists() and not place.is_file():
        raise ShockError(f"{place} is a pipe or a device, and no plain file; name another output.")


def make_folder(folder: Path) -> None:
    """Make a folder unless it is there, and refuse one in which no file can be made."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = error.strerror or str(error)
        raise ShockError(
            f"Cannot make the folder {folder} ({reason}); choose another output."
        ) from error
    check_writable(folder)


def check_writable(folder: Path) -> None:
    """Refuse a folder in which no file can be made."""
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ShockError(f"Cannot write to the folder {folder}; choose another output.")


def check_free(place: Path, overwrite: bool) -> None:
    """Refuse a file that exists unless it may be replaced, before anything is computed."""
    if place.exists() and not overwrite:
        raise _exists(place)


def _exists(place: Path) -> ShockError:
    return ShockError(f"{place} exists already; add --overwrite or choose another output.")


def _side_moves(folder: Path, stage: Path, real: Path) -> list[Move]:
    """The files beside the one being written, and their places without links."""
    moves: list[Move] = []
    parent, taken = real.parent, {real}
    for path in sorted(folder.rglob("*")):
        if path.is_symlink() or not (path.is_dir() or path.is_file()):
            raise ShockError(f"{path.name} is no plain file, and was not written.")
        if path == stage or path.is_dir():
            continue
        named = parent / path.relative_to(folder)
        place = Path(os.path.realpath(named))
        if not place.is_relative_to(parent) and not is_same(path, place):
            raise ShockError(
                f"{named} is a link, or behind one, to another folder; remove the link, or write"
                " to another folder."
            )
        if place in taken:
            raise ShockError(f"Two files would be written to {place}; choose another output.")
        taken.add(place)
        moves.append((path, place))
    return moves


def _check_free(name: str, is_main: bool, place: Path, main: str, own: Collection[str]) -> None:
    """Refuse to replace a file that belongs to another one."""
    if is_main or not place.exists() or name in own or name.startswith(f"{main}."):
        return
    raise ShockError(
        f"{place} exists already and may belong to another file than {main}; write to another"
        " folder."
    )


def is_same(new: Path, old: Path) -> bool:
    """Whether a file has the contents of another one already."""
    return old.is_file() and filecmp.cmp(new, old, shallow=False)


# --------------------------------------------------------------------------------------- full disks

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_PROBE = 1 << 16  # bytes


@contextlib.contextmanager
def room(folder: Path) -> Iterator[None]:
    """Raise an error if the disk of a folder is full while or after something is written.

    Many of Blender's exporters leave half a file on a full disk and report success.
    """
    try:
        yield
    except Cancelled:
        raise
    except (OSError, ShockError) as error:
        if getattr(error, "errno", None) in _FULL:
            raise _full(folder, error) from error
        _check_room(folder)
        raise
    _check_room(folder)


def _check_room(folder: Path) -> None:
    try:
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(os.urandom(_PROBE))  # incompressible
            probe.flush()
            os.fsync(probe.fileno())
    except OSError as error:
        if error.errno in _FULL:
            raise _full(folder, error) from error


def _full(folder: Path, error: Exception) -> ShockError:
    return ShockError(
        f"The disk of {folder} is full ({error}); make room or choose another output."
    )
