# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar tab "Shock Filter" in the 3D view."""

from __future__ import annotations

import bpy

from ..core.settings import GeometrySettings, describe
from . import jobs, kernels, operators
from .presets import SHOCK_FILTER_PT_geometry_presets
from .properties import GEOMETRY_NAMES, STEADY_STATE
from .wrapping import draw_text

_ABOUT = describe(GeometrySettings)


class _Panel:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Shock Filter"


class SHOCK_FILTER_PT_main(_Panel, bpy.types.Panel):
    """Mode, main settings, the button, and what was last done."""

    bl_label = "Shock Filter"

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        """Offer presets of the mode."""
        SHOCK_FILTER_PT_geometry_presets.draw_panel_header(self.layout)

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        layout = self.layout
        scene_settings = context.scene.shock_filter
        layout.row().prop(scene_settings, "mode", expand=True)
        _draw_main_settings(layout, scene_settings.geometry)
        problem = kernels.problem()
        if problem:
            draw_text(layout, context, problem, icon="ERROR")
        column = layout.column()
        column.scale_y = 1.5
        draw_sharpen_geometry(column, context)
        _draw_state(layout, context)


class _GeometryPanel(_Panel):
    bl_parent_id = "SHOCK_FILTER_PT_main"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.scene.shock_filter.mode == "GEOMETRY"

    def draw(self, context: bpy.types.Context) -> None:
        self.layout.use_property_split = True
        self.layout.use_property_decorate = False
        self.draw_settings(context, context.scene.shock_filter.geometry)


class SHOCK_FILTER_PT_geometry_mask(_GeometryPanel, bpy.types.Panel):
    """Which vertices may move."""

    bl_label = "Mask"

    def draw_settings(self, context: bpy.types.Context, settings: bpy.types.PropertyGroup) -> None:
        """Draw the group, and what the current mode adds."""
        obj = context.object
        column = self.layout.column()
        if obj is not None and obj.type == "MESH":
            column.prop_search(settings, "vertex_group", obj, "vertex_groups")
        else:
            column.prop(settings, "vertex_group")
        row = column.row()
        row.active = bool(settings.vertex_group)
        row.prop(settings, "invert_mask")
        if context.mode == "EDIT_MESH":
            column.prop(settings, "selected_only")
        if context.mode == "SCULPT":
            draw_text(column, context, "The sculpt mask protects, too.", icon="INFO")


class SHOCK_FILTER_PT_geometry_output(_GeometryPanel, bpy.types.Panel):
    """Where the result goes."""

    bl_label = "Output"

    def draw_settings(self, context: bpy.types.Context, settings: bpy.types.PropertyGroup) -> None:
        """Draw the choice."""
        self.layout.column().prop(settings, "output", expand=True)


class SHOCK_FILTER_PT_geometry_advanced(_GeometryPanel, bpy.types.Panel):
    """Settings that few need."""

    bl_label = "Advanced"

    def draw_settings(self, context: bpy.types.Context, settings: bpy.types.PropertyGroup) -> None:
        """Draw them in the order of their description."""
        column = self.layout.column()
        for name, (_, _, about) in _ABOUT.items():
            if about.advanced:
                column.prop(settings, name)
        column.prop(settings, "weld")


def draw_sharpen_geometry(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the button, which copies the scene's settings into the operator."""
    settings = context.scene.shock_filter.geometry
    operator = layout.operator("shock_filter.sharpen_geometry", icon="SHARPCURVE")
    for name in GEOMETRY_NAMES:
        setattr(operator, name, getattr(settings, name))


def _draw_main_settings(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup) -> None:
    column = layout.column()
    column.use_property_split = True
    column.use_property_decorate = False
    for name, (_, _, about) in _ABOUT.items():
        if about.advanced:
            continue
        row = column.row()
        row.prop(settings, name)
        if name == "time":
            row.active = not settings.steady_state
            column.prop(settings, STEADY_STATE)


def _draw_state(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    job = jobs.current()
    if job is not None:
        layout.progress(factor=job.fraction, text=job.message)
    elif operators.last_summary:
        draw_text(layout, context, operators.last_summary)


CLASSES = (
    SHOCK_FILTER_PT_main,
    SHOCK_FILTER_PT_geometry_mask,
    SHOCK_FILTER_PT_geometry_output,
    SHOCK_FILTER_PT_geometry_advanced,
)
