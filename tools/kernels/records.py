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


@dataclass
class Harvest:
    """What a rehearsal compiled.

    Attributes
    ----------
    entries : list of Entry
        Kernels that Python called, for each combination of types.
    calls : list of Call
        Their first calls.
    imported, compiled : set of str
        Names of all kernels of the modules that were imported, and of those that were compiled.
    """

    entries: list[Entry]
    calls: list[Call]
    imported: set[str]
    compiled: set[str]


def write(path: Path, harvest: Harvest) -> None:
    """Write a harvest."""
    with path.open("wb") as file:
        pickle.dump(harvest, file)


def read(path: Path) -> Harvest:
    """Read a harvest."""
    with path.open("rb") as file:
        return pickle.load(file)
