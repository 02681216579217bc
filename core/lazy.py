# SPDX-License-Identifier: GPL-3.0-or-later
"""Packages whose names are loaded when first used."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any


def load(package: str, modules: Mapping[str, tuple[str, ...]], name: str) -> Any:
    """Find a package's name in its modules: what the package's `__getattr__` does.

    Parameters
    ----------
    package : str
        Its `__name__`.
    modules : mapping
        The names that each module gives to the package.
    name : str
        The name that is asked for.

    Raises
    ------
    AttributeError
        If no module has it.
    """
    for module, names in modules.items():
        if name in names:
            return getattr(import_module(f".{module}", package), name)
    raise AttributeError(f"module {package!r} has no attribute {name!r}")
