# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets in the panel's header."""

import pathlib

import bpy
import pytest


@pytest.mark.parametrize(
    ("mode", "of_one_object"),
    [
        ("geometry", "vertex_group"),
        ("colors", "attribute"),
        ("image", None),
        ("texture", "mask_image"),
    ],
)
def test_a_preset_brings_the_settings_back(mode, of_one_object):
    settings = getattr(bpy.context.scene.shock_filter, mode)
    settings.time = 7.0
    settings.sampling = "nearest"
    if of_one_object:
        setattr(settings, of_one_object, "Of another object")
    add = getattr(bpy.ops.shock_filter, f"{mode}_preset_add")
    assert add(name="Seven") == {"FINISHED"}
    for name in filter(None, ("time", "sampling", of_one_object)):
        settings.property_unset(name)

    (folder,) = bpy.utils.preset_paths(f"shock_filter/{mode}")
    bpy.ops.script.execute_preset(
        filepath=f"{folder}/Seven.py", menu_idname=f"SHOCK_FILTER_PT_{mode}_presets"
    )
    assert settings.time == 7.0
    assert settings.sampling == "nearest"
    if of_one_object:
        assert getattr(settings, of_one_object) == ""

    add(name="Seven", remove_name=True)
    assert not pathlib.Path(folder, "Seven.py").exists()
