# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar tab "Shock Filter" in the 3D view and the Image Editor."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_iface as iface_

from ...core.settings import Setting
from .. import jobs, kernels, obstacles, operators, statistics
from ..data.image_data import edited_image
from ..data.mesh_data import mesh_objects
from ..data.texture_data import shown_image
from ..fields import fields_of
from ..flow import flow_overlay
from ..properties import DILATE_NAMES, NAMES, STEADY_STATE
from ..skipped import Skipped
from .presets import PANELS as PRESETS
from .wrapping import draw_text, fit

_DENOISE = {
    "denoise": ("Denoise", "Denoise, then Sharpen"),
    "denoise_image": ("Denoise Image", "Denoise Image, then Sharpen"),
}
"""The words on the buttons that denoise, and on those that sharpen, too."""

_PREVIEWED = {"denoise", "geometry", "colors"}
_WITH_FLOW = {"geometry", "colors"}


class _Panel:
    """A panel of one mode, or of the one that is chosen in the 3D view."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Shock Filter"

    @classmethod
    def mode(cls, context: bpy.types.Context) -> str:
        return context.scene.shock_filter.mode.lower()

    @classmethod
    def settings(cls, context: bpy.types.Context) -> bpy.types.PropertyGroup:
        return getattr(context.scene.shock_filter, cls.mode(context))


class _ImagePanel(_Panel):
    bl_space_type = "IMAGE_EDITOR"

    @classmethod
    def mode(cls, context: bpy.types.Context) -> str:
        return context.scene.shock_filter.image_mode.lower()


class _MainPanel(_Panel):
    bl_label = "Shock Filter"

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        """Offer presets of the mode."""
        PRESETS[self.mode(context)].draw_panel_header(self.layout)

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the main settings, the buttons, and what was last done."""
        layout = self.layout
        mode = self.mode(context)
        settings = self.settings(context)
        self.draw_choice(context)
        _draw_main_settings(layout, settings, mode)
        problem = kernels.problem()
        if problem:
            draw_text(layout, context, problem, icon="ERROR")
        if jobs.current() is not None:
            _draw_progress(layout)
            return
        obstacle = obstacles.of_mode(context, mode, settings)
        _draw_buttons(layout, context, mode, enabled=not obstacle)
        if obstacle:
            draw_text(layout, context, obstacle, icon="INFO")
        elif mode in operators.summaries:
            draw_text(layout, context, operators.summaries[mode])


class SHOCK_FILTER_PT_main(_MainPanel, bpy.types.Panel):
    """Mode, main settings, the buttons, and what was last done."""

    def draw_choice(self, context: bpy.types.Context) -> None:
        """Draw the modes, and for colors the attribute, for textures the image."""
        scene_settings = context.scene.shock_filter
        _draw_choices(self.layout, context, scene_settings, "mode")
        if scene_settings.mode == "DENOISE":
            settings = scene_settings.denoise
            _draw_choices(self.layout, context, settings, "target")
            if settings.target != "geometry":
                column = _split(self.layout)
                _draw_search(column, context, settings, "attribute", "color_attributes")
        elif scene_settings.mode == "COLORS":
            column = _split(self.layout)
            _draw_search(column, context, scene_settings.colors, "attribute", "color_attributes")
        elif scene_settings.mode == "TEXTURE":
            _split(self.layout).prop_search(scene_settings.texture, "image", bpy.data, "images")
            if not scene_settings.texture.image:
                _draw_shown_image(self.layout, context)


class SHOCK_FILTER_PT_image_main(_MainPanel, _ImagePanel, bpy.types.Panel):
    """Mode, main settings, the buttons, and what was last done."""

    def draw_choice(self, context: bpy.types.Context) -> None:
        """Draw the modes."""
        _draw_choices(self.layout, context, context.scene.shock_filter, "image_mode")


class _SubPanel:
    bl_parent_id = "SHOCK_FILTER_PT_main"
    bl_options = {"DEFAULT_CLOSED"}
    modes = set(NAMES)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return cls.mode(context) in cls.modes

    def draw(self, context: bpy.types.Context) -> None:
        self.draw_settings(context, self.settings(context))


class _MaskPanel(_SubPanel):
    bl_label = "Mask"

    def draw_settings(self, context: bpy.types.Context, settings: bpy.types.PropertyGroup) -> None:
        """Draw the group, and what the current mode adds."""
        column = _split(self.layout)
        _draw_search(column, context, settings, "vertex_group", "vertex_groups")
        masks = [settings.vertex_group]
        if self.mode(context) == "texture":
            column.prop_search(settings, "mask_image", bpy.data, "images")
            masks.append(settings.mask_image)
        row = column.row()
        row.active = any(masks)
        row.prop(settings, "invert_mask")
        if context.mode == "EDIT_MESH":
            column.prop(settings, "selected_only")
        if context.mode == "SCULPT":
            draw_text(column, context, "The sculpt mask protects, too.", icon="INFO")
        if context.mode in {"PAINT_VERTEX", "PAINT_TEXTURE", "PAINT_WEIGHT"}:
            draw_text(column, context, "The paint mask protects, too.", icon="INFO")


class SHOCK_FILTER_PT_mask(_MaskPanel, _Panel, bpy.types.Panel):
    """What may change."""

    modes = {"denoise", "geometry", "colors", "texture"}


class SHOCK_FILTER_PT_image_mask(_MaskPanel, _ImagePanel, bpy.types.Panel):
    """What of the texture may change."""

    bl_parent_id = "SHOCK_FILTER_PT_image_main"
    modes = {"texture"}


class _OutputPanel(_SubPanel):
    bl_label = "Output"

    def draw_settings(self, context: bpy.types.Context, settings: bpy.types.PropertyGroup) -> None:
        """Draw the choice."""
        column = _split(self.layout)
        mode = self.mode(context)
        column.prop(settings, "output", expand=True)
        if mode == "texture":
            row = column.row()
            row.active = settings.output == "NEW"
            row.prop(settings, "assign")
        if "mark_sharp" in NAMES[mode]:
            _draw_switched(column, settings, "mark_sharp", "sharp_angle")
            column.prop(settings, "custom_normals", text="Normals")


class SHOCK_FILTER_PT_output(_OutputPanel, _Panel, bpy.types.Panel):
    """Where the new shape or the new image goes."""

    modes = {"denoise", "geometry", "texture"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Denoised colors stay where they are."""
        settings = context.scene.shock_filter
        if settings.mode == "DENOISE" and settings.denoise.target == "colors":
            return False
        return super().poll(context)


class SHOCK_FILTER_PT_image_output(_OutputPanel, _ImagePanel, bpy.types.Panel):
    """Where the new image goes."""

    bl_parent_id = "SHOCK_FILTER_PT_image_main"


class _AdvancedPanel(_SubPanel):
    bl_label = "Advanced"

    def draw_settings(self, context: bpy.types.Context, settings: bpy.types.PropertyGroup) -> None:
        """Draw the settings in the order of their description."""
        column = _split(self.layout)
        for name, about in _fields(settings, self.mode(context)).items():
            if about.advanced:
                column.prop(settings, name)
        if "weld" in NAMES[self.mode(context)]:
            column.prop(settings, "weld")


class SHOCK_FILTER_PT_advanced(_AdvancedPanel, _Panel, bpy.types.Panel):
    """Settings that few need."""


class SHOCK_FILTER_PT_image_advanced(_AdvancedPanel, _ImagePanel, bpy.types.Panel):
    """Settings that few need."""

    bl_parent_id = "SHOCK_FILTER_PT_image_main"


class _StatisticsPanel(_SubPanel):
    bl_label = "Statistics"

    def draw_settings(self, context: bpy.types.Context, settings: bpy.types.PropertyGroup) -> None:
        """Draw what a run would work on and take, and how long the last one took."""
        mode = self.mode(context)
        column = self.layout.column(align=True)
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
        guess = statistics.expected(mode, settings, counts.size)
        if guess is not None:
            column.separator()
            seconds = statistics.corrected(mode, guess.seconds)
            _draw_value(column, "Time", iface_("about {}").format(_clock(seconds)))
            _draw_value(column, "Memory", iface_("about {}").format(_megabytes(guess.memory)))
        seconds = statistics.last_seconds(mode)
        if seconds is not None:
            column.separator()
            _draw_value(column, "Last Run", _clock(seconds))


class SHOCK_FILTER_PT_statistics(_StatisticsPanel, _Panel, bpy.types.Panel):
    """What a run would work on and take."""


class SHOCK_FILTER_PT_image_statistics(_StatisticsPanel, _ImagePanel, bpy.types.Panel):
    """What a run would work on and take."""

    bl_parent_id = "SHOCK_FILTER_PT_image_main"


def draw_sharpen(
    layout: bpy.types.UILayout, context: bpy.types.Context, mode: str
) -> bpy.types.OperatorProperties:
    """Draw a mode's button, which copies the scene's settings into the operator."""
    settings = getattr(context.scene.shock_filter, mode)
    if mode in _DENOISE:
        text = _DENOISE[mode][settings.then_sharpen]
        operator = layout.operator(f"shock_filter.{mode}", text=text, icon="SMOOTHCURVE")
    else:
        operator = layout.operator(f"shock_filter.sharpen_{mode}", icon="SHARPCURVE")
    for name in NAMES[mode]:
        setattr(operator, name, getattr(settings, name))
    if mode == "texture":
        _name_edited_image(operator, context)
    return operator


def draw_dilate(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the button that fills a texture's gutter."""
    settings = context.scene.shock_filter.texture
    operator = layout.operator("shock_filter.dilate_texture", icon="UV_ISLANDSEL")
    for name in DILATE_NAMES:
        setattr(operator, name, getattr(settings, name))
    _name_edited_image(operator, context)


def _name_edited_image(operator: bpy.types.OperatorProperties, context: bpy.types.Context) -> None:
    # In the Image Editor, the image that is seen counts, not the one that the 3D view names.
    image = edited_image(context)
    if image is not None:
        operator.image = image.name


def _draw_shown_image(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Say which image will be sharpened."""
    if not mesh_objects(context):
        return
    try:
        name = shown_image(context).name
    except Skipped:  # the line below the button says why
        return
    layout.label(text=iface_("Shown: {}").format(name), icon="IMAGE_DATA", translate=False)


def _draw_choices(
    layout: bpy.types.UILayout,
    context: bpy.types.Context,
    settings: bpy.types.PropertyGroup,
    name: str,
) -> None:
    """Draw all choices in one row, or two in each row where their words need more room."""
    items = list(settings.bl_rna.properties[name].enum_items)
    if fit(context, [iface_(item.name) for item in items]):
        layout.row().prop(settings, name, expand=True)
        return
    column = layout.column(align=True)
    for first in range(0, len(items), 2):
        row = column.row(align=True)
        for item in items[first : first + 2]:
            row.prop_enum(settings, name, item.identifier)


def _split(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    column = layout.column()
    column.use_property_split = True
    column.use_property_decorate = False
    return column


def _draw_search(
    layout: bpy.types.UILayout,
    context: bpy.types.Context,
    settings: bpy.types.PropertyGroup,
    name: str,
    collection: str,
) -> None:
    """Draw a name that is looked up in the active object or its mesh."""
    obj = context.object
    if obj is None or obj.type != "MESH":
        layout.prop(settings, name)
    else:
        owner = obj if hasattr(obj, collection) else obj.data
        layout.prop_search(settings, name, owner, collection)


def _draw_main_settings(
    layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup, mode: str
) -> None:
    column = _split(layout)
    for name, about in _fields(settings, mode).items():
        if about.advanced:
            continue
        row = column.row()
        row.prop(settings, name)
        if name == "time" and hasattr(settings, STEADY_STATE):
            row.active = not settings.steady_state
            column.prop(settings, STEADY_STATE)
    if "then_sharpen" in NAMES[mode]:
        _draw_switched(column, settings, "then_sharpen", "sharpen_time")


def _draw_switched(
    column: bpy.types.UILayout, settings: bpy.types.PropertyGroup, switch: str, value: str
) -> None:
    """Draw a checkbox and beside it the value that it switches on, on one line."""
    row = column.row(heading=settings.bl_rna.properties[switch].name)
    row.prop(settings, switch, text="")
    field = row.row()
    field.active = getattr(settings, switch)
    field.prop(settings, value, text="")


def _draw_buttons(
    layout: bpy.types.UILayout, context: bpy.types.Context, mode: str, enabled: bool
) -> None:
    column = layout.column()
    column.enabled = enabled
    main = column.column()
    main.scale_y = 1.5
    draw_sharpen(main, context, mode)
    if mode == "texture":
        draw_dilate(column, context)
    row = column.row(align=True)
    if mode in _PREVIEWED and context.mode == "OBJECT":
        row.operator("shock_filter.preview").mode = mode
    if mode in _WITH_FLOW:
        obj = context.object
        is_shown = obj is not None and flow_overlay.shown_object() == obj.name
        text = "Hide Flow" if is_shown else "Show Flow"
        row.operator("shock_filter.show_flow", text=text, depress=is_shown).mode = mode


def _draw_progress(layout: bpy.types.UILayout) -> None:
    job = jobs.current()
    row = layout.row(align=True)
    row.scale_y = 1.5
    row.progress(factor=job.fraction, text=job.message)
    row.operator("shock_filter.cancel", text="", icon="X")


def _draw_value(column: bpy.types.UILayout, text: str, value: str) -> None:
    """Draw a line of numbers like one of settings: the name on the left, aligned to the right."""
    split = column.split(factor=0.4)
    name = split.row()
    name.alignment = "RIGHT"
    name.label(text=text)
    split.label(text=value, translate=False)


def _clock(seconds: float) -> str:
    if seconds < 60.0:
        return f"{max(seconds, 0.1):.{1 if seconds < 10.0 else 0}f} s"
    return f"{seconds / 60.0:.0f} min"


def _megabytes(number: float) -> str:
    return f"{max(number / 1e6, 1.0):.0f} MB" if number < 1e9 else f"{number / 1e9:.1f} GB"


def _fields(settings: bpy.types.PropertyGroup, mode: str) -> dict[str, Setting]:
    return fields_of(mode, getattr(settings, "target", ""))


CLASSES = (
    SHOCK_FILTER_PT_main,
    SHOCK_FILTER_PT_mask,
    SHOCK_FILTER_PT_output,
    SHOCK_FILTER_PT_advanced,
    SHOCK_FILTER_PT_statistics,
    SHOCK_FILTER_PT_image_main,
    SHOCK_FILTER_PT_image_mask,
    SHOCK_FILTER_PT_image_output,
    SHOCK_FILTER_PT_image_advanced,
    SHOCK_FILTER_PT_image_statistics,
)
