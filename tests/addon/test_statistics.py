# SPDX-License-Identifier: GPL-3.0-or-later
"""What the statistics count, and what they expect of a run."""

from types import SimpleNamespace

import bpy
import pytest
from shock_filter.core.estimate import Estimate, estimate, wall_seconds
from shock_filter.core.settings import (
    BeltramiGeometrySettings,
    GeometrySettings,
    ImageSettings,
    ShockSettings,
)
from shock_filter.shock_addon.operators import statistics
from shock_filter.shock_addon.operators.properties import NAMES
from shock_filter.shock_addon.operators.statistics import Counts


@pytest.fixture(autouse=True)
def nothing_learned():
    """Start without a history."""
    statistics.forget()
    yield
    statistics.forget()


def settings_of(mode):
    return getattr(bpy.context.scene.shock_filter, mode)


def count(mode, context=None):
    return statistics.count(context or bpy.context, mode, settings_of(mode))


def test_a_mesh_with_several_users_counts_once(rounded_box, select):
    box = rounded_box(cuts=3)
    other = box.copy()
    bpy.context.collection.objects.link(other)
    third = rounded_box(cuts=1)
    assert count("geometry") == Counts(meshes=1, vertices=26, faces=24)
    select(box, other, third)
    assert count("geometry") == Counts(meshes=2, vertices=98 + 26, faces=96 + 24)


def test_empty_meshes_do_not_count(rounded_box, select):
    box, other = rounded_box(cuts=1), rounded_box(cuts=1)
    other.data.clear_geometry()
    other.data.from_pydata([(0, 0, 0)], [], [])
    select(box, other)
    assert count("geometry") == Counts(meshes=1, vertices=26, faces=24)


def test_images_count_their_pixels():
    image = bpy.data.images.new("Photo", 30, 20)
    editor = SimpleNamespace(type="IMAGE_EDITOR", image=image)
    assert count("image", SimpleNamespace(space_data=editor)) == Counts(pixels=600)


def test_textures_count_the_pixels_of_what_is_shown(rounded_box):
    rounded_box(cuts=1)
    assert count("texture").size == 0
    bpy.data.images.new("Paint", 30, 20)
    settings_of("texture").image = "Paint"
    assert count("texture") == Counts(meshes=1, vertices=26, faces=24, pixels=600)


def test_nothing_is_expected_of_nothing():
    assert count("geometry") == Counts()
    assert statistics.expected("geometry", settings_of("geometry"), 0) is None


def test_settings_that_clash_give_no_estimate():
    settings = settings_of("colors")
    settings.scheme, settings.steady_state = "composed", True
    assert statistics.expected("colors", settings, 1000) is None


@pytest.mark.parametrize("mode", NAMES)
def test_each_mode_has_an_estimate_that_grows_with_the_size(mode):
    small, large = (
        statistics.expected(mode, settings_of(mode), size) for size in (10_000, 1_000_000)
    )
    assert large.seconds == pytest.approx(100 * small.seconds)
    assert large.memory == pytest.approx(100 * small.memory)
    assert 0.02 < large.seconds < 600
    assert 10e6 < large.memory < 5e9


@pytest.mark.parametrize("target", ["geometry", "colors", "both"])
def test_sharpening_after_denoising_takes_longer(target):
    settings = settings_of("denoise")
    settings.target = target
    once = statistics.expected("denoise", settings, 100_000)
    settings.then_sharpen = True
    assert statistics.expected("denoise", settings, 100_000).seconds > once.seconds


def test_more_work_takes_longer():
    def seconds(settings):
        return estimate(settings, 100_000).seconds

    once = seconds(GeometrySettings())
    assert seconds(GeometrySettings(repeat=3)) == pytest.approx(3 * once)
    assert seconds(GeometrySettings(time=float("inf"))) > once
    assert seconds(GeometrySettings(time=0.0)) < once
    assert seconds(ShockSettings(scheme="composed")) > 10 * seconds(ShockSettings())
    assert seconds(ImageSettings(smoothing_passes=9)) > seconds(ImageSettings())
    reach = seconds(BeltramiGeometrySettings(threshold=0.001))
    assert reach > seconds(BeltramiGeometrySettings())


def test_cores_help_up_to_eight():
    assert wall_seconds(8.0, 2) == 4.0
    assert wall_seconds(8.0, 64) == wall_seconds(8.0, 8) == 1.0


def run(seconds, size=1_000_000, mode="geometry", operator="sharpen_geometry"):
    """Pretend that an operator has taken this long."""
    operator = SimpleNamespace(
        bl_idname=f"SHOCK_FILTER_OT_{operator}",
        targets=[SimpleNamespace(surface=SimpleNamespace(size=size))],
        **{name: getattr(settings_of(mode), name) for name in NAMES[mode]},
    )
    statistics.learn(operator, seconds)


def corrected(seconds, mode="geometry"):
    return statistics.corrected(mode, settings_of(mode), seconds)


def last_seconds(mode):
    return statistics.last_seconds(mode, settings_of(mode))


def test_the_second_run_corrects_the_estimate():
    guess = statistics.expected("geometry", settings_of("geometry"), 1_000_000).seconds
    assert corrected(1.0) == 1.0
    run(40.0)  # compiles
    assert corrected(1.0) == 1.0
    assert last_seconds("geometry") == 40.0
    run(3.0 * guess)
    assert corrected(1.0) == pytest.approx(3.0)
    assert corrected(0.5) == pytest.approx(1.5)
    run(0.01, size=10)  # says nothing
    assert corrected(1.0) == pytest.approx(3.0)
    assert last_seconds("colors") is None


def test_each_target_of_denoise_is_corrected_by_its_own_runs():
    settings = settings_of("denoise")
    settings.target = "colors"
    guess = statistics.expected("denoise", settings, 1_000_000).seconds
    for seconds in (40.0, 3.0 * guess):
        run(seconds, mode="denoise", operator="denoise")
    assert corrected(1.0, "denoise") == pytest.approx(3.0)
    settings.target = "geometry"
    assert corrected(1.0, "denoise") == 1.0
    assert last_seconds("denoise") is None


def test_only_cores_that_the_process_may_use_count(monkeypatch):
    settings = settings_of("geometry")
    monkeypatch.setattr(statistics, "thread_count", lambda: 1)
    one = statistics.expected("geometry", settings, 1000).seconds
    monkeypatch.setattr(statistics, "thread_count", lambda: 4)
    assert statistics.expected("geometry", settings, 1000).seconds == pytest.approx(one / 4)


def test_operators_report_how_long_they_took(rounded_box):
    rounded_box()
    bpy.ops.shock_filter.sharpen_geometry()
    assert last_seconds("geometry") > 0
    assert last_seconds("denoise") is None
    bpy.ops.shock_filter.denoise()
    assert last_seconds("denoise") > 0


def test_other_operators_teach_nothing():
    statistics.learn(SimpleNamespace(bl_idname="SHOCK_FILTER_OT_dilate_texture", targets=[]), 5.0)
    assert last_seconds("texture") is None


class Elements:
    """What can only be asked how many they are: reading millions at each redraw takes too long."""

    def __init__(self, number):
        self.number = number

    def __len__(self):
        return self.number


@pytest.mark.parametrize("mode", ["geometry", "colors", "denoise"])
def test_counting_does_not_read_the_mesh(mode):
    parts = {"vertices": Elements(1_000_000), "polygons": Elements(2_000_000)}
    mesh = SimpleNamespace(session_uid=1, is_editmode=False, **parts)
    obj = SimpleNamespace(type="MESH", data=mesh)
    context = SimpleNamespace(mode="OBJECT", selected_objects=[obj], object=obj, space_data=None)
    counts = count(mode, context)
    assert counts == Counts(meshes=1, vertices=1_000_000, faces=2_000_000)
    assert isinstance(statistics.expected(mode, settings_of(mode), counts.size), Estimate)
