# SPDX-License-Identifier: GPL-3.0-or-later
"""The menu of filters, and its places in Blender's menus."""

from __future__ import annotations

import bpy

from ..modes import choices, within

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
        from .contents import draw_filter

        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        in_images = context.space_data.type == "IMAGE_EDITOR"
        offered = [
            mode
            for mode in choices()
            if (mode.data.in_images if in_images else mode.target_in(context.mode))
        ]
        for mode in offered:
            operator = draw_filter(layout, context, mode)
            if len(mode.targets) > 1 and context.mode != "OBJECT" and not in_images:
                operator.target = mode.target_in(context.mode).key
        for other in (each for mode in offered for each in within(mode)):
            draw_filter(layout, context, other)


def _draw_at_end(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    self.layout.separator()
    self.layout.menu(SHOCK_FILTER_MT_filters.__name__)


def _draw_in_header(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    # Texture Paint Mode has no menu that this one could be added to.
    if context.mode == "PAINT_TEXTURE":
        self.layout.menu(SHOCK_FILTER_MT_filters.__name__)


ENTRIES = dict.fromkeys(_PLACES, _draw_at_end) | {"VIEW3D_MT_editor_menus": _draw_in_header}
"""The functions that draw at the end of Blender's menus."""

CLASSES = (SHOCK_FILTER_MT_filters,)


def register() -> None:
    """Append the menu to Blender's."""
    for name, draw in ENTRIES.items():
        getattr(bpy.types, name).append(draw)


def unregister() -> None:
    """Remove it."""
    for name, draw in ENTRIES.items():
        getattr(bpy.types, name).remove(draw)
