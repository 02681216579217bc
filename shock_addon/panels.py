# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar tab "Shock Filter" in the 3D view and the Image Editor."""

from __future__ import annotations

import bpy

from ..core.settings import (
    BeltramiGeometrySettings,
    BeltramiMeshSettings,
    BeltramiSettings,
    GeometrySettings,
    ImageSettings,
    Setting,
    ShockSettings,
    TextureSettings,
    describe,
)
from . import image_data, jobs, kernels, operators
from .image_operator import edited_image
from .mesh_data import mesh_objects
from .presets import PANELS as PRESETS
from .properties import COLOR_PREFIX, DILATE_NAMES, NAMES, STEADY_STATE, denoise_names
from .skipped import Skipped
from .texture_data import shown_image
from .wrapping import draw_text

_ABOUT = {
    "denoise": {
        **describe(BeltramiGeometrySettings),
        **{COLOR_PREFIX + name: about for name, about in describe(BeltramiMeshSettings).items()},
    },
    "denoise_image": describe(BeltramiSettings),
    "geometry": describe(GeometrySettings),
    "colors": describe(ShockSettings),
    "image": describe(ImageSettings),
    "texture": describe(TextureSettings),
}

_DENOISE = {"denoise": "Denoise", "denoise_image": "Denoise Image"}
"""The words on the buttons that denoise."""


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
        """Draw the main settings, the button, and what was last done."""
        layout = self.layout
        mode = self.mode(context)
        self.draw_choice(context)
        _draw_main_settings(layout, self.settings(context), mode)
        problem = kernels.problem()
        if problem:
            draw_text(layout, context, problem, icon="ERROR")
        column = layout.column()
        column.scale_y = 1.5
        draw_sharpen(column, context, mode)
        if mode == "texture":
            draw_dilate(layout, context)
        _draw_state(layout, context, mode)


class SHOCK_FILTER_PT_main(_MainPanel, bpy.types.Panel):
    """Mode, main settings, the button, and what was last done."""

    def draw_choice(self, context: bpy.types.Context) -> None:
        """Draw the modes, and for colors the attribute, for textures the image."""
        scene_settings = context.scene.shock_filter
        self.layout.row().prop(scene_settings, "mode", expand=True)
        if scene_settings.mode == "DENOISE":
            settings = scene_settings.denoise
            self.layout.row().prop(settings, "target", expand=True)
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
    """Main settings, the button, and what was last done."""

    def draw_choice(self, context: bpy.types.Context) -> None:
        """Draw the modes, and say why the image cannot be sharpened, if so."""
        self.layout.row().prop(context.scene.shock_filter, "image_mode", expand=True)
        image = edited_image(context)
        tiles = self.mode(context) == "texture"
        reason = "" if image is None else image_data.refusal(image, tiles)
        if reason:
            draw_text(self.layout, context, f"{image.name}: {reason}.", icon="ERROR")


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
        if context.mode in {"PAINT_VERTEX", "PAINT_TEXTURE"}:
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
        column.prop(settings, "output", expand=True)
        if self.mode(context) == "texture":
            row = column.row()
            row.active = settings.output == "NEW"
            row.prop(settings, "assign")


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
        for name, about in _about(settings, self.mode(context)).items():
            if about.advanced:
                column.prop(settings, name)
        if "weld" in NAMES[self.mode(context)]:
            column.prop(settings, "weld")


class SHOCK_FILTER_PT_advanced(_AdvancedPanel, _Panel, bpy.types.Panel):
    """Settings that few need."""


class SHOCK_FILTER_PT_image_advanced(_AdvancedPanel, _ImagePanel, bpy.types.Panel):
    """Settings that few need."""

    bl_parent_id = "SHOCK_FILTER_PT_image_main"


def draw_sharpen(
    layout: bpy.types.UILayout, context: bpy.types.Context, mode: str
) -> bpy.types.OperatorProperties:
    """Draw a mode's button, which copies the scene's settings into the operator."""
    settings = getattr(context.scene.shock_filter, mode)
    if mode in _DENOISE:
        text = _DENOISE[mode] + (", then Sharpen" if settings.then_sharpen else "")
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
    """Say which image will be sharpened, or why there is none."""
    if not mesh_objects(context):
        return
    try:
        layout.label(text=shown_image(context).name, icon="IMAGE_DATA")
    except Skipped as reason:
        draw_text(layout, context, f"{mesh_objects(context)[0].name}: {reason}.", icon="ERROR")


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
    for name, about in _about(settings, mode).items():
        if about.advanced:
            continue
        row = column.row()
        row.prop(settings, name)
        if name == "time" and hasattr(settings, STEADY_STATE):
            row.active = not settings.steady_state
            column.prop(settings, STEADY_STATE)
    if "then_sharpen" in NAMES[mode]:
        column.prop(settings, "then_sharpen")
        row = column.row()
        row.active = settings.then_sharpen
        row.prop(settings, "sharpen_time")


def _about(settings: bpy.types.PropertyGroup, mode: str) -> dict[str, Setting]:
    """Describe the settings that matter now."""
    names = denoise_names(settings.target) if mode == "denoise" else _ABOUT[mode]
    return {name: about for name, (_, _, about) in _ABOUT[mode].items() if name in names}


def _draw_state(layout: bpy.types.UILayout, context: bpy.types.Context, mode: str) -> None:
    job = jobs.current()
    if job is not None:
        layout.progress(factor=job.fraction, text=job.message)
    elif mode in operators.summaries:
        draw_text(layout, context, operators.summaries[mode])


CLASSES = (
    SHOCK_FILTER_PT_main,
    SHOCK_FILTER_PT_mask,
    SHOCK_FILTER_PT_output,
    SHOCK_FILTER_PT_advanced,
    SHOCK_FILTER_PT_image_main,
    SHOCK_FILTER_PT_image_mask,
    SHOCK_FILTER_PT_image_output,
    SHOCK_FILTER_PT_image_advanced,
)
