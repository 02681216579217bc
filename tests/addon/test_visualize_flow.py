# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator Visualize Flow: frames on disk, and image sequences that play them."""

from pathlib import Path

import bpy
import numpy as np
import pytest
from shock_filter import core
from shock_filter.core.files.image_formats import read_pixels
from shock_filter.shock_addon.data import chosen
from shock_filter.shock_addon.data.image import images as image_data
from shock_filter.shock_addon.data.image import sequences
from shock_filter.shock_addon.modes import find
from shock_filter.shock_addon.operators import base as operators
from shock_filter.shock_addon.operators import poll as obstacles

visualize = bpy.ops.shock_filter.visualize_flow
SIZE = 256
BARE = {"blending": 1.0, "injection": 0.0}
"""Noise that is only carried along."""
SMALL = {"frames": 3, "image_size": str(SIZE)}


def read(folder):
    return [read_pixels(path, False) for path in sorted(Path(folder).iterdir())]


def message():
    return operators.summaries["visualize"]


@pytest.fixture
def saved(tmp_path):
    """Save the file into an empty folder."""
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    return tmp_path


@pytest.fixture
def sheet(saved):
    """A flat square, 2 by 2, whose UV map fills the image, with vectors along X."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=8, y_subdivisions=8, calc_uvs=True)
    obj = bpy.context.object
    obj.name = "Sheet"
    wind = obj.data.attributes.new("Wind", "FLOAT_VECTOR", "POINT")
    wind.data.foreach_set("vector", np.tile(np.float32([1, 0, 0]), len(obj.data.vertices)))
    return obj


def add_map(velocity=(1.0, 0.0), size=(64, 48), name="Map"):
    """Add a flow map that has one velocity everywhere."""
    width, height = size
    image = bpy.data.images.new(name, width, height, is_data=True, float_buffer=True)
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., :2] = 0.5 + 0.5 * np.asarray(velocity)
    image.pixels.foreach_set(pixels.ravel())
    return image


def move(frames):
    """Find by how many pixels, right and down, the last frame is moved against the one before."""
    inner = slice(16, -16)
    last = frames[-1][inner, inner].astype(float)
    differences = {
        (right, down): np.abs(
            np.roll(frames[-2], (down, right), axis=(0, 1))[inner, inner] - last
        ).mean()
        for right in range(-3, 4)
        for down in range(-3, 4)
    }
    return min(differences, key=differences.get)


def test_an_attribute_moves_on_the_surface(sheet, saved):
    assert visualize(target="attribute", field="Wind", **BARE, **SMALL) == {"FINISHED"}
    frames = read(saved / "Sheet_flow")
    assert [frame.shape for frame in frames] == [(SIZE, SIZE)] * 3
    assert move(frames) == (2, 0)
    assert "3 frames of 256 x 256 pixels" in message()
    image = bpy.data.images["Sheet Flow"]
    assert image.source == "SEQUENCE" and image.filepath == "//Sheet_flow/frame_0001.png"
    node = next(n for n in sheet.active_material.node_tree.nodes if n.type == "TEX_IMAGE")
    user = node.image_user
    assert (node.image, user.frame_duration, user.frame_start) == (image, 3, 1)
    assert user.use_auto_refresh and not user.use_cyclic


def test_a_flow_up_in_the_map_goes_up_in_the_image(saved):
    add_map((0.0, 1.0))
    assert visualize(target="map", image="Map", frames=3, **BARE) == {"FINISHED"}
    assert move(read(saved / "Map_flow")) == (0, -2)
    assert visualize(target="map", image="Map", frames=3, y_axis="DOWN", **BARE) == {"FINISHED"}
    assert move(read(saved / "Map_flow.001")) == (0, 2)  # in a folder of its own


def test_it_is_the_same_as_on_the_command_line(saved):
    image = add_map((0.0, 0.0), (48, 32))
    y, x = np.mgrid[1:-1:32j, -1:1:48j]
    pixels = np.ones((32, 48, 4), np.float32)
    pixels[..., 0], pixels[..., 1] = 0.5 - 0.5 * y, 0.5 + 0.5 * x
    image.pixels.foreach_set(pixels[::-1].ravel())
    settings = core.NoiseSettings(step=3.0, seed=5)
    assert visualize(target="map", image="Map", frames=4, step=3.0, seed=5) == {"FINISHED"}
    velocity = core.flow_map_velocity(pixels)
    for found, frame in zip(
        read(saved / "Map_flow"), core.advect_noise(velocity, settings, frames=4), strict=True
    ):
        assert np.abs(found - 255.0 * frame).max() < 0.51


@pytest.mark.parametrize("target", ["shape", "colors"])
def test_the_shock_flow_moves_where_the_filter_pulls(saved, rounded_box, target):
    box = rounded_box()
    paint = box.data.color_attributes.new("Paint", "FLOAT_COLOR", "POINT")
    heights = np.array([vertex.co.x for vertex in box.data.vertices])
    colors = np.repeat(0.5 + 0.4 * np.tanh(2 * heights)[:, None], 4, axis=1)
    paint.data.foreach_set("color", colors.astype(np.float32).ravel())
    box.data.color_attributes.active_color = paint
    assert visualize(target=target, in_colors=True, **SMALL) == {"FINISHED"}
    frames = read(saved / "Cube_flow")
    assert frames[0].shape == (SIZE, SIZE, 3)
    assert (frames[1] != frames[2]).any()


def test_the_sequence_plays_on_the_model(sheet, saved):
    assert visualize(target="attribute", field="Wind", **SMALL) == {"FINISHED"}
    tree = sheet.active_material.node_tree
    node = next(n for n in tree.nodes if n.type == "TEX_IMAGE")
    light = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(node.outputs["Color"], light.inputs["Color"])
    out = next(n for n in tree.nodes if n.type == "OUTPUT_MATERIAL")
    tree.links.new(light.outputs[0], out.inputs["Surface"])
    scene = bpy.context.scene
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location.z, camera.data.type, camera.data.ortho_scale = 3.0, "ORTHO", 0.5
    scene.collection.objects.link(camera)
    scene.camera, scene.render.engine, scene.cycles.samples = camera, "CYCLES", 1
    scene.cycles.use_denoising = False
    scene.render.resolution_x = scene.render.resolution_y = 32
    shown = []
    for number in (1, 2, 2):
        scene.frame_set(number)
        scene.render.filepath = str(saved / f"{len(shown)}.png")
        bpy.ops.render.render(write_still=True)
        shown.append(read_pixels(scene.render.filepath, False).astype(float))
    assert np.abs(shown[0] - shown[1]).mean() > 3 * np.abs(shown[1] - shown[2]).mean() + 1


def test_a_loop_is_cyclic(sheet, saved):
    assert visualize(target="attribute", field="Wind", loop=2, **SMALL) == {"FINISHED"}
    node = next(n for n in sheet.active_material.node_tree.nodes if n.type == "TEX_IMAGE")
    assert node.image_user.use_cyclic


def test_without_a_node_materials_stay(sheet, saved):
    assert visualize(target="attribute", field="Wind", add_node=False, **SMALL) == {"FINISHED"}
    assert sheet.active_material is None
    assert bpy.data.images["Sheet Flow"].use_fake_user


def test_undo_takes_the_image_back_and_redo_writes_the_same_folder(sheet, saved, adjust, over_view):
    bpy.ops.ed.undo_push()
    assert visualize("EXEC_DEFAULT", True, target="attribute", field="Wind", **SMALL) == {
        "FINISHED"
    }
    adjust(frames=2)
    assert [path.name for path in saved.iterdir() if path.is_dir()] == ["Sheet_flow"]
    assert len(read(saved / "Sheet_flow")) == 2
    assert [image.name for image in bpy.data.images if image.source == "SEQUENCE"] == ["Sheet Flow"]


def test_esc_leaves_nothing(sheet, saved, monkeypatch):
    asked = []

    def stop(fraction, text):
        asked.append(fraction)
        return fraction < 0.6

    monkeypatch.setattr(operators, "listener", stop)
    before = set(saved.iterdir())
    assert visualize(target="attribute", field="Wind", **SMALL) == {"CANCELLED"}
    assert asked == sorted(asked) and asked[-1] >= 0.6
    assert set(saved.iterdir()) == before
    assert not bpy.data.images
    assert message() == "The run was cancelled; nothing was changed."


def test_frames_that_nobody_waits_for_go(tmp_path):
    staged = sequences.stage(iter([np.zeros((4, 4))]), tmp_path, 1)
    (made,) = tmp_path.iterdir()
    assert staged.folder.parent == made
    del staged
    assert not list(tmp_path.iterdir())


def refused(sentence, **words):
    with pytest.raises(RuntimeError, match=sentence):
        visualize(**words)
    assert not [image for image in bpy.data.images if image.source == "SEQUENCE"]


def test_what_cannot_be_shown_is_named(sheet, saved):
    refused("has no attribute named 'Rain'", target="attribute", field="Rain", **SMALL)
    refused("it has no color attribute", target="colors", **SMALL)
    refused("Choose a flow map, or open one", target="map")
    refused("There is no image named 'Rain'", target="map", image="Rain")
    refused(
        "There is no folder", target="attribute", field="Wind", folder="/no/such/place", **SMALL
    )
    (saved / "full").mkdir()
    (saved / "full" / "mine.txt").write_text("")
    refused("holds other files", target="attribute", field="Wind", folder="//full", **SMALL)
    assert [path.name for path in (saved / "full").iterdir()] == ["mine.txt"]
    bpy.data.objects.remove(sheet)
    add_map()
    assert visualize(target="map", image="Map", frames=1) == {"FINISHED"}


def test_a_file_that_was_never_saved_needs_a_folder(tmp_path):
    add_map()
    refused("Save the blend file first, or choose a Folder", target="map", image="Map", frames=2)
    folder = tmp_path / "out"
    for _ in range(2):  # frames of an earlier run give way
        assert visualize(target="map", image="Map", frames=2, folder=str(folder)) == {"FINISHED"}
    assert sorted(path.name for path in folder.iterdir()) == ["frame_0001.png", "frame_0002.png"]


def test_frames_of_other_makers_are_never_replaced(saved):
    add_map()
    shots = saved / "shots"
    shots.mkdir()
    (shots / "frame_0001.png").write_bytes(b"mine")
    refused("holds other files", target="map", image="Map", frames=2, folder="//shots")
    assert (shots / "frame_0001.png").read_bytes() == b"mine"


def test_frames_that_an_image_of_the_file_plays_give_way(saved, monkeypatch):
    add_map()
    words = {"target": "map", "image": "Map", "folder": "//flow"}
    assert visualize(frames=3, **words) == {"FINISHED"}
    monkeypatch.setattr(sequences, "_written", set())  # as in another session
    assert visualize(frames=2, **words) == {"FINISHED"}
    assert len(list((saved / "flow").iterdir())) == 2
    bpy.data.images.remove(bpy.data.images["Map Flow"])
    bpy.data.images.remove(bpy.data.images["Map Flow.001"])
    monkeypatch.setattr(sequences, "_written", set())
    refused("holds other files", frames=2, **words)


def test_another_folder_counts_on_redo(saved):
    add_map()
    first = saved / "first"
    words = {"target": "map", "image": "Map", "frames": 2, "result": str(first)}
    first.mkdir()
    assert visualize(folder="//second", **words) == {"FINISHED"}
    assert len(list((saved / "second").iterdir())) == 2
    assert list(first.iterdir()) == []


def test_bytes_of_a_map_have_an_exact_middle(saved):
    image = bpy.data.images.new("Map", 40, 40, is_data=True)
    image.pixels.foreach_set(np.full(4 * 40 * 40, 128 / 255, np.float32))
    pixels = image_data.read_pixels(image)
    assert abs(255 * pixels[0, 0, 0] - 128) < 1e-3
    assert visualize(target="map", image="Map", frames=3, injection=0.0, blending=1.0) == {
        "FINISHED"
    }
    frames = read(saved / "Map_flow")
    inner = slice(1, -1)
    np.testing.assert_array_equal(frames[1][inner, inner], frames[2][inner, inner])


@pytest.fixture
def editor():
    """Return a function that calls something in an Image Editor that shows an image."""
    window = bpy.context.window_manager.windows[0]
    area = window.screen.areas[0]
    before, area.type = area.type, "IMAGE_EDITOR"

    def call(image, function):
        area.spaces.active.image = image
        with bpy.context.temp_override(window=window, area=area, space_data=area.spaces.active):
            function(bpy.context)
        return area.spaces.active

    yield call
    area.type = before


def test_the_image_editor_plays_the_flow_of_its_map(saved, editor):
    space = editor(add_map(), lambda context: visualize(target="map", frames=3, loop=2))
    assert space.image == bpy.data.images["Map Flow"]
    user = space.image_user
    assert (user.frame_duration, user.frame_start, user.use_cyclic) == (3, 1, True)


def test_the_map_is_remembered_and_the_button_stays_alive(saved, editor):
    settings = bpy.context.scene.shock_filter.visualize
    space = editor(add_map(), lambda context: visualize(target="map", frames=2))
    assert message().endswith("Press Space to play it.")
    shown = space.image
    assert (shown.name, shown.source) == ("Map Flow", "SEQUENCE")

    def again(context):
        assert obstacles.of_mode(context, find("visualize"), settings) == ""
        # As the button does, which names what the editor shows.
        assert visualize(target="map", image=shown.name, frames=3) == {"FINISHED"}

    editor(shown, again)
    assert "3 frames of 64 x 48 pixels" in message()
    assert space.image.name == "Map Flow.001"
    assert chosen.flow_map_of(space.image) == bpy.data.images["Map"]
    bpy.data.images.remove(bpy.data.images["Map"])
    assert chosen.flow_map_of(space.image) == space.image


def test_what_is_missing_is_said_before_a_press(saved, editor, rounded_box):
    settings = bpy.context.scene.shock_filter.visualize

    def obstacle(target, context=None):
        settings.target = target
        return obstacles.of_mode(context or bpy.context, find("visualize"), settings)

    assert obstacle("shape") == "Select a mesh object."
    box = rounded_box()
    assert obstacle("shape") == ""
    assert obstacle("colors").startswith("The mesh has no colors")
    assert obstacle("attribute") == "Name an attribute of vectors or numbers."
    assert obstacle("map").startswith("Choose a flow map")
    box.data.uv_layers.remove(box.data.uv_layers[0])
    assert obstacle("shape").startswith("Unwrap the mesh")
    settings.image = add_map().name
    assert obstacle("map") == ""
    said = []
    editor(bpy.data.images["Map"], lambda context: said.append(obstacle("shape", context)))
    assert said == [""]  # in the Image Editor its image is meant


def test_a_flow_has_no_preview(sheet):
    chosen = bpy.context.scene.shock_filter
    chosen.mode = "GEOMETRY"
    assert bpy.ops.shock_filter.preview.poll()
    chosen.mode = "VISUALIZE"
    assert not bpy.ops.shock_filter.preview.poll()
