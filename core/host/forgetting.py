# SPDX-License-Identifier: GPL-3.0-or-later
"""Callbacks that drop cached data when another file is loaded."""

from __future__ import annotations

from collections.abc import Callable

_functions: list[Callable[[], None]] = []


def with_file(function: Callable[[], None]) -> Callable[[], None]:
    """Register a function to call whenever the open file is closed; use it as a decorator."""
    _functions.append(function)
    return function


def forget_file() -> None:
    """Call all registered functions."""
    for function in _functions:
        function()
