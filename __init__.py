# SPDX-License-Identifier: GPL-3.0-or-later
"""Shock Filter: sharpening of geometry, colors and images by advection along flow-lines.

Blender finds its entry here (``register`` and ``unregister``); Python finds the package:
``from shock_filter import core``. Importing this file needs neither bpy, numba nor scipy.
"""

import re
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

_MANIFEST = Path(__file__).with_name("blender_manifest.toml").read_text(encoding="utf-8")
__version__ = re.findall(r'^version = "(.+)"$', _MANIFEST, re.MULTILINE)[0]


def register() -> None:
    """Add the operators, panels and menus to Blender."""
    from . import shock_addon

    shock_addon.register()


def unregister() -> None:
    """Remove from Blender all that :func:`register` added."""
    from . import shock_addon

    shock_addon.unregister()


if not TYPE_CHECKING:

    def __getattr__(name: str) -> ModuleType:
        """Import what scripts in Blender use: ``shock_filter.live.update(obj)``."""
        if name != "live":
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return import_module(".shock_addon.live", __name__)
