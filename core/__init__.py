# SPDX-License-Identifier: GPL-3.0-or-later
"""Shock filters on meshes and images: arrays in, arrays out.

The public names come from the table in :mod:`.registry`. They are loaded when first used, so that
importing this package (Blender does when the extension is enabled) needs neither numba nor scipy.
Editors and type checkers read them in ``__init__.pyi``, which ``tools/write_stub.py`` writes.

References
----------
F. Prada, M. Kazhdan: Unconditionally Stable Shock Filters for Image and Geometry Processing,
2015.
"""

from importlib import import_module as _import_module
from typing import Any as _Any

from . import registry as _registry

__all__ = sorted(_registry.public_names())


def __getattr__(name: str) -> _Any:
    module = _registry.public_names().get(name)
    if module is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(_import_module(f".{module}", __name__), name)


def __dir__() -> list[str]:
    return __all__
