# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors about files that cannot be read or written.

Needs no numerics, like :mod:`.output`.
"""

from __future__ import annotations

import contextlib
import errno
import importlib
import logging
import struct
import sys
import tokenize
import traceback
import zlib
from collections.abc import Collection, Iterator
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from ..errors import ShockError

_DAMAGE = (
    ArithmeticError, EOFError, OSError, ValueError, struct.error, tokenize.TokenError, zlib.error,
)  # fmt: skip
"""What any reader may raise because of a file's contents, Shock Filter's own readers too."""

_FREE, _RATIO = 1 << 28, 2000
"""Bytes that any header may claim, and those it may claim per byte of the file: twice the best
ratio that compression of images reaches on one color."""

_any_size: ContextVar[bool] = ContextVar("any_size", default=False)

_NO_READERS = {__name__.partition(".")[0], "numpy", *sys.stdlib_module_names}
"""Packages that read no files for us, or raise no other errors than those above."""


def check_file(path: Path) -> None:
    """Refuse a file that does not exist."""
    if path.is_dir():
        raise ShockError(f"{path} is a folder; name the files in it.")
    if not path.exists():
        raise ShockError(f"There is no file {path}; check its name and folder.")


def check_ending(
    path: Path, known: Collection[str], reason: str = "cannot handle this ending"
) -> None:
    """Refuse a file whose ending says that it is of another kind."""
    if path.suffix.lower() not in known:
        raise ShockError(f"{path}: {reason}; use one of {', '.join(known)}.")


def check_source(path: Path, known: Collection[str]) -> None:
    """Refuse files that cannot be read."""
    check_file(path)
    check_ending(path, known)
    if not path.stat().st_size:
        raise ShockError(f"{path} is empty; copy or save it again.")


def check_target(path: Path, known: Collection[str]) -> None:
    """Refuse a file that cannot be written, or whose folder does not exist."""
    check_ending(path, known)
    if not path.absolute().parent.is_dir():
        raise ShockError(f"There is no folder {path.parent}; make it first.")


def needed(package: str, path: Path, extra: str = "files") -> Any:
    """Import a package that a format needs, or name the command that installs it."""
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise ShockError(
            f"{path}: this needs {package}; run: pip install 'shock-filter[{extra}]'."
        ) from error


def check_claim(path: Path, claimed: float, stored: int | None = None) -> None:
    """Refuse a file whose header claims far more bytes than it can hold, before allocating them.

    `stored` are the bytes of a folder, or of the part of the file that holds the data.
    """
    size = path.stat().st_size if stored is None else stored
    if claimed > max(_FREE, _RATIO * size) and not _any_size.get():
        where = "in a file of" if stored is None else "in"
        raise ShockError(
            f"{path} claims to hold {claimed / 2**30:.1f} GiB {where} {size} bytes; is it damaged?"
            " If not, add --any-size."
        )


@contextlib.contextmanager
def _claims_lifted(any_size: bool) -> Iterator[None]:
    token = _any_size.set(any_size)
    try:
        yield
    finally:
        _any_size.reset(token)


@contextlib.contextmanager
def reading_back(path: Path) -> Iterator[None]:
    """Refuse a file that was just written if it cannot be read, or differs.

    Raises
    ------
    ShockError
        In place of whatever a reader raises.
    """
    try:
        with _claims_lifted(True):
            yield
    except Exception as error:
        reason = str(error) or type(error).__name__
        raise ShockError(
            f"{path.name} was not written: it could not be read back ({reason}). Write another"
            " format, and report this, since Shock Filter should have known."
        ) from error


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Convert whatever another package raises while it writes a file to an error that says so.

    If it is rather a mistake in Shock Filter's own code, the traceback is logged.

    Raises
    ------
    ShockError
        In place of it. Shock Filter's own errors and those of the system pass.
    """
    try:
        yield
    except (ShockError, OSError):
        raise
    except Exception as error:  # packages have errors of their own, without a common base
        _log_own_mistake(error, f"The writer of {path}")
        reason = str(error) or type(error).__name__
        raise ShockError(
            f"{path.name} was not written: what is in the input cannot be put into it ({reason})."
            " Write another format, or the input's own."
        ) from error


@contextlib.contextmanager
def reading(path: Path, any_size: bool = False) -> Iterator[None]:
    """Convert whatever a reader raises to an error that says that the file may be damaged.

    If it is rather a mistake in Shock Filter's own code, the traceback is logged. `any_size`
    disables the limit of `check_claim`.

    Raises
    ------
    ShockError
        In place of it. Shock Filter's own errors and those of the system pass.
    """
    try:
        with _claims_lifted(any_size):
            yield
    except ShockError:
        raise
    except ImportError as error:
        raise ShockError(
            f"{path}: this needs {error.name}; run: pip install {error.name}"
        ) from error
    except MemoryError as error:
        raise ShockError(f"{path} needs more memory than there is ({error}); free some.") from error
    except Exception as error:
        number = getattr(error, "errno", None) or -1
        if number > 0 and number != errno.EINVAL:  # EINVAL: a place that no file can have
            raise  # the system's: no such file, no permission; those of NetCDF are negative
        _log_own_mistake(error, f"The reader of {path}")
        reason = str(error) or type(error).__name__
        raise ShockError(f"{path} cannot be read; is it damaged? ({reason})") from error


def _log_own_mistake(error: Exception, what: str) -> None:
    if not isinstance(error, _DAMAGE) and not _is_of_another_reader(error):
        logging.getLogger(__name__).error("%s failed.", what, exc_info=error)


def _is_of_another_reader(error: Exception) -> bool:
    # Other packages raise anything at damaged files: TypeError, UnboundLocalError, ...
    frames = traceback.walk_tb(error.__traceback__)
    packages = {frame.f_globals.get("__name__", "").partition(".")[0] for frame, _ in frames}
    return not packages <= _NO_READERS
