# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that an earlier version has written, in the folder ``old``, do what they did.

They are from commit 43430e9, before What, Width and Amount and before creases: a blend file whose
scenes have times of 16 and 256 set in the panels, a preset of a panel, one of an operator, and a
script; and what that version made of each. What was never set has the defaults of today.
"""

from pathlib import Path

import bpy
import numpy as np
import pytest
from shock_filter.core import ShockSettings
from shock_filter.core.settings import BY_WIDTH
from shock_filter.shock_addon.data import arrays
from shock_filter.shock_addon.data.mesh.meshes import read_positions
from shock_filter.shock_addon.modes import find

OLD = Path(__file__).with_name("old")
RESULTS = np.load(OLD / "results.npz")
SCENES = ["Time 16", "Time 256"]

IMAGES = {"image": "Photo", "texture": "Wood", "denoise_image": "Photo"}


@pytest.fixture(autouse=True)
def opened():
    """Open the file, as people do, without its window."""
    bpy.ops.wm.open_mainfile(filepath=str(OLD / "settings.blend"), load_ui=False)


def enter(scene, name):
    """Go to a scene, and select one of its objects alone."""
    bpy.context.window.scene = bpy.data.scenes[scene]
    obj = bpy.data.objects[name]
    bpy.ops.object.select_all(action="DESELECT")
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj
    return obj


def rounded(image):
    """Return the bytes of the colors: (number of pixels, 3)."""
    pixels = arrays.read_pixels(image)[..., :3].reshape(-1, 3)
    return np.rint(pixels * 255).astype(np.uint8)


def colors():
    return arrays.read_attribute(bpy.data.objects["Sheet"].data.attributes["Paint"]).reshape(-1)


def press(key):
    """Do what the mode's button does in the panel; return what was made."""
    mode = find(key)
    settings = getattr(bpy.context.scene.shock_filter, key)
    values = {name: getattr(settings, name) for name in mode.names}
    if key in IMAGES:
        values["image"] = IMAGES[key]
    known = set(bpy.data.images)
    assert getattr(bpy.ops.shock_filter, mode.operator)(**values) == {"FINISHED"}
    if key in IMAGES:  # of which there is no copy if nothing has changed
        [new] = set(bpy.data.images) - known or [bpy.data.images[IMAGES[key]]]
        return rounded(new)
    if key == "geometry":
        return read_positions(bpy.context.object.data).reshape(-1)
    return colors()


@pytest.mark.parametrize("scene", SCENES)
def test_settings_are_those_that_were_stored(scene):
    kept = bpy.data.scenes[scene].shock_filter
    for key in ("geometry", "colors", "image", "texture"):
        assert getattr(kept, key).time == float(scene.removeprefix("Time "))
    if scene == "Time 256":
        assert (kept.image.channels, kept.image.smoothing_passes) == ("luminance", 2)
        assert (kept.texture.gutter, kept.denoise.target) == (4, "colors")


@pytest.mark.parametrize("key", ["colors", "image", "texture"])
@pytest.mark.parametrize("scene", SCENES)
def test_a_stored_time_does_what_it_did(scene, key):
    enter(scene, "Sheet")
    wanted = RESULTS[f"{scene} {key}"]
    np.testing.assert_allclose(press(key), wanted, atol=1e-6 if key == "colors" else 0)


@pytest.mark.parametrize("scene", SCENES)
def test_denoising_of_images_does_what_it_did(scene):
    # What keeps edges was 7 where nothing was stored; it follows from the noise today.
    enter(scene, "Sheet")
    settings = bpy.context.scene.shock_filter.denoise_image
    settings.beta = 7.0 if settings.beta < 0 else settings.beta
    np.testing.assert_array_equal(press("denoise_image"), RESULTS[f"{scene} denoise_image"])


def test_denoising_of_colors_does_what_it_did():
    enter("Time 256", "Sheet")
    np.testing.assert_allclose(press("denoise"), RESULTS["Time 256 denoise"], atol=1e-6)


@pytest.mark.parametrize("scene", SCENES)
def test_geometry_does_what_it_did_with_the_filter_of_the_paper(scene):
    # Creases were no choice then: what was not stored is the default of today, which sharpens
    # these only. The preset has the former defaults; it sets a time, so that is set once more.
    wanted = RESULTS[f"{scene} geometry"]
    box = enter(scene, "Box")
    before = read_positions(box.data)
    assert abs(press("geometry") - wanted).max() > 1e-3
    box.data.attributes["position"].data.foreach_set("vector", before.reshape(-1))
    settings = bpy.context.scene.shock_filter.geometry
    time = settings.time
    bpy.ops.shock_filter.use_preset(mode="geometry", name="As in the Paper")
    settings.time = time
    np.testing.assert_allclose(press("geometry"), wanted, atol=1e-5)


def test_what_was_never_set_goes_by_width():
    # The default time was 16 for images and textures and 256 for colors; it is measured now.
    kept = bpy.data.scenes["Untouched"].shock_filter
    for key in ("colors", "image", "texture"):
        assert getattr(kept, key).time == BY_WIDTH == ShockSettings().time


def test_a_preset_of_a_panel_does_what_it_did(monkeypatch):
    panel = bpy.types.SHOCK_FILTER_PT_image_presets
    monkeypatch.setattr(panel, "bl_label", panel.bl_label)  # which then is the preset's
    enter("Untouched", "Sheet")
    bpy.ops.script.execute_preset(
        filepath=str(OLD / "panel_preset.py"), menu_idname="SHOCK_FILTER_PT_image_presets"
    )
    np.testing.assert_array_equal(press("image"), RESULTS["Time 256 image"])


def test_a_preset_of_an_operator_does_what_it_did():
    enter("Untouched", "Sheet")
    bpy.ops.shock_filter.sharpen_texture("EXEC_DEFAULT", True, image="Wood", assign=False)
    operator = bpy.context.window_manager.operators[-1]
    with bpy.context.temp_override(active_operator=operator):
        exec((OLD / "operator_preset.py").read_text(encoding="utf-8"), {})
    values = {
        name: getattr(operator.properties, name)
        for name in operator.properties.keys()  # noqa: SIM118
        if name not in {"image", "result", "assign"}
    }
    known = set(bpy.data.images)
    bpy.ops.shock_filter.sharpen_texture(image="Wood", assign=False, **values)
    [new] = set(bpy.data.images) - known or [bpy.data.images["Wood"]]
    np.testing.assert_array_equal(rounded(new), RESULTS["operator preset"])


def test_a_script_does_what_it_did():
    enter("Untouched", "Sheet")
    exec((OLD / "script.py").read_text(encoding="utf-8"), {})
    for name in ("Photo", "Wood"):
        made = rounded(bpy.data.images[f"{name} sharpened"])
        np.testing.assert_array_equal(made, RESULTS[f"script {name}"])
    np.testing.assert_allclose(colors(), RESULTS["script colors"], atol=1e-6)


def test_presets_may_name_settings_that_are_no_more():
    enter("Untouched", "Sheet")
    settings = bpy.context.scene.shock_filter.geometry
    bpy.ops.shock_filter.sharpen_colors("EXEC_DEFAULT", True)
    text = "{0}.fidelity = 3.0\n{0}.scheme = 'composed'\n{0}.time = 7.0\n"
    exec(text.format("settings"), {"settings": settings})
    assert settings.time == 7.0
    operator = bpy.context.window_manager.operators[-1]
    exec(text.format("op"), {"op": operator})
    assert operator.time == 7.0
