# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's data in and out: the only folder that reads or writes it.

Modules are imported when first used, as ``data.NAME``, so that enabling the extension does not
import numpy.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from . import (
        active_object,
        arrays,
        chosen,
        colors,
        custom_normals,
        edge_marks,
        flow,
        geometry,
        images,
        masks,
        materials,
        meshes,
        original,
        shape_keys,
        skipped,
        textures,
        tiles,
        unchanged,
        vertex_groups,
    )

__all__ = [
    "active_object",
    "arrays",
    "chosen",
    "colors",
    "custom_normals",
    "edge_marks",
    "flow",
    "geometry",
    "images",
    "masks",
    "materials",
    "meshes",
    "original",
    "shape_keys",
    "skipped",
    "textures",
    "tiles",
    "unchanged",
    "vertex_groups",
]

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
    for module, names in _OLD.items():  # transition
        if name in names:  # transition
            return getattr(import_module(f".{module}", __name__), name)  # transition
    if name in __all__:
        return import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
