# SPDX-License-Identifier: GPL-3.0-or-later
"""Drawing of parameters, in the panels of the tab and in operators after their runs."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_iface as iface_

from .. import data
from ..data import PICTURES
from ..modes import Mode, Target
from .keeping import found_by
from .properties import AUTO, FROM, LENGTH, OUTPUTS_OF_COLORS
from .wrapping import draw_text, fit

Parameters = bpy.types.PropertyGroup | bpy.types.OperatorProperties
"""The owner of the values: settings of the scene, or an operator."""


def draw_after_run(
    layout: bpy.types.UILayout,
    context: bpy.types.Context,
    parameters: bpy.types.OperatorProperties,
    mode: Mode,
) -> None:
    """Draw an operator's parameters: the main ones, and the others in folded sections."""
    column = split(layout)
    if mode.within:
        for name in mode.names:
            column.prop(parameters, name)
        return
    names = mode.names_for(parameters)
    if "target" in names:
        column.prop(parameters, "target")
    if "attribute" in names:
        draw_search(column, context, parameters, "attribute", "color_attributes")
    if hasattr(parameters, "image"):
        column.prop_search(parameters, "image", bpy.data, "images")
    draw_main(layout, context, parameters, mode)
    draw_sections(layout, context, parameters, mode)


def draw_sections(
    layout: bpy.types.UILayout, context: bpy.types.Context, parameters: Parameters, mode: Mode
) -> None:
    """Draw the masks, the output and the advanced settings, folded."""
    if "vertex_group" in mode.names_for(parameters):
        section = _section(layout, mode, "Mask")
        if section:
            draw_mask(section, context, parameters, mode)
    if has_output(parameters, mode):
        section = _section(layout, mode, "Output")
        if section:
            draw_output(section, context, parameters, mode)
    section = _section(layout, mode, "Advanced")
    if section:
        draw_advanced(section, parameters, mode)


def _section(layout: bpy.types.UILayout, mode: Mode, title: str) -> bpy.types.UILayout | None:
    """Draw the title of a section, and return its layout if it is open."""
    header, body = layout.panel(f"SHOCK_FILTER_{mode.key}_{title.lower()}", default_closed=True)
    header.label(text=title)
    return body


def draw_main(
    layout: bpy.types.UILayout, context: bpy.types.Context, parameters: Parameters, mode: Mode
) -> None:
    """Draw the main settings."""
    column = split(layout)
    target = mode.target(parameters)
    if PICTURES[0] in target.places:
        _draw_pictures(column, parameters)
    if "maps" in target.places:
        column.prop(parameters, "maps")
    _draw_starts(column, context, parameters, target)
    for name in target.fields:
        if target.is_advanced(name) or (name == "source" and hasattr(parameters, FROM)):
            continue
        row = column.row()
        if name == target.time:
            _draw_time(column, row, parameters, target)
        elif name == "blending":
            column.prop(parameters, LENGTH)
        else:
            row.active = not _overridden(parameters, target, name)
            _draw_setting(row, context, parameters, mode, name)
    if "frames" in target.places:
        column.prop(parameters, "frames")
    if "field" in target.places:
        draw_search(column, context, parameters, "field", "attributes")
    # In the Image Editor a flow map is meant, whatever the 3D view's panel shows.
    if "y_axis" in (mode.names if data.chosen.in_image_editor(context) else target.places):
        column.prop(parameters, "y_axis")
    if "along" in target.places:
        column.prop(parameters, "along")
        if parameters.along == "ATTRIBUTE":
            draw_search(column, context, parameters, "along_attribute", "attributes")
    if "stretch_along" in target.places:
        column.prop(parameters, "stretch_along")
    for name in ("occlude", "marked"):
        if name in target.places:
            column.prop(parameters, name)
    if "scale_map" in target.places:
        column.prop_search(parameters, "scale_map", bpy.data, "images")
    if "gain_map" in target.places:
        column.prop_search(parameters, "gain_map", bpy.data, "images")
        draw_search(column, context, parameters, "gain_colors", "color_attributes")
    if mode.follows is not None:
        _draw_switched(column, parameters, "then_sharpen", "sharpen_time")


def _draw_starts(
    column: bpy.types.UILayout,
    context: bpy.types.Context,
    parameters: Parameters,
    target: Target,
) -> None:
    """Draw the sources of a distance."""
    if "start" not in target.places:
        return
    column.prop(parameters, FROM)
    if parameters.source != "given":
        return
    if parameters.start == "GROUP":
        draw_search(column, context, parameters, "start_group", "vertex_groups")
    if parameters.start == "IMAGE":
        column.prop_search(parameters, "start_image", bpy.data, "images")


def _draw_pictures(column: bpy.types.UILayout, parameters: Parameters) -> None:
    """Draw the fields of further pictures: those in use, and an empty one."""
    for name in PICTURES:
        column.prop_search(parameters, name, bpy.data, "images")
        if not getattr(parameters, name):
            return


def _draw_setting(
    row: bpy.types.UILayout,
    context: bpy.types.Context,
    parameters: Parameters,
    mode: Mode,
    name: str,
) -> None:
    """Draw a setting; if it can be automatic, behind a switch.

    Beside the switch are the value that the last run chose, and a button that keeps it.
    """
    switch = name + AUTO
    of_panel = isinstance(parameters, bpy.types.PropertyGroup)
    found = found_by(context, mode.group, name) if of_panel else None
    if not hasattr(parameters, switch):
        row.prop(parameters, name)
        if found is not None and getattr(parameters, name) == "auto":
            row = row.row(align=True)
            keep = row.operator(
                "shock_filter.keep_auto", text=found.text, icon="PINNED", translate=False
            )
            keep.mode, keep.name = mode.group, name
        return
    title = parameters.bl_rna.properties[name].name
    row = row.row(heading=title, align=True)
    word = parameters.bl_rna.properties[switch].name
    if not getattr(parameters, switch):
        row.prop(parameters, switch, text=word, toggle=True)
        row.prop(parameters, name, text="")
        return
    if found is None:
        row.prop(parameters, switch, text=word, toggle=True)
        return
    text = iface_("Auto: {value}").format(value=found.said)
    if not fit(context, [title, text, "Keep"]):
        text = iface_("Auto: {value}").format(value=found.text)
    row.prop(parameters, switch, text=text, toggle=True, translate=False)
    words = {} if fit(context, [title, text, "Keep"]) else {"text": "", "icon": "PINNED"}
    keep = row.operator("shock_filter.keep_auto", **words)
    keep.mode, keep.name = mode.group, name


def _draw_time(
    column: bpy.types.UILayout, row: bpy.types.UILayout, parameters: Parameters, target: Target
) -> None:
    """Draw a flow time, and the checkbox for an infinite time."""
    if hasattr(parameters, target.time + AUTO):
        row = row.row(heading=parameters.bl_rna.properties[target.time].name, align=True)
        row.prop(parameters, target.time + AUTO, text="Auto", toggle=True)
        if not getattr(parameters, target.time + AUTO):
            row.prop(parameters, target.time, text="")
    else:
        row.prop(parameters, target.time)
    if target.steady_state:
        row.active = not getattr(parameters, target.steady_state)
        column.prop(parameters, target.steady_state)


def _overridden(parameters: Parameters, target: Target, name: str) -> bool:
    """Whether a time overrides a setting."""
    by_width = (f"{target.prefix}what", target.width)
    return name in by_width and bool(target.width) and target.has_time(parameters)


def draw_mask(
    layout: bpy.types.UILayout, context: bpy.types.Context, parameters: Parameters, mode: Mode
) -> None:
    """Draw the properties of masks, and those of the current object mode."""
    column = split(layout)
    draw_search(column, context, parameters, "vertex_group", "vertex_groups")
    if "mask_image" in mode.names:
        column.prop_search(parameters, "mask_image", bpy.data, "images")
    row = column.row()
    row.active = bool(parameters.vertex_group or getattr(parameters, "mask_image", ""))
    row.prop(parameters, "invert_mask")
    if context.mode == "EDIT_MESH":
        column.prop(parameters, "selected_only")
    if context.mode == "SCULPT":
        draw_text(column, context, "The sculpt mask protects, too.", icon="INFO")
    if context.mode in {"PAINT_VERTEX", "PAINT_TEXTURE", "PAINT_WEIGHT"}:
        draw_text(column, context, "The paint mask protects, too.", icon="INFO")


def is_attribute(parameters: Parameters, mode: Mode) -> bool:
    """Whether values go to an attribute of the vertices, not into an image."""
    return "into" in mode.names_for(parameters) and parameters.into == "ATTRIBUTE"


def has_output(parameters: Parameters, mode: Mode) -> bool:
    """Whether there is a choice of the output."""
    return bool({"output", "add_node", "folder"}.intersection(mode.names_for(parameters)))


def draw_output(
    layout: bpy.types.UILayout, context: bpy.types.Context, parameters: Parameters, mode: Mode
) -> None:
    """Draw the properties of the output."""
    column = split(layout)
    if "folder" in mode.names:
        column.prop(parameters, "folder")
        is_of_map = data.chosen.in_image_editor(context)  # whatever the 3D view's panel shows
        if "add_node" in mode.names_for(parameters) and not is_of_map:
            column.prop(parameters, "add_node")
        return
    if "add_node" in mode.names:
        if "into" in mode.names_for(parameters):
            column.prop(parameters, "into")
        image = column.column()
        image.active = not is_attribute(parameters, mode)
        image.prop_search(parameters, "image", bpy.data, "images")
        image.prop(parameters, "add_node")
        return
    kind = mode.target(parameters).data
    if kind.paints and not kind.moves and mode.data.moves:
        outputs = column.column(align=True)
        for value in OUTPUTS_OF_COLORS:
            outputs.prop_enum(parameters, "output", value)
        return
    column.prop(parameters, "output", expand=True)
    if "assign" in mode.names:
        row = column.row()
        row.active = parameters.output == "NEW"
        row.prop(parameters, "assign")
    if "mark_sharp" in mode.names:
        _draw_switched(column, parameters, "mark_sharp", "sharp_angle")
        column.prop(parameters, "custom_normals")


def draw_advanced(layout: bpy.types.UILayout, parameters: Parameters, mode: Mode) -> None:
    """Draw the advanced settings, in the order of their description."""
    column = split(layout)
    target = mode.target(parameters)
    if "in_colors" in target.places:
        column.prop(parameters, "in_colors")
    for name in target.fields:
        if not target.is_advanced(name):
            continue
        if name == target.time:
            _draw_time(column, column.row(), parameters, target)
        else:
            column.prop(parameters, name)
    if "weld" in mode.names:
        column.prop(parameters, "weld")


def split(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    """Return a column with names to the left of values."""
    column = layout.column()
    column.use_property_split = True
    column.use_property_decorate = False
    return column


def draw_search(
    layout: bpy.types.UILayout,
    context: bpy.types.Context,
    parameters: Parameters,
    name: str,
    collection: str,
) -> None:
    """Draw a search field for a name in the active object or its mesh."""
    obj = context.object
    if obj is None or obj.type != "MESH":
        layout.prop(parameters, name)
    else:
        owner = obj if hasattr(obj, collection) else obj.data
        layout.prop_search(parameters, name, owner, collection)


def _draw_switched(
    column: bpy.types.UILayout, parameters: Parameters, switch: str, value: str
) -> None:
    """Draw a checkbox and the value that it enables on one line."""
    row = column.row(heading=parameters.bl_rna.properties[switch].name)
    row.prop(parameters, switch, text="")
    field = row.row()
    field.active = getattr(parameters, switch)
    field.prop(parameters, value, text="")
