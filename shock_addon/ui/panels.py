# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar tab "Shock Filter" in the 3D view and the Image Editor."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_iface as iface_

from .. import data
from ..data.skipped import Skipped
from ..flow import overlay as flow_overlay
from ..operators import base as operators
from ..operators import jobs, kernels, statistics
from ..operators import poll as obstacles
from ..operators.properties import DILATE_NAMES, NAMES
from . import sections
from .presets import PANELS as PRESETS
from .wrapping import draw_text, fit

_DENOISE = {
    "denoise": ("Denoise", "Denoise, then Sharpen"),
    "denoise_image": ("Denoise Image", "Denoise Image, then Sharpen"),
}
"""The words on the buttons that denoise, and on those that sharpen, too."""

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
        sections.draw_main(layout, settings, mode)
        problem = kernels.problem()
        if problem:
            draw_text(layout, context, problem, icon="ERROR")
        if jobs.current() is not None:
            _draw_progress(layout)
            return
        obstacle = obstacles.of_mode(context, mode, settings)
        _draw_buttons(layout, context, mode, enabled=not obstacle)
        # Else Blender draws the first line as the bar that was there, until the mouse moves.
        layout.separator(factor=0.01)
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
                column = sections.split(self.layout)
                sections.draw_search(column, context, settings, "attribute", "color_attributes")
        elif scene_settings.mode == "COLORS":
            settings, column = scene_settings.colors, sections.split(self.layout)
            sections.draw_search(column, context, settings, "attribute", "color_attributes")
        elif scene_settings.mode == "TEXTURE":
            column = sections.split(self.layout)
            column.prop_search(scene_settings.texture, "image", bpy.data, "images")
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
        """Draw what may change."""
        sections.draw_mask(self.layout, context, settings, self.mode(context))


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
        sections.draw_output(self.layout, settings, self.mode(context))


class SHOCK_FILTER_PT_output(_OutputPanel, _Panel, bpy.types.Panel):
    """Where the new shape or the new image goes."""

    modes = {"denoise", "geometry", "texture"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Colors stay where they are."""
        return super().poll(context) and sections.has_output(
            cls.settings(context), cls.mode(context)
        )


class SHOCK_FILTER_PT_image_output(_OutputPanel, _ImagePanel, bpy.types.Panel):
    """Where the new image goes."""

    bl_parent_id = "SHOCK_FILTER_PT_image_main"


class _AdvancedPanel(_SubPanel):
    bl_label = "Advanced"

    def draw_settings(self, context: bpy.types.Context, settings: bpy.types.PropertyGroup) -> None:
        """Draw what few need."""
        sections.draw_advanced(self.layout, settings, self.mode(context))


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
            seconds = statistics.corrected(mode, settings, guess.seconds)
            _draw_value(column, "Duration", iface_("about {}").format(_clock(seconds)))
            _draw_value(column, "Memory", iface_("about {}").format(_megabytes(guess.memory)))
            if statistics.compiles(mode, settings):
                draw_text(column, context, "The first run compiles the filter, too: some seconds.")
        seconds = statistics.last_seconds(mode, settings)
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
    image = data.edited_image(context)
    if image is not None:
        operator.image = image.name


def _draw_shown_image(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Say which image will be sharpened."""
    if not data.mesh_objects(context):
        return
    try:
        name = data.shown_image(context).name
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


def _draw_buttons(
    layout: bpy.types.UILayout, context: bpy.types.Context, mode: str, enabled: bool
) -> None:
    column = layout.column()
    runs = column.column()
    runs.enabled = enabled
    main = runs.column()
    main.scale_y = 1.5
    draw_sharpen(main, context, mode)
    if mode == "texture":
        draw_dilate(runs, context)
    row = column.row(align=True)
    if context.mode == "OBJECT" or context.space_data.type == "IMAGE_EDITOR":
        preview = row.row(align=True)
        preview.enabled = enabled
        preview.operator("shock_filter.preview")
    shown = flow_overlay.shown_object()
    is_active = context.object is not None and context.object.name == shown
    if mode in _WITH_FLOW and not is_active:
        flow = row.row(align=True)
        flow.enabled = enabled
        flow.operator("shock_filter.show_flow").mode = mode
    if shown is not None and context.space_data.type == "VIEW_3D":
        (row if is_active else column).operator("shock_filter.hide_flow")


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
