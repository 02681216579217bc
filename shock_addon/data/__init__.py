# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading and writing of Blender's data, which no other room does. May use `core.host`.

Modules are imported when first used, as ``data.NAME``, so that enabling the extension does not
import numpy.
"""

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, Any

PICTURES = ("image_2", "image_3", "image_4")
"""Properties that name further pictures of the same surface."""

LIVE_STAMP = "shock_filter_live"
"""Key of the version in the node group of live results, and of how they were made in meshes."""

LIVE_COLORS = "shock_filter_live_colors"
"""The same for live colors."""

LIVE_TEXTURE = "shock_filter_live_texture"
"""Key of the version in the node group of live textures, and of how they were made in nodes."""

LIVE_RESULT_OF = "shock_filter_live_result_of"
"""Key of the name of the mixing node among the properties of the node with its result."""

LIVE_SOURCE = "shock_filter_source"
"""Key of the source of a live copy among the properties of the object."""

LIVE_AUTO = "shock_filter_auto"
"""Key of the switch Auto Update among the properties of a live copy."""

MOVE = "shock_move"
"""The attribute with the movement of live results."""

DIFFERENCE = "shock_color"
"""The attribute with what live results add to colors, in linear light."""

if TYPE_CHECKING:
    from . import (  # noqa: F401
        arrays,
        chosen,
        image,
        lengths,
        live,
        materials,
        mesh,
        mixes,
        replaced,
        shown,
        skipped,
        strokes,
        views,
    )


def importing(package: str) -> Callable[[str], Any]:
    """Make a ``__getattr__`` for a package that imports its modules on first use."""

    def load(name: str) -> Any:
        try:
            return import_module(f".{name}", package)
        except ModuleNotFoundError as error:
            if error.name != f"{package}.{name}":
                raise
            raise AttributeError(f"module {package!r} has no attribute {name!r}") from None

    return load


__getattr__ = importing(__name__)
