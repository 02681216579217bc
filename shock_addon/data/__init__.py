# SPDX-License-Identifier: GPL-3.0-or-later
"""Between Blender's data and arrays: meshes, shape keys, masks, colors, images.

The names below are for the rest of the add-on. They are loaded when first used, so that enabling
the extension does not import numpy.
"""

from typing import Any

from ...core.lazy import load

_MODULES = {
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
    return load(__name__, _MODULES, name)
