# SPDX-License-Identifier: GPL-3.0-or-later
"""The menu of filters, and where it stands among Blender's own."""

from __future__ import annotations

import bpy

from .panels import draw_dilate, draw_sharpen

_MODES = {
    "OBJECT": ("denoise", "geometry", "colors", "texture"),
    "EDIT_MESH": ("denoise", "geometry"),
    "SCULPT": ("denoise", "geometry"),
    "PAINT_VERTEX": ("denoise", "colors"),
    "PAINT_TEXTURE": ("texture",),
}
_IMAGE_MODES = ("denoise_image", "image", "texture")

_TARGETS = {"EDIT_MESH": "geometry", "SCULPT": "geometry", "PAINT_VERTEX": "colors"}
"""What is denoised in modes that work on one thing only."""

_PLACES = (
    "VIEW3D_MT_object",
    "VIEW3D_MT_edit_mesh",
    "VIEW3D_MT_sculpt",
    "VIEW3D_MT_paint_vertex",
    "IMAGE_MT_image",
)


class SHOCK_FILTER_MT_filters(bpy.types.Menu):
    """The filters of the current mode, with the panel's settings"""

    bl_label = "Shock Filter"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw a button for each."""
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        in_image_editor = context.space_data.type == "IMAGE_EDITOR"
        modes = _IMAGE_MODES if in_image_editor else _MODES.get(context.mode, ())
        for mode in modes:
            operator = draw_sharpen(layout, context, mode)
            if mode == "denoise" and context.mode in _TARGETS:
                operator.target = _TARGETS[context.mode]
        if "texture" in modes:
            draw_dilate(layout, context)


def _draw_at_end(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    self.layout.separator()
    self.layout.menu(SHOCK_FILTER_MT_filters.__name__)


def _draw_in_header(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    # Texture Paint Mode has no menu that this one could be added to.
    if context.mode == "PAINT_TEXTURE":
        self.layout.menu(SHOCK_FILTER_MT_filters.__name__)


ENTRIES = dict.fromkeys(_PLACES, _draw_at_end) | {"VIEW3D_MT_editor_menus": _draw_in_header}
"""What is drawn at the end of each of Blender's menus."""

CLASSES = (SHOCK_FILTER_MT_filters,)


def register() -> None:
    """Append the menu to Blender's."""
    for name, draw in ENTRIES.items():
        getattr(bpy.types, name).append(draw)


def unregister() -> None:
    """Remove it."""
    for name, draw in ENTRIES.items():
        getattr(bpy.types, name).remove(draw)
