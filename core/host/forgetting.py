# SPDX-License-Identifier: GPL-3.0-or-later
"""Callbacks that drop cached data when another file is loaded."""

from __future__ import annotations

from collections.abc import Callable

_functions: list[Callable[[], None]] = []


def with_file(function: Callable[[], None]) -> Callable[[], None]:
    """Have a function called whenever the open file is left; use it as a decorator."""
    _functions.append(function)
    return function


def forget_file() -> None:
    """Call them all."""
    for function in _functions:
        function()
