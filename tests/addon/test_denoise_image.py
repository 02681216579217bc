# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator Denoise Image."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from shock_filter.shock_addon.data.image import images as image_data
from shock_filter.shock_addon.operators import base as operators
from shock_filter.shock_addon.ui import panels

denoise = bpy.ops.shock_filter.denoise_image


def add(name="Photo", noise=0.05, float_buffer=True, opacity=1.0):
    """Add an image of a step with noise; return it, and its pixels."""
    pixels = np.full((32, 48, 4), opacity, dtype=np.float32)
    pixels[..., :3] = np.where(np.arange(48) < 24, 0.2, 0.8)[:, None]
    pixels[..., :3] += noise * np.random.default_rng(0).normal(size=(32, 48, 3))
    image = bpy.data.images.new(name, 48, 32, alpha=True, float_buffer=float_buffer)
    image.pixels.foreach_set(pixels.reshape(-1))
    image.update()
    return image, image_data.read_pixels(image)


def spread(pixels):
    """Standard deviation on both sides of the step."""
    return max(pixels[:, side, :3].std() for side in (slice(2, 22), slice(26, 46)))


@pytest.mark.parametrize("float_buffer", [False, True])
def test_noise_falls_and_the_edge_stays(float_buffer):
    image, before = add(float_buffer=float_buffer)
    assert denoise(image="Photo") == {"FINISHED"}
    result = bpy.data.images["Photo denoised"]
    after = image_data.read_pixels(result)
    assert result.is_float == float_buffer
    assert spread(after) < spread(before) / 3
    assert (after[:, 24, 0] - after[:, 23, 0]).min() > 0.45
    np.testing.assert_array_equal(image_data.read_pixels(image), before)
    assert operators.summaries["denoise_image"].startswith(
        "Denoised the image Photo into Photo denoised: 1,536 pixels, changed "
    )


def test_time_zero_changes_no_bit():
    image, before = add(opacity=0.5)
    assert denoise(image="Photo", time=0.0, output="REPLACE") == {"FINISHED"}
    assert image_data.read_pixels(image).tobytes() == before.tobytes()


def test_opacity_stays():
    image, before = add(opacity=0.5)
    denoise(image="Photo", output="REPLACE")
    after = image_data.read_pixels(image)
    np.testing.assert_array_equal(after[..., 3], before[..., 3])
    assert (after[..., :3] != before[..., :3]).any()


def test_sharpening_follows():
    image, before = add()
    denoise(image="Photo", output="REPLACE")
    bpy.ops.shock_filter.sharpen_image(image="Photo", output="REPLACE", time=64.0)
    apart = image_data.read_pixels(image)
    image.pixels.foreach_set(before.reshape(-1))
    words = {"image": "Photo", "output": "REPLACE", "sharpen_time": 64.0}
    assert denoise(then_sharpen=True, **words) == {"FINISHED"}
    np.testing.assert_allclose(image_data.read_pixels(image), apart, atol=1e-5)
    assert operators.summaries["denoise_image"].startswith("Denoised and sharpened the image Photo")
    image.pixels.foreach_set(before.reshape(-1))
    denoise(**words)
    assert np.abs(image_data.read_pixels(image) - apart).max() > 1e-3


def test_the_named_image_must_be_there_and_hold_numbers():
    with pytest.raises(RuntimeError, match="poll"):
        denoise()
    image, before = add()
    with pytest.raises(RuntimeError, match="There is no image named 'Nobody'"):
        denoise(image="Nobody")
    before[0, 0, 0] = np.nan
    image.pixels.foreach_set(before.reshape(-1))
    with pytest.raises(RuntimeError, match="NaN or infinity"):
        denoise(image="Photo")
    assert "Photo denoised" not in bpy.data.images


def test_cancelling_changes_nothing(monkeypatch):
    image, before = add()
    monkeypatch.setattr(operators, "listener", lambda fraction, message: fraction < 0.2)
    assert denoise(image="Photo", output="REPLACE") == {"CANCELLED"}
    np.testing.assert_array_equal(image_data.read_pixels(image), before)


def test_undo_takes_the_new_image_away():
    add()
    bpy.ops.ed.undo_push(message="Before")
    denoise(image="Photo")
    bpy.ops.ed.undo_push(message="After")
    assert "Photo denoised" in bpy.data.images
    bpy.ops.ed.undo()
    assert "Photo denoised" not in bpy.data.images


@pytest.mark.parametrize("float_buffer", [False, True])
def test_undo_of_replace_keeps_what_was_painted_before(float_buffer):
    image, before = add(float_buffer=float_buffer)
    image.pack()
    bpy.ops.ed.undo_push(message="Packed")
    painted = before.copy()
    painted[8:16, 8:16, :3] = 1.0
    image.pixels.foreach_set(painted.reshape(-1))
    image.update()
    bpy.ops.ed.undo_push(message="Painted")
    painted = image_data.read_pixels(image)
    denoise(image="Photo", output="REPLACE")
    bpy.ops.ed.undo_push(message="Denoised")
    result = image_data.read_pixels(image)
    assert abs(result - painted).max() > 0.05
    bpy.ops.ed.undo()
    np.testing.assert_allclose(image_data.read_pixels(bpy.data.images["Photo"]), painted, atol=1e-6)
    bpy.ops.ed.redo()
    np.testing.assert_allclose(image_data.read_pixels(bpy.data.images["Photo"]), result, atol=1e-6)


def test_the_image_editor_has_the_mode():
    scene = bpy.context.scene
    scene.shock_filter.image_mode = "DENOISE_IMAGE"
    context = SimpleNamespace(
        scene=scene, mode="OBJECT", object=None, selected_objects=[], space_data=None
    )
    main = panels.SHOCK_FILTER_PT_image_main
    assert main.mode(context).key == "denoise_image"
    assert main.settings(context) == scene.shock_filter.denoise_image
    shown = list(main.mode(context).targets[0].fields)
    assert shown[:3] == ["time", "beta", "iterations"]
    assert bpy.types.SHOCK_FILTER_PT_image_output.poll(context)
    assert not bpy.types.SHOCK_FILTER_PT_image_mask.poll(context)
