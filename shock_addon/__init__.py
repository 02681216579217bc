# SPDX-License-Identifier: GPL-3.0-or-later
"""The face in Blender: properties, operators, panels and menus over the core."""

from __future__ import annotations

import bpy

from . import command_line, jobs, kernels, menus, operators, panels, presets, properties

_CLASSES = (*operators.CLASSES, *presets.CLASSES, *panels.CLASSES)


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
    kernels.forget()
