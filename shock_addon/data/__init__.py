# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's data in and out: the only folder that reads or writes it.

Modules are imported when first used, as ``data.NAME``, so that enabling the extension does not
import numpy.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from . import (  # noqa: F401
        arrays,
        chosen,
        colors,
        fields,
        flow,
        flows,
        geometry,
        images,
        maps,
        masks,
        materials,
        meshes,
        original,
        painted,
        replaced,
        sequences,
        shading,
        shape_keys,
        shown,
        skipped,
        stand_in,
        textures,
        tiles,
        vertex_groups,
        visible,
    )


def __getattr__(name: str) -> Any:
    try:
        return import_module(f".{name}", __name__)
    except ModuleNotFoundError as error:
        if error.name != f"{__name__}.{name}":
            raise
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}") from None
