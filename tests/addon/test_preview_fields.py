# SPDX-License-Identifier: GPL-3.0-or-later
"""Previews of Generate: at a low resolution, drawn on the surface, and nothing is changed."""

import time

import bpy
import numpy as np
import pytest
from shock_filter.core.host.fields import reduced_settings
from shock_filter.core.settings import ReactionSettings, StreakSettings
from shock_filter.shock_addon.data.image import images as image_data
from shock_filter.shock_addon.data.skipped import Refused
from shock_filter.shock_addon.modes import find
from shock_filter.shock_addon.preview import coat, fields

generate = bpy.ops.shock_filter.generate


@pytest.fixture
def settings():
    """A sheet of 64 quads whose left side is selected, and the panel's settings."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=8, y_subdivisions=8, calc_uvs=True)
    mesh = bpy.context.object.data
    for elements in (mesh.vertices, mesh.edges, mesh.polygons):
        elements.foreach_set("select", [False] * len(elements))
    for edge in mesh.edges:
        edge.select = all(mesh.vertices[v].co.x < -0.99 for v in edge.vertices)
    chosen = bpy.context.scene.shock_filter.generate
    chosen.image_size = "512"
    return chosen


@pytest.fixture
def begun():
    """Begin previews, and end them."""
    previews = []

    def begin():
        previews.append(fields.begin(bpy.context, None, find("generate")))
        return previews[-1]

    yield begin
    for preview in previews:
        preview.end()


def shown(preview):
    """Tick until the newest settings are shown; return the values that are drawn."""
    for _ in range(6000):
        preview.tick()
        if not preview.is_computing:
            return preview.stage._coat._values
        time.sleep(0.01)
    raise AssertionError("The preview did not settle.")


def data_blocks():
    """All that a file would keep."""
    return [set(each.keys()) for each in (bpy.data.images, bpy.data.materials, bpy.data.meshes)]


@pytest.mark.parametrize("target", ["distance", "streaks", "pattern"])
def test_what_is_drawn_is_what_a_run_makes_but_smaller(settings, begun, target):
    settings.target = target
    settings.streak_length, settings.streak_width = 200.0, 20.0
    settings.pattern_scale, settings.pattern_steps = 64.0, 200
    before = data_blocks()
    preview = begun()
    values = shown(preview)
    assert data_blocks() == before
    assert max(values.shape) == (192 if target == "pattern" else 256)
    assert preview.stage.note in preview.text() and preview.stage.note
    assert values.min() >= 0
    assert values.max() <= 1
    assert values.std() > 0.1
    preview.end()
    names = {name: getattr(settings, name) for name in find("generate").names}
    assert generate(**names) == {"FINISHED"}
    made = image_data.read_pixels(bpy.data.images[-1])[..., 0]
    if target == "distance":
        step = len(made) // len(values)
        coarse = made.reshape(len(values), step, len(values), step).mean(axis=(1, 3))
        assert np.abs(coarse - values).max() < 0.01
    else:  # other noise of the same kind
        assert abs(_wavelength(made) - _wavelength(values)) < 0.25 * _wavelength(made)
        assert abs(made.mean() - values.mean()) < 0.1


def _wavelength(values):
    """The mean one, in parts of the image."""
    power = np.abs(np.fft.rfft2(values - values.mean())) ** 2
    rows, columns = np.fft.fftfreq(len(values)), np.fft.rfftfreq(len(values))
    places = np.hypot(rows[:, None], columns) * len(values)
    return power.sum() / (power * places).sum()


@pytest.mark.parametrize(
    ("target", "dial", "second", "least"),
    [
        ("distance", "width", "smoothing", 0.0),
        ("streaks", "streak_length", "streak_width", 1.0),
        ("pattern", "pattern_scale", "pattern_seed", 6.0),
    ],
)
def test_mouse_and_wheel_turn_what_each_target_has(settings, begun, target, dial, second, least):
    settings.target = target
    setattr(settings, dial, 20.0)
    preview = begun()
    before = vars(preview.parameters).copy()
    preview.drag(-20)
    preview.roll(1)
    now = vars(preview.parameters)
    assert {name for name in now if now[name] != before[name]} == {dial, second}
    preview.drag(-9999)
    assert getattr(preview.parameters, dial) == least
    assert "Streak" not in preview.text()
    assert "Pattern" not in preview.text()


def test_a_painted_start_is_read_at_the_low_resolution(settings, begun):
    image = bpy.data.images.new("Start", 512, 512)
    pixels = np.zeros((512, 512, 4), dtype=np.float32)
    pixels[:, :8] = 1.0
    image.pixels.foreach_set(pixels.reshape(-1))
    settings.start, settings.start_image = "IMAGE", "Start"
    values = shown(begun())
    assert np.abs(values - np.linspace(1, 0, 256)).max() < 0.05


def test_before_and_after_and_what_is_lost(settings, begun):
    preview = begun()
    values = shown(preview)
    preview.compare()
    assert preview.stage._coat._values is None
    preview.compare()
    assert preview.stage._coat._values is values
    assert preview.stage.lost() == ""
    bpy.data.objects.remove(bpy.context.object)
    assert preview.stage.lost() == "an object was removed"


def test_what_cannot_be_read_is_named(settings):
    settings.start, settings.start_group = "GROUP", "None"
    with pytest.raises(Refused, match="no vertex group"):
        fields.begin(bpy.context, None, find("generate"))


def test_texels_are_counted_anew_and_steps_are_few():
    long = reduced_settings(StreakSettings(length=40.0, width=2.0), (1024, 512), (256, 128))
    assert (long.length, long.width, long.contrast) == (10.0, 0.5, 1.0)
    pattern = reduced_settings(ReactionSettings(scale=12.0, steps=2000), (1024, 1024), (192, 192))
    assert (pattern.scale, pattern.steps) == (6.0, 500)


def test_corners_of_faces_are_drawn(settings, begun):
    corners = coat._corners(begun().stage._surface.faces)
    assert {name: each.shape for name, each in corners.items()} == {
        "position": (384, 3),
        "normal": (384, 3),
        "corner": (384, 2),
    }
    assert np.allclose(np.abs(corners["normal"]), [0, 0, 1])
