# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's data in and out: the only folder that reads or writes it.

Modules are imported when first used, as ``data.NAME``, so that enabling the extension does not
import numpy.
"""

from importlib import import_module
from typing import Any

_OLD = {  # transition: names that are asked for without their module
    "active_object": ("read_active",),
    "chosen": (
        "CONVERTIBLE",
        "chosen_image",
        "edited_image",
        "mesh_objects",
        "mesh_refusal",
        "refusal",
        "shown_image",
    ),
    "colors": ("check_unchanged", "read_colors", "write_colors"),
    "geometry": ("Place", "read_geometry", "write_geometry"),
    "images": (
        "UNTILED",
        "ImageTarget",
        "add_or_reuse",
        "find_image",
        "overwrite",
        "read_image",
        "restore",
    ),
    "meshes": ("Target", "find", "object_mode", "read_targets"),
    "textures": ("EVERYWHERE", "TextureTarget", "assign", "read_faces", "read_texture"),
}


def __getattr__(name: str) -> Any:
    for module, names in _OLD.items():
        if name in names:
            return getattr(import_module(f".{module}", __name__), name)
    try:
        return import_module(f".{name}", __name__)
    except ModuleNotFoundError as error:
        if error.name != f"{__name__}.{name}":
            raise
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}") from None
