# SPDX-License-Identifier: GPL-3.0-or-later
"""What to say of files that cannot be read.

Needs no numerics, as :mod:`.output`.
"""

from __future__ import annotations

import contextlib
import struct
import tokenize
import zlib
from collections.abc import Iterator
from pathlib import Path

from ..errors import ShockError

_DAMAGED = (
    ArithmeticError, AssertionError, AttributeError, EOFError, LookupError, MemoryError, NameError,
    RuntimeError, StopIteration, SyntaxError, TypeError, ValueError, struct.error, zlib.error,
    tokenize.TokenError,
)  # fmt: skip
"""What readers raise at files that are not as they should be, those of other packages too."""


def check_file(path: Path) -> None:
    """Refuse a file that is not there."""
    if path.is_dir():
        raise ShockError(f"{path} is a folder; name the files in it.")
    if not path.exists():
        raise ShockError(f"There is no file {path}; check its name and folder.")


@contextlib.contextmanager
def reading(path: Path) -> Iterator[None]:
    """Say of whatever a reader raises that the file may be damaged.

    Raises
    ------
    ShockError
        Instead. Shock Filter's own errors and those of the system pass.
    """
    try:
        yield
    except ShockError:
        raise
    except (OSError, *_DAMAGED) as error:
        if getattr(error, "errno", None) is not None:
            raise  # the system's: no such file, no right to read it
        reason = str(error) or type(error).__name__
        raise ShockError(f"{path} cannot be read; is it damaged? ({reason})") from error
