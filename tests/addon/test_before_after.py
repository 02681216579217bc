# SPDX-License-Identifier: GPL-3.0-or-later
"""Before / After swaps the last result with what was there before, bit for bit."""

import bpy
import numpy as np
import pytest
from shock_filter.shock_addon.data import replaced
from shock_filter.shock_addon.data.mesh.meshes import read_positions, write_positions
from shock_filter.shock_addon.operators import comparing

swap = bpy.ops.shock_filter.before_after


def stored(obj):
    """All that runs write, as bytes."""
    mesh = obj.data
    found = {"positions": read_positions(mesh).tobytes()}
    for attribute in mesh.color_attributes:
        flat = np.empty(4 * len(attribute.data), dtype=np.float32)
        attribute.data.foreach_get("color_srgb", flat)
        found[attribute.name] = flat.tobytes()
    marks = mesh.attributes.get("sharp_edge")
    found["marks"] = marks and bytes(each.value for each in marks.data)
    for key in mesh.shape_keys.key_blocks if mesh.shape_keys else []:
        flat = np.empty(3 * len(mesh.vertices), dtype=np.float32)
        key.points.foreach_get("co", flat)
        found[key.name] = (flat.tobytes(), key.mute)
    return found


def seen(obj):
    bpy.context.view_layer.update()
    return read_positions(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data)


def check_swaps(obj):
    """Swap twice from the result; return what was there before and after."""
    after = stored(obj)
    assert swap() == {"FINISHED"}
    before = stored(obj)
    assert swap() == {"FINISHED"}
    assert stored(obj) == after
    return before, after


@pytest.mark.parametrize("name", ["mark_creases", "crisp_low_poly", "generate"])
def test_a_run_before_another_kind_of_run_is_not_swapped(rounded_box, name):
    rounded_box(cuts=19)
    bpy.ops.shock_filter.sharpen_geometry()
    assert swap.poll()
    words = {"source": "seams", "target": "curvature"} if name == "generate" else {}
    assert getattr(bpy.ops.shock_filter, name)(**words) == {"FINISHED"}
    assert not swap.poll()


def test_there_is_nothing_to_swap_before_a_run(rounded_box):
    rounded_box()
    assert not swap.poll()


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT", "SCULPT"])
def test_positions_and_marks(rounded_box, mode):
    box = rounded_box()
    positions = read_positions(box.data)
    positions[:4, 0] = -0.0
    write_positions(box.data, positions)
    start = stored(box)
    bpy.ops.object.mode_set(mode=mode)
    bpy.ops.shock_filter.sharpen_geometry(mark_sharp=True, where="creases", selected_only=False)
    bpy.ops.object.mode_set(mode="OBJECT")
    assert any(stored(box)["marks"] or [])
    bpy.ops.object.mode_set(mode=mode)
    swap()
    assert bpy.context.object.mode == mode
    bpy.ops.object.mode_set(mode="OBJECT")
    assert stored(box) == start
    before, after = (swap(), check_swaps(box))[1]
    assert before == start
    assert after["positions"] != before["positions"]


@pytest.mark.parametrize("domain", ["POINT", "CORNER"])
@pytest.mark.parametrize("kind", ["FLOAT_COLOR", "BYTE_COLOR"])
def test_colors(painted_sheet, kind, domain):
    sheet = painted_sheet(kind, domain)
    start = stored(sheet)
    bpy.ops.shock_filter.sharpen_colors(time=256.0)
    before, after = check_swaps(sheet)
    assert before == start != after


def test_several_objects_and_both_kinds_of_data(painted_sheet, select):
    sheets = [painted_sheet(), painted_sheet()]
    for sheet in sheets:
        noise = np.random.default_rng(0).normal(scale=0.01, size=(len(sheet.data.vertices), 3))
        write_positions(sheet.data, read_positions(sheet.data) + noise.astype(np.float32))
    start = [stored(sheet) for sheet in sheets]
    select(*sheets)
    bpy.ops.shock_filter.denoise(target="both", color_time=1.0)
    after = [stored(sheet) for sheet in sheets]
    swap()
    assert [stored(sheet) for sheet in sheets] == start != after
    swap()
    assert [stored(sheet) for sheet in sheets] == after


@pytest.mark.parametrize("output", ["MESH", "SHAPE_KEY"])
@pytest.mark.parametrize("keyed", [False, True])
def test_shape_keys(rounded_box, output, keyed):
    box = rounded_box()
    if keyed:
        box.shape_key_add(name="Basis")
        box.shape_key_add(name="Wide").value = 0.5
    start, bare = seen(box), stored(box)
    bpy.ops.shock_filter.sharpen_geometry(output=output)
    result = seen(box)
    swap()
    assert not box.data.shape_keys or not box.data.shape_keys.reference_key.mute
    np.testing.assert_array_equal(seen(box), start)
    if output == "MESH":
        assert {name: stored(box)[name] for name in bare} == bare
    swap()
    np.testing.assert_array_equal(seen(box), result)
    assert (result != start).any()


def test_other_attributes_of_these_names_are_left_alone(rounded_box):
    box = rounded_box()
    start = read_positions(box.data)
    box.data.attributes.new("custom_normal", "STRING", "POINT")
    bpy.ops.shock_filter.sharpen_geometry()
    swap()
    np.testing.assert_array_equal(read_positions(box.data), start)
    assert box.data.attributes["custom_normal"].data_type == "STRING"


def test_what_has_changed_since_is_left_alone(rounded_box):
    box = rounded_box()
    bpy.ops.shock_filter.sharpen_geometry()
    box.data.vertices[0].co.x += 1.0
    now = stored(box)
    with pytest.raises(RuntimeError, match="was changed since the last run"):
        swap()
    assert stored(box) == now
    box.data.vertices[0].co.x -= 1.0


def test_dynamic_topology_stays_on(rounded_box):
    rounded_box()
    bpy.ops.shock_filter.sharpen_geometry()
    bpy.ops.object.mode_set(mode="SCULPT")
    bpy.ops.sculpt.dynamic_topology_toggle()
    with pytest.raises(RuntimeError, match="Nothing was swapped: dynamic topology is on; turn"):
        swap()
    assert bpy.context.object.use_dynamic_topology_sculpting


def test_one_changed_object_leaves_all_alone(rounded_box, select):
    boxes = [rounded_box(), rounded_box(location=(4, 0, 0))]
    select(*boxes)
    bpy.ops.shock_filter.sharpen_geometry()
    bpy.data.objects.remove(boxes[1])
    bpy.data.orphans_purge()
    now = stored(boxes[0])
    with pytest.raises(RuntimeError, match="was changed since"):
        swap()
    assert stored(boxes[0]) == now


def test_the_panel_and_the_report_say_what_is_shown(rounded_box, select, capfd):
    box, other = rounded_box(), rounded_box(location=(4, 0, 0))
    select(box)
    bpy.ops.shock_filter.sharpen_geometry()
    assert comparing.is_held(bpy.context)
    assert not comparing.note(bpy.context)
    swap()
    assert comparing.note(bpy.context).startswith("This is the original; press again")
    assert "The file is saved as shown." in capfd.readouterr().out
    select(other)
    assert not comparing.note(bpy.context)
    assert not swap.poll()
    select(box)
    swap()
    assert "After the run." in capfd.readouterr().out
    assert not comparing.note(bpy.context)


def test_undo_and_redo_go_through_swaps(rounded_box):
    box = rounded_box()
    name = box.name
    bpy.ops.ed.undo_push(message="Start")
    start = stored(box)
    bpy.ops.shock_filter.sharpen_geometry()
    bpy.ops.ed.undo_push(message="Run")
    after = stored(bpy.data.objects[name])
    swap()
    bpy.ops.ed.undo_push(message="Swap")
    for step, there, state, is_said in (
        ("undo", after, "after", False),
        ("undo", start, "before", False),  # as undo does
        ("redo", after, "after", False),
        ("redo", start, "before", True),
    ):
        getattr(bpy.ops.ed, step)()
        assert stored(bpy.data.objects[name]) == there
        assert replaced.state() == state
        assert bool(comparing.note(bpy.context)) == is_said
    swap()
    assert stored(bpy.data.objects[name]) == after


def test_what_undo_brings_back_needs_no_words(rounded_box):
    rounded_box()
    bpy.ops.ed.undo_push(message="Start")
    bpy.ops.shock_filter.sharpen_geometry()
    bpy.ops.ed.undo_push(message="Run")
    bpy.ops.ed.undo()
    assert replaced.state() == "before"
    assert not comparing.note(bpy.context)


def test_a_new_file_forgets(rounded_box):
    rounded_box()
    bpy.ops.shock_filter.sharpen_geometry()
    bpy.ops.wm.read_homefile(use_empty=True)
    assert not comparing.is_held(bpy.context)


def test_a_run_that_changes_nothing_has_nothing_to_swap(rounded_box):
    rounded_box()
    bpy.ops.shock_filter.sharpen_geometry(time=0.0, mark_sharp=False)
    assert not swap.poll()


def pixels_of(image):
    flat = np.empty(len(image.pixels), dtype=np.float32)
    image.pixels.foreach_get(flat)
    return flat


@pytest.fixture
def photo():
    image = bpy.data.images.new("Photo", 24, 16)
    ramp = 0.5 + 0.4 * np.tanh(np.linspace(-6, 6, 24))
    pixels = np.ones((16, 24, 4), dtype=np.float32)
    pixels[..., :3] = ramp[None, :, None]
    image.pixels.foreach_set(pixels.reshape(-1))
    return image


def held_about(image):
    """Swap as the Image Editor that shows the image would."""
    assert any(image.session_uid in each.uids for each in replaced._held)
    return replaced.swap(bpy.context)


def test_replaced_pixels(photo):
    start = pixels_of(photo)
    bpy.ops.shock_filter.sharpen_image(image="Photo", output="REPLACE", time=64.0)
    after = pixels_of(photo)
    assert (after != start).any()
    for state, there in (("before", start), ("after", after), ("before", start)):
        assert held_about(photo) == state
        np.testing.assert_array_equal(pixels_of(photo), there)
    photo.pixels[0] = 0.5
    painted = pixels_of(photo)
    with pytest.raises(replaced.Refused, match="Photo was changed since"):
        held_about(photo)
    np.testing.assert_array_equal(pixels_of(photo), painted)


def of_generated():
    bpy.ops.shock_filter.generate(image="Wood")


def of_sharpened():
    bpy.ops.shock_filter.sharpen_texture(output="REPLACE", time=64.0)


@pytest.mark.parametrize("press", [of_generated, of_sharpened])
def test_replaced_pixels_of_a_texture_come_back_in_the_3d_view(wood, press):
    start = pixels_of(wood)
    press()
    assert (pixels_of(wood) != start).any()
    assert comparing.is_held(bpy.context)
    assert swap() == {"FINISHED"}
    np.testing.assert_array_equal(pixels_of(wood), start)
    bpy.context.object.select_set(False)
    assert not comparing.is_held(bpy.context)


def test_other_settings_after_a_swap_begin_with_the_old_pixels(photo):
    bpy.ops.shock_filter.sharpen_image(image="Photo", output="REPLACE", time=16.0)
    once = pixels_of(photo)
    held_about(photo)
    bpy.ops.shock_filter.sharpen_image(image="Photo", output="REPLACE", time=16.0)
    np.testing.assert_array_equal(pixels_of(photo), once)


def test_a_new_texture_is_swapped_in_the_material(rounded_box):
    box = rounded_box()
    image = bpy.data.images.new("Wood", 64, 64)
    pixels = np.ones((64, 64, 4), dtype=np.float32)
    pixels[..., :3] = (0.5 + 0.4 * np.tanh(np.linspace(-4, 4, 64)))[None, :, None]
    image.pixels.foreach_set(pixels.reshape(-1))
    material = bpy.data.materials.new("Paint")
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    box.data.materials.append(material)
    bpy.ops.shock_filter.sharpen_texture(time=64.0)
    result = node.image
    assert result != image
    assert comparing.is_held(bpy.context)
    for there in (image, result, image):
        assert swap() == {"FINISHED"}
        assert node.image == there
    node.image = None
    with pytest.raises(RuntimeError, match="was changed since"):
        swap()


def test_other_settings_after_a_swap_begin_with_the_old_shape(rounded_box, over_view):
    box = rounded_box()
    name = box.name
    bpy.ops.ed.undo_push(message="Start")
    bpy.ops.shock_filter.sharpen_geometry("EXEC_DEFAULT", True, time=16.0)
    swap("EXEC_DEFAULT", True)
    start = stored(bpy.data.objects[name])
    run = bpy.context.window_manager.operators[-2]  # Adjust Last Operation leaves swaps out
    run.properties.time = 64.0
    over_view(bpy.ops.ed.undo_redo)
    adjusted = stored(bpy.data.objects[name])
    assert adjusted != start
    assert swap() == {"FINISHED"}
    assert stored(bpy.data.objects[name]) == start
    bpy.ops.shock_filter.sharpen_geometry(time=64.0)
    assert stored(bpy.data.objects[name]) == adjusted


def test_a_new_object_takes_turns_with_the_one_that_it_replaced(rounded_box):
    box = rounded_box()
    start = stored(box)
    bpy.ops.shock_filter.sharpen_geometry(output="OBJECT")
    new = bpy.context.object
    assert new != box and swap.poll()
    result = stored(new)
    for shown, hidden in 2 * [(box, new), (new, box)]:
        assert swap() == {"FINISHED"}
        assert not shown.hide_get() and not shown.hide_render and shown.select_get()
        assert hidden.hide_get() and hidden.hide_render
        assert bpy.context.object == shown
    assert (stored(box), stored(new)) == (start, result)


def test_a_new_object_that_was_removed_is_not_swapped(rounded_box):
    rounded_box()
    bpy.ops.shock_filter.sharpen_geometry(output="OBJECT")
    bpy.data.objects.remove(bpy.context.object)
    assert not bpy.context.selected_objects
    assert not swap.poll()
