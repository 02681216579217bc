# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets in the panel's header."""

import pathlib

import bpy
import pytest


def test_a_preset_of_denoising_brings_the_settings_back():
    settings = bpy.context.scene.shock_filter.denoise
    settings.target, settings.then_sharpen, settings.color_beta = "both", True, 4.0
    settings.vertex_group = "Of another object"
    assert bpy.ops.shock_filter.denoise_preset_add(name="Four") == {"FINISHED"}
    for name in ("target", "then_sharpen", "color_beta", "vertex_group"):
        settings.property_unset(name)
    (folder,) = bpy.utils.preset_paths("shock_filter/denoise")
    bpy.ops.script.execute_preset(
        filepath=f"{folder}/Four.py", menu_idname="SHOCK_FILTER_PT_denoise_presets"
    )
    found = settings.target, settings.then_sharpen, settings.color_beta, settings.vertex_group
    assert found == ("both", True, 4.0, "")


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
