# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets in the panel's header."""

import pathlib

import bpy


def test_a_preset_brings_the_settings_back():
    settings = bpy.context.scene.shock_filter.geometry
    settings.time = 7.0
    settings.sampling = "linear"
    settings.vertex_group = "Of another object"
    assert bpy.ops.shock_filter.geometry_preset_add(name="Seven") == {"FINISHED"}
    for name in ("time", "sampling", "vertex_group"):
        settings.property_unset(name)

    (folder,) = bpy.utils.preset_paths("shock_filter/geometry")
    bpy.ops.script.execute_preset(
        filepath=f"{folder}/Seven.py", menu_idname="SHOCK_FILTER_PT_geometry_presets"
    )
    assert settings.time == 7.0
    assert settings.sampling == "linear"
    assert settings.vertex_group == ""

    bpy.ops.shock_filter.geometry_preset_add(name="Seven", remove_name=True)
    assert not pathlib.Path(folder, "Seven.py").exists()
