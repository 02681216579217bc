# SPDX-License-Identifier: GPL-3.0-or-later
"""Entries in Blender's own menus."""

from __future__ import annotations

import bpy

from .panels import draw_sharpen_geometry

_MENUS = ("VIEW3D_MT_object", "VIEW3D_MT_edit_mesh", "VIEW3D_MT_sculpt")


def draw_entry(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    """Draw the entry, with the panel's settings."""
    layout = self.layout
    layout.separator()
    layout.operator_context = "INVOKE_DEFAULT"
    draw_sharpen_geometry(layout, context)


def register() -> None:
    """Append the entry to the menus."""
    for name in _MENUS:
        getattr(bpy.types, name).append(draw_entry)


def unregister() -> None:
    """Remove it."""
    for name in _MENUS:
        getattr(bpy.types, name).remove(draw_entry)
