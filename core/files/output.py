# SPDX-License-Identifier: GPL-3.0-or-later
"""Output files that appear complete or not at all, and what to say about them.

Needs no numerics, since Blender's command line chooses where kernels are kept before they load.
"""

from __future__ import annotations

import contextlib
import errno
import filecmp
import functools
import os
import shutil
import tempfile
import time
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..base.progress import ProgressCallback
from ..errors import Cancelled, ShockError


@dataclass(frozen=True)
class Options:
    """What is asked beside the files' names.

    Attributes
    ----------
    mask : str, optional
        Of meshes: a vertex property of PLY files, where 0 leaves a vertex as it is and 1 changes
        it fully; whole numbers count in parts of their type's largest value. Of images: a gray
        image file of the same size, where black stays and white is filtered fully.
    invert_mask : bool
        Use one minus the mask.
    guide : str, optional
        An image file of the same size whose flow moves the values of images and textures.
    gain_map : str, optional
        A gray image file of the same size that says where detail is raised and where it is
        smoothed; see `filters.painted_gain.gains_of`.
    gain : float
        What white stands for there.
    others : sequence of str
        Image files like the first one, where one image is made of several.
    material : str, optional
        Name of the material that shows a texture; all faces do if left out.
    overwrite : bool
        Replace files that exist.
    any_size : bool
        Read files whose header claims far more than their size can hold, too.
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
_PREFIX = ".shock-filter-"
_NEW = 10.0  # seconds; what is younger may be about to be held


@dataclass(frozen=True)
class Outcome:
    """What was done with a file.

    Attributes
    ----------
    total, changed : int
        Number of vertices or pixels, and of those that are not as they were.
    notes : tuple of str
        What a person should know: what did not survive, what was computed anew.
    done : str
        Says what was done, with places for both numbers.
    """

    total: int
    changed: int
    notes: tuple[str, ...] = ()
    done: str = "moved {changed} of {total} vertices"

    def __str__(self) -> str:
        """Say what was done."""
        return self.done.format(changed=self.changed, total=self.total)


class Unfinished(Cancelled):
    """A run was cancelled after some of its files were complete, and these stay."""

    def __init__(self, done: int, count: int, folder: Path) -> None:
        super().__init__(
            "Interrupted; {done} of {count} frames are in {folder}.",
            done=done,
            count=count,
            folder=folder,
        )


@contextlib.contextmanager
def staged(target: Path, overwrite: bool, own: Collection[str] = ()) -> Iterator[Path]:
    """Give a path to write to, and move what was written there to `target` at the end.

    Files written beside it (materials, textures) come along. They replace none that is there
    already and differs, unless that is named in `own` or begins with the target's name and a dot:
    what stands in a folder under another name may belong to another file.

    If writing fails, or the disk is full after it, nothing of it is left and all is as it was. At
    the end files are moved one by one, the file itself last: if the system refuses that for one of
    them, those before it are new, but none is half a file, and `target` is as it was.

    Files that are replaced pass on their permissions; where they are links, what these point to is
    replaced or made.
    """
    target = target.absolute()
    if not os.access(target.parent, os.W_OK | os.X_OK):
        raise ShockError(f"Cannot write to the folder {target.parent}; choose another output.")
    with contextlib.ExitStack() as stack:
        folder = temporary_folder(target.parent, stack)
        stage = folder / target.name
        with room(target.parent):
            yield stage
        if not stage.is_file():
            raise ShockError(f"{target} was not written; choose another name or folder.")
        written = sorted(path for path in folder.rglob("*") if path.is_file())
        written.sort(key=stage.__eq__)  # the file itself comes last
        pairs = [(path, target.parent / path.relative_to(folder)) for path in written]
        pairs = [(new, old) for new, old in pairs if new == stage or not _same(new, old)]
        for new, old in pairs:
            name = new.relative_to(folder).as_posix()
            if not old.exists():
                continue
            if new != stage and name not in own and not name.startswith(f"{target.name}."):
                raise ShockError(
                    f"{old} exists already and may belong to another file than {target.name};"
                    " write to another folder."
                )
            if not overwrite:
                raise ShockError(f"{old} exists already; add --overwrite or choose another output.")
        pairs = [_fitted(new, old, stack) for new, old in pairs]
        for _, old in pairs:
            old.parent.mkdir(parents=True, exist_ok=True)
        for new, old in pairs:
            os.replace(new, old)


@contextlib.contextmanager
def staged_folder(target: Path, overwrite: bool) -> Iterator[Path]:
    """Give a folder to make and fill, which becomes `target` at the end; as `staged` for files.

    What was there is replaced as a whole, if `overwrite` says so.
    """
    target = Path(os.path.realpath(target))
    if not os.access(target.parent, os.W_OK | os.X_OK):
        raise ShockError(f"Cannot write to the folder {target.parent}; choose another output.")
    with contextlib.ExitStack() as stack:
        folder = temporary_folder(target.parent, stack)
        stage, replaced = folder / target.name, folder / "replaced"
        with room(target.parent):
            yield stage
        if target.exists():
            if not overwrite:
                raise ShockError(
                    f"{target} exists already; add --overwrite or choose another output."
                )
            os.replace(target, replaced)
        try:
            os.replace(stage, target)
        except OSError:
            if replaced.exists():
                os.replace(replaced, target)
            raise


def temporary_folder(parent: Path, stack: contextlib.ExitStack) -> Path:
    """Make a folder that goes at the end, or in a later run if this one is killed."""
    _remove_left_over(parent)
    # What workers of a cluster still write there is left to a later run.
    made = tempfile.TemporaryDirectory(prefix=_PREFIX, dir=parent, ignore_cleanup_errors=True)
    folder = Path(stack.enter_context(made))
    stack.enter_context(_held(folder))
    return folder


@functools.cache  # once for each folder, since looking through it takes a while
def _remove_left_over(parent: Path) -> None:
    """Remove what runs that were killed have left in a folder."""
    for folder in parent.glob(f"{_PREFIX}*"):
        with contextlib.suppress(OSError), _held(folder) as is_free:
            if is_free and time.time() - folder.stat().st_mtime > _NEW:
                shutil.rmtree(folder)
                folder.with_name(f"{folder.name}.blend").unlink(missing_ok=True)


@contextlib.contextmanager
def _held(folder: Path) -> Iterator[bool]:
    """Hold a folder as long as this process lives; whether no other process does."""
    try:
        import fcntl
    except ImportError:  # Windows
        yield False
        return
    number = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
            is_free = True
        except OSError:  # held, or on a disk that knows no locks
            is_free = False
        yield is_free
    finally:
        os.close(number)


def _same(new: Path, old: Path) -> bool:
    return old.is_file() and filecmp.cmp(new, old, shallow=False)


def _fitted(new: Path, old: Path, stack: contextlib.ExitStack) -> tuple[Path, Path]:
    """Give a new file the permissions of the old one, and move it to the disk of a link's target.

    Returns both files, the old one without links.
    """
    if old.exists():
        shutil.copymode(old, new)
    if old.is_symlink():
        link, old = old, Path(os.path.realpath(old))
        if old.is_symlink() or not old.parent.is_dir():
            raise ShockError(f"{link} is a link to {old}, where no file can be; remove the link.")
        folder = temporary_folder(old.parent, stack)
        with room(old.parent):
            new = Path(shutil.move(new, folder))
    return new, old


# --------------------------------------------------------------------------------------- full disks

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_PROBE = 1 << 16  # bytes


@contextlib.contextmanager
def room(folder: Path) -> Iterator[None]:
    """Say so if the disk of a folder turns out to be full while or after something is written.

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
            probe.write(os.urandom(_PROBE))  # which no disk stores in less
            probe.flush()
            os.fsync(probe.fileno())
    except OSError as error:
        if error.errno in _FULL:
            raise _full(folder, error) from error


def _full(folder: Path, error: Exception) -> ShockError:
    return ShockError(
        f"The disk of {folder} is full ({error}); make room or choose another output."
    )
