# SPDX-License-Identifier: GPL-3.0-or-later
"""What to say of files that cannot be read.

Needs no numerics, as :mod:`.output`.
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
"""What the contents of a file can make any reader raise, Shock Filter's own ones too."""

_FREE, _RATIO = 1 << 28, 2000
"""Bytes that a header may claim at no charge, and beyond that for each byte of the file: twice
what the best compression of images reaches on one color."""

_any_size: ContextVar[bool] = ContextVar("any_size", default=False)

_NO_READERS = {__name__.partition(".")[0], "numpy", *sys.stdlib_module_names}
"""Packages that read no files for us, or of which the errors above are all that is expected."""


def check_file(path: Path) -> None:
    """Refuse a file that is not there."""
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
    """Refuse what cannot be a file to be read."""
    check_file(path)
    check_ending(path, known)
    if not path.stat().st_size:
        raise ShockError(f"{path} is empty; copy or save it again.")


def check_target(path: Path, known: Collection[str]) -> None:
    """Refuse a file that cannot be written, or whose folder is not there."""
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
    """Refuse a file whose header claims far more bytes than it can hold, before these are taken.

    `stored` are the bytes of a folder, or of a part of the file that stands for all of it.
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
    """Refuse a file that was just written and turns out not to be readable, or another.

    Raises
    ------
    ShockError
        Instead of whatever a reader raises.
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
    """Say of whatever another package raises while it writes a file that it cannot.

    Where it is rather a mistake in Shock Filter's own code, the traceback is logged.

    Raises
    ------
    ShockError
        Instead. Shock Filter's own errors and those of the system pass.
    """
    try:
        yield
    except (ShockError, OSError):
        raise
    except Exception as error:  # packages raise errors of their own, of no common kind
        _log_own_mistake(error, f"The writer of {path}")
        reason = str(error) or type(error).__name__
        raise ShockError(
            f"{path.name} was not written: what is in the input cannot be put into it ({reason})."
            " Write another format, or the input's own."
        ) from error


@contextlib.contextmanager
def reading(path: Path, any_size: bool = False) -> Iterator[None]:
    """Say of whatever a reader raises that the file may be damaged.

    Where it is rather a mistake in Shock Filter's own code, the traceback is logged. `any_size`
    lifts the limit of what headers may claim.

    Raises
    ------
    ShockError
        Instead. Shock Filter's own errors and those of the system pass.
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
        if number > 0 and number != errno.EINVAL:  # which is a place that no file can have
            raise  # the system's: no such file, no right to read it; those of NetCDF are negative
        _log_own_mistake(error, f"The reader of {path}")
        reason = str(error) or type(error).__name__
        raise ShockError(f"{path} cannot be read; is it damaged? ({reason})") from error


def _log_own_mistake(error: Exception, what: str) -> None:
    if not isinstance(error, _DAMAGE) and not _is_of_another_reader(error):
        logging.getLogger(__name__).error("%s failed.", what, exc_info=error)


def _is_of_another_reader(error: Exception) -> bool:
    # Other packages raise whatever comes at damaged files: TypeError, UnboundLocalError, ...
    frames = traceback.walk_tb(error.__traceback__)
    packages = {frame.f_globals.get("__name__", "").partition(".")[0] for frame, _ in frames}
    return not packages <= _NO_READERS
