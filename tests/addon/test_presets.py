# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets in the panel's header."""

import os
import pathlib
from types import SimpleNamespace

import bpy
import pytest
from shock_filter.shock_addon.modes import choices, find
from shock_filter.shock_addon.ui import presets

KEYS = [mode.key for mode in choices()]


@pytest.fixture(autouse=True)
def labels(monkeypatch):
    """Bring back the labels, which Blender replaces by the name of the last preset."""
    for key in KEYS:
        panel = getattr(bpy.types, f"SHOCK_FILTER_PT_{key}_presets")
        monkeypatch.setattr(panel, "bl_label", panel.bl_label)


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


OUTPUTS = {"colors": "LIVE"}
"""Of modes that have none of the others."""

CHOICES = [(mode.key, preset) for mode in choices() for preset in mode.presets]


def test_each_mode_has_shipped_presets():
    for mode in choices():
        shipped = mode.presets
        assert len({preset.name for preset in shipped}) == len(shipped) >= 1
        for preset in shipped:
            assert preset.reason.startswith("For ")
            assert not preset.reason.endswith(".")


@pytest.mark.parametrize(("mode", "preset"), CHOICES, ids=lambda part: getattr(part, "name", part))
def test_a_shipped_preset_sets_the_filter_and_nothing_else(mode, preset):
    settings = getattr(bpy.context.scene.shock_filter, mode)
    everything = find(mode).filter_names
    assert preset.values.keys() <= set(everything)
    others = {name: getattr(settings, name) for name in everything}
    settings.time = 77.0
    kept = {
        "vertex_group": "Kept",
        "output": OUTPUTS.get(mode, "SHAPE_KEY" if "weld" in find(mode).names else "REPLACE"),
    }
    kept = {name: value for name, value in kept.items() if name in find(mode).names}
    for name, value in kept.items():
        setattr(settings, name, value)

    assert bpy.ops.shock_filter.use_preset(mode=mode, name=preset.name) == {"FINISHED"}

    found = {name: getattr(settings, name) for name in everything}
    assert found != others
    assert found == pytest.approx({**others, **preset.values})
    assert {name: getattr(settings, name) for name in kept} == kept


@pytest.mark.parametrize("mode", KEYS)
def test_the_first_preset_is_the_defaults(mode):
    settings = getattr(bpy.context.scene.shock_filter, mode)
    defaults = {name: getattr(settings, name) for name in find(mode).filter_names}
    settings.time = 77.0
    assert bpy.ops.shock_filter.use_preset(mode=mode, name="Defaults") == {"FINISHED"}
    assert {name: getattr(settings, name) for name in find(mode).filter_names} == defaults


def test_a_preset_that_is_not_there_is_named():
    with pytest.raises(RuntimeError, match=r"'Nine'; choose one of: Defaults, Subtle, Crisp"):
        bpy.ops.shock_filter.use_preset(mode="geometry", name="Nine")


@pytest.mark.parametrize(
    ("mode", "name", "values"),
    [
        ("denoise", "As in the Paper", {"method": "beltrami"}),
        ("geometry", "Remeshed Hard Surface", {"align_passes": 3, "fit_steps": 25}),
        ("geometry", "As in the Paper", {"where": "everywhere", "align_passes": 0, "fit_steps": 1}),
    ],
)
def test_scripts_may_name_presets_that_are_not_offered_any_more(mode, name, values):
    assert name not in {preset.name for preset in find(mode).presets}
    assert bpy.ops.shock_filter.use_preset(mode=mode, name=name) == {"FINISHED"}
    settings = getattr(bpy.context.scene.shock_filter, mode)
    assert {each: getattr(settings, each) for each in values} == values


def test_a_preset_of_a_person_is_named_until_something_changes():
    settings = bpy.context.scene.shock_filter.image
    settings.amount = 0.3
    assert presets.shown_name(find("image"), settings) == "Custom"
    bpy.ops.shock_filter.image_preset_add(name="Mine")
    (folder,) = bpy.utils.preset_paths("shock_filter/image")
    bpy.ops.script.execute_preset(
        filepath=f"{folder}/Mine.py", menu_idname="SHOCK_FILTER_PT_image_presets"
    )
    assert presets.shown_name(find("image"), settings) == "Mine"
    settings.amount = 0.4
    assert presets.shown_name(find("image"), settings) == "Custom"
    bpy.ops.shock_filter.use_preset(mode="image", name="Subtle")
    assert presets.shown_name(find("image"), settings) == "Subtle"
    settings.amount = 0.3
    bpy.ops.shock_filter.image_preset_add(name="Mine", remove_name=True)
    assert presets.shown_name(find("image"), settings) == "Custom"


def test_presets_leave_out_where_frames_and_directions_of_an_object_are():
    assert not {"folder", "field"} & set(presets.kept(find("visualize")))


def test_the_tooltip_says_the_reason():
    properties = SimpleNamespace(mode="colors", name="Subtle")
    found = presets.CLASSES[0].description(bpy.context, properties)
    assert found == find("colors").presets[0].reason


def test_nothing_is_written_into_the_persons_folder():
    written = list(pathlib.Path(os.environ["BLENDER_USER_RESOURCES"]).rglob("*.py"))
    names = {preset.name.replace(" ", "_") for _, preset in CHOICES}
    assert not names & {path.stem for path in written}
