# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender properties made from the core's settings."""

import math
from types import SimpleNamespace

import bpy
import pytest
from shock_filter.core import (
    BeltramiGeometrySettings,
    BeltramiMeshSettings,
    BeltramiSettings,
    DilateSettings,
    GeometrySettings,
    ImageSettings,
    ShockSettings,
    TextureSettings,
)
from shock_filter.core.settings import describe
from shock_filter.shock_addon.modes import MODES as MODES_OF_OPERATORS
from shock_filter.shock_addon.modes import find
from shock_filter.shock_addon.operators import properties

SETTINGS = describe(GeometrySettings)
MODES = {
    "geometry": GeometrySettings,
    "colors": ShockSettings,
    "image": ImageSettings,
    "texture": TextureSettings,
}
EACH = [(mode, name) for mode, settings in MODES.items() for name in describe(settings)]


def panel_settings(mode="geometry"):
    return getattr(bpy.context.scene.shock_filter, mode)


def values(**changes):
    defaults = {name: default for name, (_, default, _) in SETTINGS.items()}
    return SimpleNamespace(**{**defaults, "steady_state": False, **changes})


@pytest.mark.parametrize(("mode", "name"), EACH)
def test_each_setting_is_a_property_of_panel_and_operator(mode, name):
    kind, default, about = describe(MODES[mode])[name]
    operator = getattr(bpy.ops.shock_filter, f"sharpen_{mode}").get_rna_type()
    for owner in (panel_settings(mode).bl_rna, operator):
        shown = owner.properties[name]
        assert shown.type == {float: "FLOAT", int: "INT", str: "ENUM"}[kind]
        assert shown.default == (default if kind is not float else pytest.approx(default))
        assert shown.description.startswith(about.description.rstrip("."))
        if kind is str:
            assert list(shown.enum_items.keys()) == list(about.choices)
        else:
            assert shown.hard_min == pytest.approx(about.minimum)
            if math.isfinite(about.maximum):
                assert shown.hard_max == pytest.approx(about.maximum)


DENOISING = [
    ("denoise", "", BeltramiGeometrySettings),
    ("denoise", "color_", BeltramiMeshSettings),
    ("denoise_image", "", BeltramiSettings),
]


@pytest.mark.parametrize(("mode", "prefix", "settings"), DENOISING)
def test_denoising_has_all_settings_with_their_defaults(mode, prefix, settings):
    operator = getattr(bpy.ops.shock_filter, mode).get_rna_type()
    for name, (kind, default, about) in describe(settings).items():
        for owner in (panel_settings(mode).bl_rna, operator):
            shown = owner.properties[prefix + name]
            assert shown.default == (default if kind is not float else pytest.approx(default))
            assert shown.description.startswith(about.description)
    assert properties.settings_from(settings, panel_settings(mode), prefix) == settings()
    assert "steady_state" not in operator.properties


@pytest.mark.parametrize("mode", MODES)
def test_untouched_properties_give_the_default_settings(mode):
    read = properties.settings_from(MODES[mode], panel_settings(mode))
    assert read == MODES[mode]()


def test_dilation_has_its_settings_among_those_of_textures():
    names = set(bpy.ops.shock_filter.dilate_texture.get_rna_type().properties.keys())
    kept = set(panel_settings("texture").bl_rna.properties.keys())
    assert set(describe(DilateSettings)) <= set(find("dilate").names) <= names & kept


def test_numbers_come_back_as_they_were_typed():
    settings = panel_settings()
    settings.feature_threshold = 0.1
    settings.max_displacement = 0.3
    read = properties.settings_from(GeometrySettings, settings)
    assert read.feature_threshold == 0.1
    assert read.max_displacement == 0.3


@pytest.mark.parametrize("name", [n for n, (kind, _, _) in SETTINGS.items() if kind is not str])
def test_both_ends_of_each_range_are_valid(name):
    _, _, about = SETTINGS[name]
    for end in (about.minimum, about.maximum):
        if math.isfinite(end):
            settings = panel_settings()
            setattr(settings, name, end)
            read = properties.settings_from(GeometrySettings, settings)
            assert getattr(read, name) == pytest.approx(end)
            settings.property_unset(name)


def test_steady_state_is_an_infinite_time():
    assert properties.settings_from(GeometrySettings, values(steady_state=True)).time == math.inf


@pytest.mark.parametrize(("mode", "step"), [("geometry", 16.0), ("image", 40.97)])
def test_a_click_changes_the_time_by_a_part_of_the_default(mode, step):
    time = getattr(bpy.context.scene.shock_filter, mode).bl_rna.properties["time"]
    assert time.step / 100 == pytest.approx(step)
    assert time.precision == 1


@pytest.mark.parametrize("mode", MODES_OF_OPERATORS, ids=lambda mode: mode.key)
def test_no_property_takes_the_place_of_what_an_operator_does(mode):
    (operator,) = (
        each
        for each in bpy.types.Operator.__subclasses__()
        if getattr(each, "bl_idname", "") == f"shock_filter.{mode.operator}"
    )
    methods = {name for each in operator.__mro__[1:-1] for name in vars(each)}
    assert not methods.intersection(operator.__annotations__)
