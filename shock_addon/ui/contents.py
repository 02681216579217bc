# SPDX-License-Identifier: GPL-3.0-or-later
"""The contents of the panels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
from bpy.app.translations import pgettext_iface as iface_

from .. import data
from ..data.skipped import Skipped
from ..flow import showing as flow_shown
from ..live import drawing as live_drawing
from ..modes import JOBS, Job, Mode, job_of, modes_of
from ..operators import base as operators
from ..operators import comparing, drawing, linking, statistics
from ..operators import poll as obstacles
from ..operators.filtering import operator_of
from ..operators.generating import FROM_SELECTED, MAPS
from ..operators.wrapping import draw_text, fit
from ..preview import painting
from ..running import jobs, kernels
from . import presets

if TYPE_CHECKING:
    from .panel import Panel


def draw_main(panel: Panel, context: bpy.types.Context) -> None:
    """Draw the choices and the buttons, which keep their places; then settings and reports."""
    layout = panel.layout
    mode = panel.mode(context)
    settings = panel.settings(context)
    _draw_job(layout, context, panel, mode)
    _draw_input(layout, context, mode, settings)
    kernels.tab_is_seen()
    obstacle = obstacles.of_mode(context, mode, settings)
    _draw_buttons(layout, context, mode, enabled=not obstacle)
    _draw_settings(panel, context, mode, settings)
    if mode.key == "geometry":
        _draw_creases(layout, context, enabled=not obstacle)
    if context.space_data.type == "VIEW_3D":
        live_drawing.draw(layout, context, mode)
    if flow_shown.shown_object() is not None and context.space_data.type == "VIEW_3D":
        layout.operator("shock_filter.hide_flow")
    problem = kernels.problem()
    if problem:
        draw_text(layout, context, problem, icon="ERROR")
    _draw_report(layout, context, mode, settings, obstacle)


def draw_own(panel: Panel, context: bpy.types.Context) -> None:
    """Draw all of a mode that has a panel of its own."""
    layout = panel.layout
    mode, settings = panel.mode(context), panel.settings(context)
    obstacle = obstacles.of_mode(context, mode, settings)
    if panel.choice == "mode":
        _draw_choices(layout, context, settings, "target")
    _draw_buttons(layout, context, mode, enabled=not obstacle)
    _draw_report(layout, context, mode, settings, obstacle)
    _draw_settings(panel, context, mode, settings)
    drawing.draw_sections(layout, context, settings, mode)


def draw_maps(panel: Panel, context: bpy.types.Context) -> None:
    """Draw the buttons that bake several maps in one run, and what was baked last."""
    settings = panel.settings(context)
    obstacle = obstacles.of_unwrapped(context)
    layout = panel.layout
    layout.use_property_split, layout.use_property_decorate = True, False
    layout.prop(settings, "image_size")
    if jobs.current() is not None:
        _draw_progress(layout.column())
        return
    column = layout.column()
    column.enabled = not obstacle
    column.scale_y = 1.2
    for from_selected, text in ((False, "Bake 3 Maps"), (True, "Selected to Active")):
        row = column.row()
        if from_selected:
            row.context_pointer_set(FROM_SELECTED, context.scene)
        button = row.operator("shock_filter.bake_maps", text=iface_(text), translate=False)
        button.from_selected, button.image_size = from_selected, settings.image_size
    _draw_report(layout, context, panel.mode(context), settings, obstacle, MAPS)


def draw_flow(
    layout: bpy.types.UILayout,
    context: bpy.types.Context,
    mode: Mode,
    settings: bpy.types.PropertyGroup,
) -> None:
    """Draw the button that shows the flow of a mode, if it has one."""
    if not mode.flow:
        return
    row = layout.row()
    row.enabled = not obstacles.of_mode(context, mode, settings) and jobs.current() is None
    row.operator("shock_filter.show_flow").mode = mode.key


def _draw_settings(
    panel: Panel, context: bpy.types.Context, mode: Mode, settings: bpy.types.PropertyGroup
) -> None:
    """Draw the preset, where the data are, and the main settings."""
    if not mode.within:
        name = presets.shown_name(mode, settings)
        panel.layout.popover(f"SHOCK_FILTER_PT_{mode.key}_presets", text=name, icon="PRESET")
    if panel.choice == "mode":  # the Image Editor shows its image
        _draw_place(panel.layout, context, mode, settings)
    drawing.draw_main(panel.layout, context, settings, mode)


def _draw_report(
    layout: bpy.types.UILayout,
    context: bpy.types.Context,
    mode: Mode,
    settings: bpy.types.PropertyGroup,
    obstacle: str,
    key: str = "",
) -> None:
    """Draw why nothing can be done, or what was done last; the key is that of the mode if empty."""
    if jobs.shown() is not None:
        return
    # Else Blender draws the first line as the bar that was there, until the mouse moves.
    layout.separator(factor=0.01)
    flow_shown.follow_settings()
    if obstacle:
        draw_text(layout, context, obstacle, icon="INFO")
        return
    if announced := obstacles.announcement(context, mode, settings):
        draw_text(layout, context, announced, icon="INFO")
    image = settings.image if mode.data.handled_as == "textures" else ""
    if before := comparing.note(context):
        draw_text(layout, context, before, icon="ERROR")
    elif summary := operators.summary_of(context, key or mode.group, image):
        draw_text(layout, context, summary)
        _draw_details(layout, context, key or mode.group, image)


def _draw_details(
    layout: bpy.types.UILayout, context: bpy.types.Context, key: str, image: str
) -> None:
    """Draw the details of the last report, folded."""
    if details := operators.details_of(context, key, image):
        header, body = layout.panel(f"SHOCK_FILTER_{key}_details", default_closed=True)
        header.label(text="Details")
        if body:
            draw_text(body, context, details)


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
    elif said := statistics.basis(context, mode, settings):
        draw_text(column, context, said)
    last = statistics.last_run(mode, settings)
    if last is not None:
        column.separator()
        _draw_value(column, "Last Run", _clock(last.seconds))
        if last.filtered < last.size:
            _draw_value(column, "Filtered", f"{last.filtered:,}")
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


def _draw_job(
    layout: bpy.types.UILayout, context: bpy.types.Context, panel: Panel, mode: Mode
) -> None:
    """Draw the first row, and the second one: all jobs need the same space for it."""
    kept = context.scene.shock_filter
    _draw_choices(layout, context, kept, panel.job)
    needed = max(
        _rows(context, [word for _, _, word in _parts(kept, panel.choice, job)])
        for job in JOBS[panel.choice]
    )
    column, job = layout.column(align=True), job_of(panel.choice, mode)
    parts = _parts(kept, panel.choice, job)
    if parts:
        used = _draw_parts(column, context, kept, parts)
    else:
        column.label(text=job.does)
        used = 1
    for _ in range(needed - used):
        column.label(text="")


def _parts(kept: bpy.types.PropertyGroup, choice: str, job: Job) -> list[tuple[str, str, str]]:
    """List what the second row offers, as `_draw_parts` takes it; nothing for one mode."""
    modes = modes_of(choice, job)
    if choice == "mode" and job.key == "DENOISE":  # one choice for modes and targets
        items = kept.bl_rna.properties["noisy"].enum_items
        return [("noisy", item.identifier, item.name) for item in items]
    if len(modes) == 1:
        return []
    return [(choice, mode.key.upper(), mode.part or mode.label) for mode in modes]


def _draw_parts(
    column: bpy.types.UILayout,
    context: bpy.types.Context,
    kept: bpy.types.PropertyGroup,
    parts: list[tuple[str, str, str]],
) -> int:
    """Draw choices: names of properties, identifiers, words; return how many rows they take."""
    rows = _rows(context, [word for _, _, word in parts])
    size = -(-len(parts) // rows)
    for first in range(0, len(parts), size):
        row = column.row(align=True)
        for name, identifier, word in parts[first : first + size]:
            row.prop_enum(kept, name, identifier, text=word)
    return rows


def _draw_input(
    layout: bpy.types.UILayout,
    context: bpy.types.Context,
    mode: Mode,
    settings: bpy.types.PropertyGroup,
) -> None:
    """Draw one row that names the input of a run, also if there is none."""
    names, icon = _inputs(context, mode, settings), "MESH_DATA"
    if mode.data.handled_as != "meshes":
        icon = "IMAGE_DATA"
    name = names[0] if len(names) == 1 else iface_("{:,} meshes").format(len(names))
    text = iface_(mode.announced).format(name if names else "\u2013")
    layout.label(text=text, icon=icon, translate=False)


def _inputs(context: bpy.types.Context, mode: Mode, settings: bpy.types.PropertyGroup) -> list[str]:
    if mode.data.handled_as == "meshes":
        return [obj.name for obj in data.chosen.mesh_users(context)]
    image = data.chosen.edited_image(context)
    if image is not None or mode.data.handled_as == "images":
        return [] if image is None else [image.name]
    if jobs.is_previewing() or not data.chosen.mesh_objects(context):
        return []  # a preview lets materials show another image
    try:
        return [data.chosen.chosen_image(context, settings.image).name]
    except Skipped:  # the report says why
        return []


def _draw_place(
    layout: bpy.types.UILayout,
    context: bpy.types.Context,
    mode: Mode,
    settings: bpy.types.PropertyGroup,
) -> None:
    """Draw the input: the attribute of colors, or the image of a texture."""
    names = mode.names_for(settings)
    column = drawing.split(layout)
    if "attribute" in names:
        drawing.draw_search(column, context, settings, "attribute", "color_attributes")
    if "image_size" in names:
        row = column.row()
        row.active = "image" not in names or not settings.image
        row.prop(settings, "image_size")
    elif "image" in names:
        column.prop_search(settings, "image", bpy.data, "images")


def _draw_choices(
    layout: bpy.types.UILayout,
    context: bpy.types.Context,
    settings: bpy.types.PropertyGroup,
    name: str,
) -> None:
    """Draw all choices in one row, or fewer in a row if their labels need more space."""
    items = settings.bl_rna.properties[name].enum_items
    column = layout.column(align=True)
    _draw_parts(column, context, settings, [(name, item.identifier, item.name) for item in items])


def _rows(context: bpy.types.Context, words: list[str], of: str = "*") -> int:
    """Return in how many rows of equal buttons words fit."""
    said = [iface_(word, of) for word in words]
    every = range(1, len(said))
    return next((n for n in every if fit(context, said, -(-len(said) // n))), max(len(said), 1))


def _draw_buttons(
    layout: bpy.types.UILayout, context: bpy.types.Context, mode: Mode, enabled: bool
) -> None:
    """Draw the main button, or the progress of a run, and the buttons below it."""
    column = layout.column()
    enabled = enabled and jobs.current() is None
    if jobs.shown() is not None:
        _draw_progress(column)
    else:
        main = column.column()
        main.enabled = enabled
        main.scale_y = 1.5
        draw_filter(main, context, mode)
    row = column.row(align=True)
    if mode.data.handled_as != "films":
        preview = row.row(align=True)
        preview.enabled = enabled and mode.has_preview
        is_own = mode.data.handled_as == "fields"
        preview.operator(f"shock_filter.preview{'_generated' if is_own else ''}")
    swap = row.row(align=True)
    swap.enabled = comparing.is_held(context) and jobs.current() is None
    swap.operator("shock_filter.before_after", icon="ARROW_LEFTRIGHT")
    if mode.targets[0].row.takes_gain and context.space_data.type == "VIEW_3D":
        column.operator("shock_filter.paint_gain", depress=painting.is_running())
    if mode.key == "generate":
        _draw_link(column.row(), context)


def _draw_link(row: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the choice of what an image is linked to, or a button whose tooltip says why not."""
    if linking.is_waiting(context) and jobs.current() is None:
        row.operator_menu_enum("shock_filter.link_map", "into")
    else:
        row.context_pointer_set(linking.BUTTON, context.scene)
        row.operator("shock_filter.link_map")


def _draw_creases(layout: bpy.types.UILayout, context: bpy.types.Context, enabled: bool) -> None:
    """Draw the buttons that find creases and move nothing."""
    shown = flow_shown.shown_object("creases")
    is_active = context.object is not None and context.object.name == shown
    names = {"mark_creases": "Mark Creases", "crisp_low_poly": "Crisp Low Poly"}
    if not is_active:
        names["show_creases"] = "Show Creases"
    if shown is not None:
        names["hide_creases"] = "Hide Creases"
    size = -(-len(names) // _rows(context, list(names.values()), "Operator"))
    column, keys = layout.column(align=True), list(names)
    for first in range(0, len(keys), size):
        row = column.row(align=True)
        for key in keys[first : first + size]:
            button = row.row(align=True)
            button.enabled = key == "hide_creases" or (enabled and jobs.current() is None)
            button.operator(f"shock_filter.{key}")


def _draw_progress(layout: bpy.types.UILayout) -> None:
    job = jobs.current()
    row = layout.row(align=True)
    row.scale_y = 1.5
    row.progress(factor=job.fraction, text=job.message)
    row.operator("shock_filter.cancel", text="", icon="X")


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
