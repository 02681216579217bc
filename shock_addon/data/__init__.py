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
    "color_data": ("check_unchanged", "read_colors", "write_colors"),
    "geometry_data": ("Place", "read_geometry", "write_geometry"),
    "image_data": (
        "UNTILED",
        "ImageTarget",
        "add_or_reuse",
        "find_image",
        "overwrite",
        "read_image",
        "restore",
    ),
    "mesh_data": ("Target", "find", "object_mode", "read_targets"),
    "texture_data": ("EVERYWHERE", "TextureTarget", "assign", "read_faces", "read_texture"),
}


def __getattr__(name: str) -> Any:
    return load(__name__, _MODULES, name)
