# SPDX-License-Identifier: GPL-3.0-or-later
"""What harvest.py writes: the kernels that Python called, and their first calls."""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass
class Entry:
    """A kernel for some types.

    Attributes
    ----------
    name, types : str
        As in the table; see `core.base.compiled`.
    result : str, list of str or None
        What it returns: letters of `struct`, or an array's type.
    symbol : str
        The function's name in the IR.
    modules : list of str
        The IR of the kernel and of all that it calls.
    """

    name: str
    types: str
    result: str | list[str] | None
    symbol: str
    modules: list[str]


@dataclass
class Call:
    """A call: its arguments before and after, and its result."""

    name: str
    before: tuple[Any, ...]
    after: tuple[Any, ...]
    result: Any


def write(path: Path, entries: list[Entry], calls: list[Call]) -> None:
    """Write a harvest."""
    with path.open("wb") as file:
        pickle.dump((entries, calls), file)


def read(path: Path) -> tuple[list[Entry], list[Call]]:
    """Read a harvest."""
    with path.open("rb") as file:
        return pickle.load(file)
