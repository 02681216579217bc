# SPDX-License-Identifier: GPL-3.0-or-later
"""Live results in files, also for a Blender that knows nothing of the extension."""

import hashlib
import subprocess
import sys

import bpy
import numpy as np
import pytest
import shock_filter
from shock_filter.shock_addon.data import LIVE_COLORS, arrays
from shock_filter.shock_addon.data.chosen import live_modifier
from shock_filter.shock_addon.data.live import graph, stacks
from shock_filter.shock_addon.data.mesh.meshes import read_positions

FRAMES = (1, 6, 11)
OTHERS = """
import sys, bpy, hashlib, numpy as np
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
assert not hasattr(bpy.types, "SHOCK_FILTER_OT_update_live")
def told(words, values):
    print("DIGEST", words, hashlib.sha256(values.tobytes()).hexdigest())
for frame in map(int, sys.argv[2:]):
    bpy.context.scene.frame_set(frame)
    for obj in bpy.data.objects:
        if obj.type == "MESH":
            mesh = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
            found = np.empty(3 * len(mesh.vertices), np.float32)
            mesh.attributes["position"].data.foreach_get("vector", found)
            told(f"{frame} {obj.name} shape", found)
            for colors in mesh.color_attributes:
                found = np.empty(4 * len(colors.data), np.float32)
                colors.data.foreach_get("color_srgb", found)
                told(f"{frame} {obj.name} colors", found)
    bpy.ops.render.render()
    bpy.data.images["Render Result"].save_render(f"{sys.argv[1]}-other-{frame}.exr")
"""
"""What it does: tell what is seen in some frames, and render them."""


def digest(values):
    return hashlib.sha256(np.ascontiguousarray(values).tobytes()).hexdigest()


def key(modifier, name, frame, value):
    stacks.write_input(modifier, name, value)
    identifier = graph.input_of(modifier.node_group, name)
    if hasattr(modifier, "properties"):
        getattr(modifier.properties.inputs, identifier).keyframe_insert("value", frame=frame)
    else:
        modifier.keyframe_insert(f'["{identifier}"]', frame=frame)


@pytest.fixture
def animated(rounded_box):
    """Add a box whose live shape and colors come in within ten frames, and a camera."""
    box = rounded_box(cuts=7)
    colors = box.data.color_attributes.new("Paint", "BYTE_COLOR", "CORNER")
    noise = np.random.default_rng(0).random((len(colors.data), 4), np.float32)
    arrays.write_attribute(colors, noise)
    box.data.color_attributes.active_color = colors
    bpy.ops.shock_filter.sharpen_geometry(output="LIVE")
    bpy.ops.shock_filter.sharpen_colors(output="LIVE")
    for modifier in (live_modifier(box), live_modifier(box, LIVE_COLORS)):
        key(modifier, graph.AMOUNT, 1, 0.0)
        key(modifier, graph.AMOUNT, 11, 1.5)
    scene = bpy.context.scene
    bpy.ops.object.camera_add(location=(4, -4, 3), rotation=(1.1, 0, 0.785))
    scene.camera = bpy.context.object
    bpy.ops.object.light_add(type="SUN", rotation=(0.5, 0.3, 0))
    scene.render.engine, scene.cycles.samples, scene.cycles.device = "CYCLES", 1, "CPU"
    scene.cycles.use_denoising, scene.cycles.seed = False, 1
    scene.render.resolution_x = scene.render.resolution_y = 32
    scene.render.image_settings.file_format = "OPEN_EXR"
    return box


def rendered(path):
    bpy.context.scene.render.filepath = path
    bpy.ops.render.render(write_still=True)
    return pixels_of(path)


def pixels_of(path):
    image = bpy.data.images.load(path)
    pixels = arrays.read_pixels(image)
    bpy.data.images.remove(image)
    return pixels


def test_other_blenders_show_and_render_each_frame_the_same(animated, tmp_path):
    path = str(tmp_path / "live.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    run = [sys.executable, "-c", OTHERS, path, *map(str, FRAMES)]
    done = subprocess.run(run, capture_output=True, text=True, check=True)
    told = dict(line.rsplit(" ", 1) for line in done.stdout.splitlines() if "DIGEST" in line)
    pictures = []
    for frame in FRAMES:
        bpy.context.scene.frame_set(frame)
        mesh = animated.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        name = f"DIGEST {frame} {animated.name}"
        assert told[f"{name} shape"] == digest(read_positions(mesh))
        assert told[f"{name} colors"] == digest(arrays.read_attribute(mesh.color_attributes[0]))
        pictures.append(rendered(f"{path}-{frame}.exr"))
        np.testing.assert_array_equal(pictures[-1], pixels_of(f"{path}-other-{frame}.exr"))
    assert len(set(told.values())) == len(told)  # each frame shows something else
    assert (pictures[0] != pictures[1]).any() and (pictures[1] != pictures[2]).any()


def test_a_reopened_file_shows_the_same_and_can_be_updated(animated, tmp_path):
    path, name = str(tmp_path / "live.blend"), animated.name
    bpy.context.scene.frame_set(11)
    seen = animated.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    before = digest(read_positions(seen)), digest(arrays.read_attribute(seen.color_attributes[0]))
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    box = bpy.data.objects[name]
    for _ in range(2):
        seen = box.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        after = (
            digest(read_positions(seen)),
            digest(arrays.read_attribute(seen.color_attributes[0])),
        )
        assert after == before
        assert shock_filter.live.state(box) == "fresh"
        shock_filter.live.update(box)
        bpy.context.view_layer.update()


def test_a_library_override_shows_its_own_amount(animated, tmp_path):
    path, name = str(tmp_path / "live.blend"), animated.name
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        wanted.objects = [name]
    own = wanted.objects[0].override_create()
    own.animation_data_clear()
    bpy.context.collection.objects.link(own)
    bpy.context.view_layer.objects.active = own
    own.select_set(True)
    before = read_positions(own.data)
    for value in (1.0, 0.0):
        stacks.write_input(live_modifier(own), graph.AMOUNT, value)
        bpy.context.view_layer.update()
        shown = read_positions(own.evaluated_get(bpy.context.evaluated_depsgraph_get()).data)
        assert (shown != before).any() == (value > 0)
    with pytest.raises(RuntimeError, match="linked from another file"):
        shock_filter.live.update(own)
