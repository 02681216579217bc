# SPDX-License-Identifier: GPL-3.0-or-later
"""The contents of the panels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
from bpy.app.translations import pgettext_iface as iface_

from .. import data
from ..data.skipped import Skipped
from ..flow import showing as flow_shown
from ..modes import Mode, below
from ..operators import base as operators
from ..operators import comparing, drawing, linking, statistics
from ..operators import poll as obstacles
from ..operators.filtering import operator_of
from ..operators.wrapping import draw_text, fit
from ..preview import operator as preview_operator
from ..preview import painting
from ..running import jobs, kernels, preparing

if TYPE_CHECKING:
    from .panel import Panel


def draw_main(panel: Panel, context: bpy.types.Context) -> None:
    """Draw the main settings, the buttons, and the last report."""
    layout = panel.layout
    mode = panel.mode(context)
    settings = panel.settings(context)
    _draw_choices(layout, context, context.scene.shock_filter, panel.choice)
    if panel.choice == "mode":  # the Image Editor shows its image
        _draw_target(panel, context)
    drawing.draw_main(layout, context, settings, mode)
    problem = kernels.problem()
    if problem:
        draw_text(layout, context, problem, icon="ERROR")
    preparing.tab_is_seen()
    if jobs.current() is not None:
        _draw_progress(layout)
        return
    _draw_preparing(layout)
    obstacle = obstacles.of_mode(context, mode, settings)
    if announced := obstacles.announcement(context, mode, settings):
        draw_text(layout, context, announced, icon="INFO")
    _draw_buttons(layout, context, mode, enabled=not obstacle)
    # Else Blender draws the first line as the bar that was there, until the mouse moves.
    layout.separator(factor=0.01)
    if obstacle:
        draw_text(layout, context, obstacle, icon="INFO")
    elif before := comparing.note(context):
        draw_text(layout, context, before, icon="ERROR")
    elif summary := operators.summary_of(context, mode.key):
        draw_text(layout, context, summary)


def draw_statistics(
    layout: bpy.types.UILayout,
    context: bpy.types.Context,
    mode: Mode,
    settings: bpy.types.PropertyGroup,
) -> None:
    """Draw the size of the input, and the speed of the last run."""
    column = layout.column(align=True)
    counts = statistics.count(context, mode, settings)
    for text, number in (
        ("Meshes", counts.meshes),
        ("Vertices", counts.vertices),
        ("Faces", counts.faces),
        ("Pixels", counts.pixels),
    ):
        if number:
            _draw_value(column, text, f"{number:,}")
    if not counts.size:
        column.label(text="Nothing to work on.")
    last = statistics.last_run(mode, settings)
    if last is not None:
        column.separator()
        _draw_value(column, "Last Run", _clock(last.seconds))
        speed = iface_("{:,.0f} a second").format(last.size / last.seconds)
        _draw_value(column, "Speed", speed)


def draw_filter(
    layout: bpy.types.UILayout, context: bpy.types.Context, mode: Mode
) -> bpy.types.OperatorProperties:
    """Draw a mode's button, which passes the scene's settings to the operator."""
    settings = getattr(context.scene.shock_filter, mode.group)
    words = {}
    if mode.follows is not None:
        words["text"] = f"{mode.title}, then Sharpen" if settings.then_sharpen else mode.title
    operator = layout.operator(operator_of(mode).bl_idname, icon=mode.icon, **words)
    for name in mode.names:
        setattr(operator, name, getattr(settings, name))
    image = data.chosen.edited_image(context)
    if "image" in mode.names and image is not None:
        # In the Image Editor, the image that is seen counts, not the one that the 3D view names.
        operator.image = image.name
        if len(mode.targets) > 1 and mode.data.in_images:
            operator.target = next(each.key for each in mode.targets if each.data.in_images)
    return operator


def _draw_target(panel: Panel, context: bpy.types.Context) -> None:
    """Draw the input: the attribute of colors, or the image of a texture."""
    layout, settings = panel.layout, panel.settings(context)
    names = panel.mode(context).names_for(settings)
    if "target" in names:
        _draw_choices(layout, context, settings, "target")
    column = drawing.split(layout)
    if "attribute" in names:
        drawing.draw_search(column, context, settings, "attribute", "color_attributes")
    if "image_size" in names:
        row = column.row()
        row.active = "image" not in names or not settings.image
        row.prop(settings, "image_size")
    elif "image" in names:
        column.prop_search(settings, "image", bpy.data, "images")
        if not settings.image and panel.mode(context).data.handled_as == "textures":
            _draw_shown_image(layout, context, panel.mode(context))


def _draw_shown_image(layout: bpy.types.UILayout, context: bpy.types.Context, mode: Mode) -> None:
    """Show the image that a run would use."""
    if preview_operator.is_running() or not data.chosen.mesh_objects(context):
        return  # a preview lets materials show another image
    try:
        name = data.chosen.shown_image(context).name
    except Skipped:  # the line below the button says why
        return
    text = iface_(mode.announced).format(name)
    layout.label(text=text, icon="IMAGE_DATA", translate=False)


def _draw_choices(
    layout: bpy.types.UILayout,
    context: bpy.types.Context,
    settings: bpy.types.PropertyGroup,
    name: str,
) -> None:
    """Draw all choices in one row, or two in a row if their labels need more space."""
    items = list(settings.bl_rna.properties[name].enum_items)
    if fit(context, [iface_(item.name) for item in items]):
        layout.row().prop(settings, name, expand=True)
        return
    column = layout.column(align=True)
    for first in range(0, len(items), 2):
        row = column.row(align=True)
        for item in items[first : first + 2]:
            row.prop_enum(settings, name, item.identifier)


def _draw_buttons(
    layout: bpy.types.UILayout, context: bpy.types.Context, mode: Mode, enabled: bool
) -> None:
    column = layout.column()
    runs = column.column()
    runs.enabled = enabled
    main = runs.column()
    main.scale_y = 1.5
    draw_filter(main, context, mode)
    for other in below(mode):
        draw_filter(runs, context, other)
    if comparing.is_held(context):
        column.operator("shock_filter.before_after", icon="ARROW_LEFTRIGHT")
    row = column.row(align=True)
    preview = row.row(align=True)
    preview.enabled = enabled
    if mode.has_preview:
        preview.operator("shock_filter.preview")
    if mode.targets[0].row.takes_gain and context.space_data.type == "VIEW_3D":
        row.operator("shock_filter.paint_gain", depress=painting.is_running())
    shown = flow_shown.shown_object()
    is_active = context.object is not None and context.object.name == shown
    if mode.flow and not is_active:
        flow = row.row(align=True)
        flow.enabled = enabled
        flow.operator("shock_filter.show_flow").mode = mode.key
    if shown is not None and context.space_data.type == "VIEW_3D":
        (row if is_active else column).operator("shock_filter.hide_flow")
    if mode.key == "geometry":
        _draw_creases(column, context, enabled)
    if mode.key == "generate" and linking.is_waiting(context):
        column.operator_menu_enum("shock_filter.link_map", "into")


def _draw_creases(layout: bpy.types.UILayout, context: bpy.types.Context, enabled: bool) -> None:
    """Draw the buttons that find creases and move nothing."""
    row = layout.row(align=True)
    finds = row.row(align=True)
    finds.enabled = enabled
    finds.operator("shock_filter.mark_creases")
    finds.operator("shock_filter.crisp_low_poly")
    shown = flow_shown.shown_object("creases")
    if context.object is None or context.object.name != shown:
        finds.operator("shock_filter.show_creases")
    if shown is not None:
        row.operator("shock_filter.hide_creases")


def _draw_progress(layout: bpy.types.UILayout) -> None:
    job = jobs.current()
    row = layout.row(align=True)
    row.scale_y = 1.5
    row.progress(factor=job.fraction, text=job.message)
    row.operator("shock_filter.cancel", text="", icon="X")


def _draw_preparing(layout: bpy.types.UILayout) -> None:
    """Show the progress of compiling, during which the buttons work."""
    fraction = preparing.fraction()
    if fraction is not None:
        text = iface_("Preparing for first use: {fraction:.0%}").format(fraction=fraction)
        layout.progress(factor=fraction, text=text)


def _draw_value(column: bpy.types.UILayout, text: str, value: str) -> None:
    """Draw a name and a value aligned like a setting."""
    split = column.split(factor=0.4)
    name = split.row()
    name.alignment = "RIGHT"
    name.label(text=text)
    split.label(text=value, translate=False)


def _clock(seconds: float) -> str:
    if seconds < 60.0:
        return f"{max(seconds, 0.1):.{1 if seconds < 10.0 else 0}f} s"
    return f"{seconds / 60.0:.0f} min"
