# SPDX-License-Identifier: GPL-3.0-or-later
"""The part of the tab for live results."""

from __future__ import annotations

import bpy

from .. import data
from ..modes import Mode
from ..operators.wrapping import draw_text
from ..running import jobs
from . import automatic, updating

PAINTED = "Weight 1 shows the result: paint with 0 where the mesh should stay as it was."
"""What to do in Weight Paint Mode."""

WHITE_SHOWS = "White shows the result: paint with it where the image should change."
BLACK_SHOWS = "Black shows the result: paint with it where the image should change."
"""What to do in Texture Paint Mode."""

_SAID = {
    "stale": "The mesh has other vertices, edges or faces now, so the live result is not shown:"
    " press Update.",
    "moved": "Out of date: its source has changed since. Press Update to make it again.",
}


def draw(layout: bpy.types.UILayout, context: bpy.types.Context, mode: Mode) -> None:
    """Draw the inputs of the active object's live results, and what can be done with them.

    Those of textures only where a mode works on these.
    """
    obj = context.object
    if obj is None or obj.type != "MESH":
        return
    modifiers = data.chosen.live_modifiers(obj)
    is_texture = mode.data.handled_as == "textures"
    texture = data.mixes.first_mixed(obj) if is_texture else None
    if not modifiers and texture is None:
        return
    column = layout.column(align=True)
    column.use_property_decorate = False
    for modifier in modifiers:
        is_alone = len(modifiers) == 1 or modifier == data.chosen.live_modifier(obj)
        label = "Live Amount" if is_alone else "Live Colors"
        data.live.stacks.draw_input(column, modifier, data.live.graph.AMOUNT, label)
    if texture is not None:
        amount = texture[1].inputs[data.mixes.AMOUNT]
        column.prop(amount, "default_value", text="Live Texture")
    row = column.row(align=True)
    row.enabled = jobs.current() is None
    row.operator("shock_filter.update_live")
    if data.chosen.live_source(obj) is not None:
        is_on = automatic.is_on(obj)
        row.operator("shock_filter.auto_update_live", depress=is_on)
    hint = _hint(context, modifiers, texture)
    if hint:
        row.operator("object.mode_set", text="Done Painting").mode = "OBJECT"
        draw_text(layout, context, hint, icon="INFO")
    else:
        row.operator(f"shock_filter.paint_live{'' if texture is None else '_texture'}")
    # Weights are read by way of new data, which nothing may make while it draws.
    is_known = not data.mesh.shape_keys.are_weighted(obj)
    is_asked = modifiers and is_known and obj.mode != "EDIT" and not automatic.is_coming(obj)
    if is_asked and jobs.current() is None:
        found = data.live.watching.state_for_panel(obj, updating.state)
        if found in _SAID:
            draw_text(layout, context, _SAID[found], icon="ERROR")


def _hint(
    context: bpy.types.Context,
    modifiers: list[bpy.types.Modifier],
    texture: tuple[bpy.types.ShaderNodeTexImage, bpy.types.Node] | None,
) -> str:
    """Return a hint on what to paint with, while a mask is painted; otherwise empty."""
    obj = context.object
    if obj.mode == "WEIGHT_PAINT" and _is_painted(obj, modifiers):
        return PAINTED
    if obj.mode == "TEXTURE_PAINT" and texture is not None:
        where, is_inverted = data.materials.live_mask(texture[1])
        paint = context.tool_settings.image_paint
        if where is not None and paint.mode == "IMAGE" and paint.canvas == where.image:
            return BLACK_SHOWS if is_inverted else WHITE_SHOWS
    return ""


def _is_painted(obj: bpy.types.Object, modifiers: list[bpy.types.Modifier]) -> bool:
    """Whether the vertex group that brushes write to is the mask of a live result."""
    group = obj.vertex_groups.active
    masks = [data.live.stacks.linked_input(each, data.live.graph.MASK) for each in modifiers]
    return group is not None and group.name in masks
