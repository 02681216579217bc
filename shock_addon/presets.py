# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets in the panel's header: named sets of the scene's settings."""

from __future__ import annotations

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel

from .properties import GEOMETRY_NAMES

_FOLDER = "shock_filter/geometry"
_OF_ONE_OBJECT = {"vertex_group"}


class SHOCK_FILTER_PT_geometry_presets(PresetPanel, bpy.types.Panel):
    """The list that the header's button opens."""

    bl_label = "Geometry Presets"
    preset_subdir = _FOLDER
    preset_operator = "script.execute_preset"
    preset_add_operator = "shock_filter.geometry_preset_add"


class SHOCK_FILTER_OT_geometry_preset_add(AddPresetBase, bpy.types.Operator):
    """Add or remove a preset of the settings for geometry"""

    bl_idname = "shock_filter.geometry_preset_add"
    bl_label = "Add Geometry Preset"
    preset_menu = "SHOCK_FILTER_PT_geometry_presets"
    preset_subdir = _FOLDER
    preset_defines = ["settings = bpy.context.scene.shock_filter.geometry"]
    preset_values = [f"settings.{name}" for name in GEOMETRY_NAMES if name not in _OF_ONE_OBJECT]


CLASSES = (SHOCK_FILTER_PT_geometry_presets, SHOCK_FILTER_OT_geometry_preset_add)
