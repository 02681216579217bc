# SPDX-License-Identifier: GPL-3.0-or-later
"""The face in Blender: properties, operators, panels and menus over the core."""

from __future__ import annotations

import bpy

from . import (
    colors_operator,
    command_line,
    denoise_operator,
    geometry_operator,
    image_data,
    image_operator,
    jobs,
    kernels,
    menus,
    panels,
    presets,
    properties,
    texture_operator,
)

_CLASSES = (
    *denoise_operator.CLASSES,
    *geometry_operator.CLASSES,
    *colors_operator.CLASSES,
    *image_operator.CLASSES,
    *texture_operator.CLASSES,
    *presets.CLASSES,
    *panels.CLASSES,
)


def register() -> None:
    """Add everything to Blender."""
    properties.register()
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    menus.register()
    command_line.register()


def unregister() -> None:
    """Stop what is running and remove everything again, in reverse order."""
    jobs.stop_all()
    command_line.unregister()
    menus.unregister()
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
    properties.unregister()
    image_data.forget()
    kernels.forget()
