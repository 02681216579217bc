# SPDX-License-Identifier: GPL-3.0-or-later
"""Entries in Blender's own menus."""

from __future__ import annotations

from collections.abc import Callable

import bpy

from .panels import draw_dilate, draw_sharpen

_MODES = {
    "VIEW3D_MT_object": ("denoise", "geometry", "colors", "texture"),
    "VIEW3D_MT_edit_mesh": ("denoise", "geometry"),
    "VIEW3D_MT_sculpt": ("denoise", "geometry"),
    "VIEW3D_MT_paint_vertex": ("denoise", "colors"),
    "IMAGE_MT_image": ("denoise_image", "image", "texture"),
}

_TARGETS = {
    "VIEW3D_MT_edit_mesh": "geometry",
    "VIEW3D_MT_sculpt": "geometry",
    "VIEW3D_MT_paint_vertex": "colors",
}
"""What is denoised from the menus of modes that work on one thing only."""


def _entries(
    menu: str, modes: tuple[str, ...]
) -> Callable[[bpy.types.Menu, bpy.types.Context], None]:
    def draw_entries(self: bpy.types.Menu, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.separator()
        layout.operator_context = "INVOKE_DEFAULT"
        for mode in modes:
            operator = draw_sharpen(layout, context, mode)
            if mode == "denoise" and menu in _TARGETS:
                operator.target = _TARGETS[menu]
        if "texture" in modes:
            draw_dilate(layout, context)

    return draw_entries


class SHOCK_FILTER_MT_texture_paint(bpy.types.Menu):
    """The filters of textures: Texture Paint Mode has no menu that they could be added to"""

    bl_label = "Shock Filter"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw buttons with the panel's settings."""
        self.layout.operator_context = "INVOKE_DEFAULT"
        draw_sharpen(self.layout, context, "texture")
        draw_dilate(self.layout, context)


def _draw_in_header(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    if context.mode == "PAINT_TEXTURE":
        self.layout.menu(SHOCK_FILTER_MT_texture_paint.__name__)


ENTRIES = {menu: _entries(menu, modes) for menu, modes in _MODES.items()}
ENTRIES["VIEW3D_MT_editor_menus"] = _draw_in_header
"""What is drawn at the end of each menu: buttons with the panel's settings."""

CLASSES = (SHOCK_FILTER_MT_texture_paint,)


def register() -> None:
    """Append the entries to the menus."""
    for name, draw in ENTRIES.items():
        getattr(bpy.types, name).append(draw)


def unregister() -> None:
    """Remove them."""
    for name, draw in ENTRIES.items():
        getattr(bpy.types, name).remove(draw)
