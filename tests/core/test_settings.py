# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings refuse what the filters cannot do, and say why."""

import copy
import dataclasses
import math
import pickle
import subprocess
import sys

import numpy as np
import pytest
from shock_filter import core
from shock_filter.core.settings import describe, removed_of

CLASSES = [
    core.ShockSettings,
    core.FitSettings,
    core.GeometrySettings,
    core.BeltramiSettings,
    core.BeltramiMeshSettings,
    core.BeltramiGeometrySettings,
    core.NoiseSettings,
    core.DyeSettings,
    core.ConvolutionSettings,
]


@pytest.mark.parametrize("settings", CLASSES)
def test_every_field_is_described(settings):
    described = describe(settings)
    assert list(described) == [field.name for field in dataclasses.fields(settings)]
    for name, (kind, default, about) in described.items():
        assert getattr(settings(), name) == default
        assert type(default) is kind
        assert about.description[0].isupper()
        assert not about.description.endswith(".")
        if kind is str:
            assert default in about.choices
        else:
            assert about.unit or name == "seed"  # which tells apart, and measures nothing
            assert about.minimum <= default <= about.maximum
            assert about.minimum <= max(about.soft_minimum, about.minimum)
            assert about.soft_maximum <= about.maximum
            settings(**{name: about.minimum})
            settings(**{name: about.maximum})


@pytest.mark.parametrize("settings", CLASSES)
def test_values_beyond_the_range_are_refused(settings):
    for name, (kind, _, about) in describe(settings).items():
        if kind is str:
            with pytest.raises(core.InvalidSettings, match=f"{name} is 'blurry'; choose one of"):
                settings(**{name: "blurry"})
            continue
        beyond = [about.minimum - 1]
        if math.isfinite(about.maximum):
            beyond.append(about.maximum + 1)
        for value in beyond:
            with pytest.raises(core.InvalidSettings, match=f"{name} is .* give a value from"):
                settings(**{name: value})


@pytest.mark.parametrize(
    "value", [math.nan, True, False, None, "64", [1.0], np.array([1.0]), np.bool_(True), 1j]
)
@pytest.mark.parametrize("name", ["time", "smoothing_passes"])
def test_no_numbers_are_refused(name, value):
    with pytest.raises(core.InvalidSettings, match=name):
        core.GeometrySettings(**{name: value})


@pytest.mark.parametrize("value", [1.5, math.inf, np.float32(0.5)])
def test_counts_must_be_whole(value):
    with pytest.raises(core.InvalidSettings, match=r"smoothing_passes is .* whole number"):
        core.GeometrySettings(smoothing_passes=value)


@pytest.mark.parametrize("value", [2, 2.0, np.int64(2), np.uint8(2), np.float32(2), np.array(2)])
def test_numbers_become_plain_python_numbers(value):
    settings = core.GeometrySettings(smoothing_passes=value, time=value)
    assert (settings.smoothing_passes, type(settings.smoothing_passes)) == (2, int)
    assert (settings.time, type(settings.time)) == (2.0, float)


def test_huge_numbers_are_refused_like_others():
    with pytest.raises(core.InvalidSettings, match="repeat"):
        core.GeometrySettings(repeat=10**400)


@pytest.mark.parametrize(
    ("settings", "name", "value", "instead"),
    [
        (core.ShockSettings, "scheme", "composed", "the flow is that of the input"),
        (core.ImageSettings, "scheme", "fixed", "leave it out"),
        (core.FitSettings, "fidelity", 100.0, "give screening_radius"),
        (core.GeometrySettings, "fidelity", 0.0, "give screening_radius"),
        (core.BeltramiMeshSettings, "distance", "euclidean", "leave it out"),
        (core.BeltramiGeometrySettings, "threshold", 0.1, "leave it out"),
        (core.BeltramiSettings, "measure", "surface", "leave it out"),
        (core.BeltramiTextureSettings, "window", 5, "the time alone"),
        (core.DyeSettings, "sharpening", "rational", "leave it out"),
        (core.DyeSettings, "integration", "euler", "leave it out"),
    ],
)
def test_former_settings_are_refused_with_what_holds_instead(settings, name, value, instead):
    with pytest.raises(core.InvalidSettings, match=f"{name} is no setting any more: .*{instead}"):
        settings(**{name: value})


def test_what_was_never_a_setting_is_a_type_error():
    with pytest.raises(TypeError, match="GeometrySettings has no setting 'scheme'"):
        core.GeometrySettings(scheme="fixed")


def test_former_names_are_taken_by_no_setting_of_today():
    for settings in CLASSES:
        assert not removed_of(settings).keys() & describe(settings).keys()
        assert all(text.endswith(".") for text in removed_of(settings).values())


def test_time_may_be_endless():
    assert core.GeometrySettings(time=math.inf).time == math.inf


def test_settings_are_frozen_and_comparable():
    settings = core.GeometrySettings(time=16)
    with pytest.raises(dataclasses.FrozenInstanceError):
        settings.time = 3
    with pytest.raises(dataclasses.FrozenInstanceError):
        settings.tyme = 3
    with pytest.raises(dataclasses.FrozenInstanceError):
        del settings.time
    assert settings == dataclasses.replace(core.GeometrySettings(), time=16.0)
    assert hash(settings) == hash(core.GeometrySettings(time=16.0))
    assert settings not in (core.GeometrySettings(), core.ImageSettings(), 16.0)
    assert repr(settings).startswith("GeometrySettings(time=16.0, smoothing_passes=1, ")
    assert eval(repr(settings), {"GeometrySettings": core.GeometrySettings}) == settings
    assert pickle.loads(pickle.dumps(settings)) == copy.deepcopy(settings) == settings
    with pytest.raises(TypeError):
        core.GeometrySettings(64.0)


def test_bad_settings_are_shock_errors_and_value_errors():
    with pytest.raises(core.ShockError):
        core.GeometrySettings(time=-1)
    with pytest.raises(ValueError, match="time"):
        core.GeometrySettings(time=-1)


def test_settings_load_without_numerics():
    code = (
        "import sys; from shock_filter import core; core.GeometrySettings(time=3);"
        "print(sorted({'numpy', 'numba', 'scipy', 'trimesh'} & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert run.stdout.strip() == "[]", run.stderr


def test_what_is_no_settings_is_refused_by_name():
    image = np.zeros((3, 3))
    for wrong in ("strong", {}, 0, core.DilateSettings()):
        with pytest.raises(core.InvalidSettings, match="give ImageSettings, or leave it out"):
            core.sharpen_image(image, wrong)
    with pytest.raises(core.InvalidMesh, match="give a TriangleMesh"):
        core.sharpen_vertex_signal(None, image)
