# SPDX-License-Identifier: GPL-3.0-or-later
"""The output Live: a movement in attributes, and nodes that add it."""

import time
from dataclasses import replace
from types import SimpleNamespace

import bmesh
import bpy
import numpy as np
import pytest
import shock_filter
from shock_filter.core.host.live.movement import Connectivity, is_fitting, marks_of, movement
from shock_filter.shock_addon.data import MOVE
from shock_filter.shock_addon.data.chosen import live_modifier, live_source
from shock_filter.shock_addon.data.live import graph, nodes, recipes, stacks
from shock_filter.shock_addon.data.live.recipes import all_noted
from shock_filter.shock_addon.data.mesh import geometry, meshes
from shock_filter.shock_addon.data.mesh.meshes import read_positions, write_positions
from shock_filter.shock_addon.data.mesh.original import Original, show
from shock_filter.shock_addon.live import automatic
from shock_filter.shock_addon.live import updating as live_updating
from shock_filter.shock_addon.operators import base as operators

sharpen = bpy.ops.shock_filter.sharpen_geometry
live = shock_filter.live
ROUNDING = 1e-7
"""Of a sum in float32, on a box of size 2."""


def evaluated(obj):
    bpy.context.view_layer.update()
    return obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data


def seen(obj):
    return read_positions(evaluated(obj))


def amount(obj, value):
    stacks.write_input(live_modifier(obj), graph.AMOUNT, value)


def written(obj, **settings):
    """Return what the output Mesh writes, and put the mesh back."""
    before = read_positions(obj.data)
    sharpen(output="MESH", mark_sharp=False, **settings)
    after = read_positions(obj.data)
    write_positions(obj.data, before)
    obj.data.update()
    return before, after


def test_amounts_go_from_the_mesh_to_the_result_and_beyond(rounded_box):
    box = rounded_box()
    before, after = written(box)
    assert sharpen(output="LIVE") == {"FINISHED"}
    assert read_positions(box.data).tobytes() == before.tobytes()
    assert (after != before).any()
    np.testing.assert_allclose(seen(box), after, rtol=0, atol=ROUNDING)
    for value in (-1.0, 0.0, 0.5, 2.0):
        amount(box, value)
        want = before.astype(float) + value * (after.astype(float) - before)
        np.testing.assert_allclose(seen(box), want, rtol=0, atol=2 * ROUNDING)
    amount(box, 0.0)
    np.testing.assert_array_equal(seen(box), before)


def test_a_movement_brings_positions_to_the_bit_unless_they_change_much():
    rng = np.random.default_rng(1)
    old = rng.normal(size=(20_000, 3)).astype(np.float32)
    new = (old * rng.uniform(0.5, 2.0, size=old.shape)).astype(np.float32)
    np.testing.assert_array_equal(old + movement(old, new), new)
    new = (old * rng.uniform(-20.0, 20.0, size=old.shape)).astype(np.float32)
    spacing = np.spacing(np.maximum(np.abs(old), np.abs(new)))
    assert (np.abs(old + movement(old, new) - new) <= spacing).all()


def test_the_modifier_is_first_and_one_undo_step_takes_all_back(rounded_box):
    box = rounded_box()
    box.modifiers.new("Bend", "SIMPLE_DEFORM")
    bpy.ops.ed.undo_push(message="before")
    sharpen("EXEC_DEFAULT", True, output="LIVE")
    name = box.name
    assert [each.name for each in box.modifiers] == ["Shock Filter", "Bend"]
    bpy.ops.ed.undo()
    box = bpy.data.objects[name]
    assert [each.name for each in box.modifiers] == ["Bend"]
    assert MOVE not in box.data.attributes


def test_an_update_is_one_step_of_undo(rounded_box):
    box = rounded_box()
    sharpen("EXEC_DEFAULT", True, output="LIVE")
    name, moved = box.name, read_positions(box.data) * np.float32(1.5)
    write_positions(box.data, moved)
    box.data.update()
    bpy.ops.ed.undo_push(message="Moved")
    bpy.ops.shock_filter.update_live("EXEC_DEFAULT", True)
    assert live.state(box) == "fresh"
    bpy.ops.ed.undo()
    box = bpy.data.objects[name]
    assert live.state(box) == "moved"
    np.testing.assert_array_equal(read_positions(box.data), moved)


def test_pressing_again_starts_from_the_mesh_and_keeps_the_inputs(rounded_box):
    box = rounded_box()
    _, after = written(box, time=16.0)
    sharpen(output="LIVE")
    amount(box, 0.25)
    tree = live_modifier(box).node_group
    for output in ("LIVE", "AUTO"):
        sharpen(output=output, time=16.0)
        assert len(box.modifiers) == 1 and live_modifier(box).node_group == tree
        assert stacks.read_input(live_modifier(box), graph.AMOUNT) == 0.25
    amount(box, 1.0)
    np.testing.assert_allclose(seen(box), after, rtol=0, atol=ROUNDING)


def test_other_outputs_take_the_live_result_away(rounded_box):
    box = rounded_box()
    _, after = written(box)
    sharpen(output="LIVE")
    sharpen(output="MESH")
    assert "was removed, since it would be added" in operators.summaries["geometry"]
    np.testing.assert_array_equal(seen(box), after)
    assert live.state(box) == ""


def test_the_report_says_that_the_live_result_of_another_filter_is_replaced(rounded_box):
    box = rounded_box()
    text = f"The live result of {box.name} was replaced, which another filter had made."
    sharpen(output="LIVE")
    sharpen(output="AUTO")
    assert text not in operators.summaries["geometry"]
    bpy.ops.shock_filter.denoise(output="AUTO")
    assert text in operators.summaries["denoise"]
    assert "  " not in operators.summaries["denoise"]
    bpy.ops.shock_filter.update_live()
    assert text not in operators.summaries["denoise"]


def test_masks_are_fields(rounded_box):
    box = rounded_box()
    before = read_positions(box.data)
    sharpen(output="LIVE")
    whole = seen(box)
    group = box.vertex_groups.new(name="Here")
    top = np.flatnonzero(before[:, 2] > 0)
    group.add(top.tolist(), 1.0, "REPLACE")
    stacks.link_input(live_modifier(box), graph.MASK, "Here")
    after = seen(box)
    np.testing.assert_array_equal(after[top], whole[top])
    rest = before[:, 2] <= 0
    np.testing.assert_array_equal(after[rest], before[rest])
    weights = box.data.attributes.new("Half", "FLOAT", "POINT")
    weights.data.foreach_set("value", np.full(len(before), 0.5, np.float32))
    stacks.link_input(live_modifier(box), graph.MASK, "Half")
    np.testing.assert_allclose(seen(box), 0.5 * (before + whole), rtol=0, atol=ROUNDING)


def test_closed_creases_are_sharp_where_it_is_shown(rounded_box):
    box = rounded_box()
    sharpen(output="MESH")
    want = np.array([each.value for each in box.data.attributes["sharp_edge"].data])
    other = rounded_box(location=(5, 0, 0))
    sharpen(output="LIVE")
    assert "sharp_edge" not in other.data.attributes
    marks = [each.value for each in evaluated(other).attributes["sharp_edge"].data]
    assert want.any()
    np.testing.assert_array_equal(marks, want)
    stacks.write_input(live_modifier(other), nodes.MARK_SHARP, False)
    marks = evaluated(other).attributes.get("sharp_edge")
    assert marks is None or not any(each.value for each in marks.data)


def test_applying_leaves_the_result_and_nothing_else(rounded_box):
    box = rounded_box()
    sharpen(output="LIVE")
    after = seen(box)
    bpy.ops.object.modifier_apply(modifier="Shock Filter")
    np.testing.assert_array_equal(read_positions(box.data), after)
    assert not [each.name for each in box.data.attributes if "shock" in each.name]


def deleted(bm):
    bmesh.ops.delete(bm, geom=[list(bm.verts)[-1]], context="VERTS")


def subdivided(bm):
    bmesh.ops.subdivide_edges(bm, edges=list(bm.edges)[:4], cuts=1)


def rotated(bm):
    bmesh.ops.rotate_edges(bm, edges=[list(bm.edges)[5]])


def without_a_face(bm):
    bmesh.ops.delete(bm, geom=list(bm.faces)[:1], context="FACES_ONLY")


def merged(bm):
    bmesh.ops.pointmerge(bm, verts=list(list(bm.edges)[7].verts), merge_co=(0, 0, 0))


def replaced(bm):
    """As many vertices, edges and faces as before."""
    bmesh.ops.delete(bm, geom=[list(bm.verts)[3]], context="VERTS")
    bmesh.ops.holes_fill(bm, edges=list(bm.edges), sides=0)
    (face,) = [face for face in bm.faces if len(face.verts) > 4]
    bmesh.ops.poke(bm, faces=[face])


def exchanged(bm):
    """As many faces, and the same edges."""
    (one, other), edge = next(
        (edge.link_faces, edge)
        for edge in bm.edges
        if [len(face.verts) for face in edge.link_faces] == [4, 4]
    )
    bmesh.ops.contextual_create(bm, geom=[e for f in (one, other) for e in f.edges if e != edge])
    bmesh.ops.delete(bm, geom=[one], context="FACES_ONLY")


@pytest.mark.parametrize(
    "edit",
    [exchanged, deleted, subdivided, rotated, without_a_face, merged, replaced],
    ids=lambda f: f.__name__,
)
def test_edits_of_the_connectivity_pass_the_mesh_through(rounded_box, edit):
    box = rounded_box()
    sharpen(output="LIVE")
    bm = bmesh.new()
    bm.from_mesh(box.data)
    edit(bm)
    bm.to_mesh(box.data)
    bm.free()
    box.data.update()
    np.testing.assert_array_equal(seen(box), read_positions(box.data))
    assert live.state(box) == "stale"
    live.update(box)
    assert live.state(box) == "fresh"
    assert (seen(box) != read_positions(box.data)).any()


def test_moved_and_reordered_vertices_keep_their_movement(rounded_box):
    box = rounded_box()
    before = read_positions(box.data)
    sharpen(output="LIVE")
    after = seen(box)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.sort_elements(type="RANDOMIZE", elements={"VERT", "EDGE", "FACE"}, seed=3)
    bpy.ops.object.mode_set(mode="OBJECT")
    assert (read_positions(box.data) != before).any()
    assert live.state(box) == "fresh"
    for rows, others in ((read_positions(box.data), before), (seen(box), after)):
        np.testing.assert_array_equal(np.unique(rows, axis=0), np.unique(others, axis=0))
    moved = read_positions(box.data) + np.float32(2.0)
    write_positions(box.data, moved)
    box.data.update()
    assert live.state(box) == "moved"
    assert (seen(box) != moved).any()


def test_joined_objects_pass_through(rounded_box, select):
    one, other = rounded_box(), rounded_box(location=(5, 0, 0))
    select(one, other)
    sharpen(output="LIVE")
    bpy.ops.object.join()
    assert live.state(one) == "stale"
    np.testing.assert_array_equal(seen(one), read_positions(one.data))


def test_users_of_a_mesh_share_the_movement_and_have_their_own_amount(rounded_box, select):
    one = rounded_box()
    before = read_positions(one.data)
    twin = bpy.data.objects.new("Twin", one.data)
    bpy.context.collection.objects.link(twin)
    sharpen(output="LIVE")
    np.testing.assert_array_equal(seen(one), seen(twin))
    amount(twin, 0.0)
    np.testing.assert_array_equal(seen(twin), before)
    assert (seen(one) != before).any()
    select(twin)
    bpy.ops.object.make_single_user(object=True, obdata=True)
    bpy.data.objects.remove(one)
    amount(twin, 1.0)
    assert live.state(twin) == "fresh"
    assert (seen(twin) != before).any()


def test_shape_keys_are_kept(rounded_box):
    box = rounded_box()
    box.shape_key_add(name="Basis")
    key = box.shape_key_add(name="Wide")
    wide = read_positions(box.data) * np.float32(1.5)
    key.points.foreach_set("co", wide.reshape(-1))
    key.value = 1.0
    sharpen(output="SHAPE_KEY")
    after = seen(box)
    box.shape_key_remove(box.data.shape_keys.key_blocks[-1])
    sharpen(output="LIVE")
    assert [each.name for each in box.data.shape_keys.key_blocks] == ["Basis", "Wide"]
    np.testing.assert_allclose(seen(box), after, rtol=0, atol=2 * ROUNDING)
    assert live.state(box) == "fresh"
    key.value = 0.5
    assert live.state(box) == "moved"


def test_multires_is_named_before_anything_is_written(rounded_box):
    box = rounded_box()
    box.modifiers.new("Multires", "MULTIRES")
    with pytest.raises(RuntimeError, match="Multires needs the mesh right below it"):
        sharpen(output="LIVE")
    assert MOVE not in box.data.attributes and len(box.modifiers) == 1


def test_linked_meshes_are_named_and_appended_ones_work(rounded_box, tmp_path, select):
    box = rounded_box()
    sharpen(output="LIVE")
    after, name = seen(box), box.name
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "live.blend"))
    bpy.ops.wm.read_homefile(use_empty=True)
    own = nodes.find_or_build()
    for link in (True, False):
        with bpy.data.libraries.load(str(tmp_path / "live.blend"), link=link) as (_, wanted):
            wanted.objects = [name]
        obj = wanted.objects[0]
        bpy.context.collection.objects.link(obj)
        np.testing.assert_array_equal(seen(obj), after)
        select(obj)
        if link:
            with pytest.raises(RuntimeError, match="linked from another file"):
                sharpen(output="LIVE")
    live.update(obj)
    np.testing.assert_array_equal(seen(obj), after)
    assert nodes.find_or_build() == own


def test_instances_show_it(rounded_box):
    box = rounded_box()
    sharpen(output="LIVE")
    collection = bpy.data.collections.new("Boxes")
    collection.objects.link(box)
    empty = bpy.data.objects.new("Instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", collection
    bpy.context.collection.objects.link(empty)
    graph = bpy.context.evaluated_depsgraph_get()
    shown = [each.object.data for each in graph.object_instances if each.is_instance]
    np.testing.assert_array_equal(read_positions(shown[0]), seen(box))


def test_both_outputs_of_denoise(rounded_box):
    box = rounded_box()
    before = read_positions(box.data)
    colors = box.data.color_attributes.new("Paint", "FLOAT_COLOR", "POINT")
    noise = np.random.default_rng(0).random(4 * len(before), np.float32)
    colors.data.foreach_set("color", noise)
    box.data.color_attributes.active_color = colors
    bpy.ops.shock_filter.denoise(target="both", output="LIVE")
    np.testing.assert_array_equal(read_positions(box.data), before)
    assert (seen(box) != before).any()
    after = np.empty_like(noise)
    evaluated(box).color_attributes["Paint"].data.foreach_get("color", after)
    assert (after != noise).any()
    box.data.color_attributes["Paint"].data.foreach_get("color", after)
    np.testing.assert_array_equal(after, noise)
    live.update(box)
    assert len(box.modifiers) == 2 and live.state(box) == "fresh"


def test_a_preview_shows_its_result_without_the_live_one(rounded_box):
    box = rounded_box()
    before, after = written(box, time=16.0)
    sharpen(output="LIVE")
    live_result = seen(box)
    settings = bpy.context.scene.shock_filter.geometry
    settings.output = "LIVE"
    targets, _ = meshes.read_active(bpy.context, geometry.read_geometry, settings)
    original = Original(box.data, None)
    show(targets[0], original, SimpleNamespace(positions=after, creases=None))
    np.testing.assert_array_equal(seen(box), after)
    original.restore()
    np.testing.assert_array_equal(seen(box), live_result)
    np.testing.assert_array_equal(read_positions(box.data), before)


def test_before_and_after_swap_it(rounded_box):
    box = rounded_box()
    before = read_positions(box.data)
    sharpen(output="LIVE")
    after = seen(box)
    bpy.ops.shock_filter.before_after()
    np.testing.assert_array_equal(seen(box), before)
    bpy.ops.shock_filter.before_after()
    np.testing.assert_array_equal(seen(box), after)


def test_before_and_after_swap_how_it_was_made(rounded_box):
    mesh = rounded_box().data
    sharpen(output="LIVE", time=0.5)
    sharpen(output="LIVE", time=1.0)
    bpy.ops.shock_filter.before_after()
    (recipe,) = all_noted(mesh)
    assert recipe[1]["time"] == 0.5
    bpy.ops.shock_filter.before_after()
    assert all_noted(mesh)[0][1]["time"] == 1.0
    sharpen(output="MESH")
    assert not all_noted(mesh)
    bpy.ops.shock_filter.before_after()
    assert all_noted(mesh)[0][1]["time"] == 1.0


@pytest.fixture
def joined_cubes():
    """Add a cube with a Boolean and a Remesh modifier; returns it and the operand."""
    bpy.ops.mesh.primitive_cube_add(location=(1, 1, 1))
    operand = bpy.context.object
    bpy.ops.mesh.primitive_cube_add()
    cube = bpy.context.object
    cube.modifiers.new("Boolean", "BOOLEAN").object = operand
    remesh = cube.modifiers.new("Remesh", "REMESH")
    remesh.mode, remesh.voxel_size = "VOXEL", 0.1
    return cube, operand


def test_a_live_copy_remembers_its_source(joined_cubes):
    cube, operand = joined_cubes
    assert sharpen(output="LIVE") == {"FINISHED"}
    copy = bpy.context.object
    assert live_source(copy) == cube and cube.hide_get() and len(cube.modifiers) == 2
    assert live.state(copy) == "fresh" and (seen(copy) != read_positions(copy.data)).any()
    material = bpy.data.materials.new("Own")
    copy.data.materials.append(material)
    materials = list(copy.data.materials)
    copy.modifiers.new("Bend", "SIMPLE_DEFORM")
    copy.name = copy.data.name = "Crisp"
    amount(copy, 0.5)
    old = read_positions(copy.data)
    operand.location.x = 0.6
    bpy.context.view_layer.update()
    assert live.state(copy) == "moved"
    live.update(copy)
    assert live.state(copy) == "fresh" and copy.data.name == "Crisp" and len(bpy.data.meshes) == 3
    assert read_positions(copy.data).shape != old.shape or (read_positions(copy.data) != old).any()
    assert list(copy.data.materials) == materials
    assert [each.name for each in copy.modifiers] == ["Shock Filter", "Bend"]
    assert stacks.read_input(live_modifier(copy), graph.AMOUNT) == 0.5
    bpy.data.objects.remove(cube)
    with pytest.raises(RuntimeError, match="was removed"):
        live.update(copy)


def by_apply(copy):
    bpy.ops.object.modifier_apply(modifier=live_modifier(copy).name)


def by_output_mesh(copy):
    sharpen(output="MESH", where="everywhere")


def by_output_object(copy):
    sharpen(output="OBJECT", where="everywhere")


@pytest.mark.parametrize("end", [by_apply, by_output_mesh, by_output_object])
def test_what_is_live_no_more_is_no_copy_that_a_source_overwrites(joined_cubes, end):
    operand = joined_cubes[1]
    sharpen(output="LIVE", where="everywhere", time=1.0)
    bpy.ops.shock_filter.auto_update_live()
    end(bpy.context.object)
    own = bpy.context.object
    assert live_source(own) is None and not automatic.is_on(own)
    own.data.vertices[0].co.z = 9.0
    own.data.update()
    sculpted = read_positions(own.data)
    operand.location.x = 0.7
    bpy.context.view_layer.update()
    assert own not in automatic.due()
    assert not bpy.ops.shock_filter.auto_update_live.poll()
    sharpen(output="LIVE", where="everywhere")
    assert bpy.context.object == own and live_source(own) is None
    np.testing.assert_array_equal(read_positions(own.data), sculpted)
    live.update(own)
    np.testing.assert_array_equal(read_positions(own.data), sculpted)


def states_after(operator, name, count):
    """Undo or redo some steps; return the state of a copy after each."""
    found = []
    for _ in range(count):
        operator()
        bpy.context.view_layer.update()  # as Blender does in its window
        found.append(live.state(bpy.data.objects[name]))
    return found


def test_undo_and_redo_know_which_copies_are_behind(joined_cubes):
    operand = joined_cubes[1].name
    sharpen(output="LIVE")
    name = bpy.context.object.name
    bpy.ops.ed.undo_push(message="Live")
    for x in (0.7, 0.5):
        bpy.data.objects[operand].location.x = x
        bpy.context.view_layer.update()
        bpy.ops.ed.undo_push(message="Move")
        bpy.ops.shock_filter.update_live("EXEC_DEFAULT", True)
    assert live.state(bpy.data.objects[name]) == "fresh"
    assert states_after(bpy.ops.ed.undo, name, 4) == ["moved", "fresh", "moved", "fresh"]
    assert states_after(bpy.ops.ed.redo, name, 4) == ["moved", "fresh", "moved", "fresh"]
    assert not automatic.data.live.watching.changed_copies()


def test_undo_leaves_copies_whose_source_is_in_another_mode_or_has_a_mask(joined_cubes):
    cube, operand = joined_cubes
    cube.hide_set(False)
    sharpen(output="LIVE")
    copy = bpy.context.object
    operand.location.x = 0.7
    bpy.context.view_layer.update()
    operand.location.x = 1.0
    watching = automatic.data.live.watching
    cube.hide_set(False)
    bpy.context.view_layer.objects.active = cube
    bpy.ops.object.mode_set(mode="EDIT")
    watching.doubt()
    bpy.context.view_layer.update()
    assert watching.has_changed(copy)
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.view_layer.update()
    assert not watching.has_changed(copy)
    operator, settings = all_noted(copy.data)[0]
    recipes.note(copy.data, operator, settings | {"vertex_group": "Some"})
    operand.location.x = 0.9
    bpy.context.view_layer.update()
    operand.location.x = 1.0
    watching.doubt()
    bpy.context.view_layer.update()
    assert watching.has_changed(copy)


def test_a_painted_mask_stays_where_it_was_when_a_copy_is_updated(joined_cubes):
    _, operand = joined_cubes
    sharpen(output="LIVE")
    copy = bpy.context.object
    bpy.ops.shock_filter.paint_live()
    bpy.ops.object.mode_set(mode="OBJECT")
    below = np.flatnonzero(read_positions(copy.data)[:, 2] < 0.5)
    copy.vertex_groups.active.add(below.tolist(), 0.0, "REPLACE")
    operand.location.x = 0.8
    bpy.context.view_layer.update()
    live.update(copy)
    positions = read_positions(copy.data)
    moved = (seen(copy) != positions).any(axis=1)
    assert moved[positions[:, 2] > 0.7].any()
    assert not moved[positions[:, 2] < 0.3].any()


def test_copies_update_themselves_when_they_may(joined_cubes, tmp_path, monkeypatch):
    _, operand = joined_cubes
    sharpen(output="LIVE")
    copy = bpy.context.object
    assert not automatic.due()
    operand.location.x = 0.7
    bpy.context.view_layer.update()
    assert not automatic.due()
    bpy.ops.shock_filter.auto_update_live()
    assert automatic.due() == [copy] and automatic.is_coming(copy)
    automatic.wait()  # as undo does, which brings changes of its own
    assert not automatic.is_coming(copy)  # so that the panel says that it is out of date
    operand.location.x = 0.75
    bpy.context.view_layer.update()
    automatic._look()
    assert not automatic.due()
    monkeypatch.setattr(automatic, "_undone", -10.0)
    operand.location.x = 0.7
    bpy.context.view_layer.update()
    assert automatic.is_coming(copy) and not automatic.due()  # before it is looked at, too
    automatic._look()
    assert automatic.due() == [copy]
    automatic.run()
    assert live.state(copy) == "fresh" and not automatic.due()
    operand.location.x = 0.8
    bpy.context.view_layer.update()
    name, path = copy.name, str(tmp_path / "behind.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    copy = bpy.data.objects[name]
    assert live.state(copy) == "moved" and not automatic.due()
    bpy.ops.shock_filter.auto_update_live()
    assert automatic.due() == [copy]


def test_another_mode_or_an_undo_ends_an_update(joined_cubes, monkeypatch):
    sharpen(output="LIVE")
    copy = bpy.context.object
    asked = []
    job = SimpleNamespace(cancel=lambda: asked.append("cancel"))
    monkeypatch.setattr(automatic.jobs, "current", lambda: job)
    monkeypatch.setattr(automatic, "_updated", copy.session_uid)
    monkeypatch.setattr(automatic, "_refused", {copy.session_uid})
    monkeypatch.setattr(automatic, "_undone", -10.0)
    automatic._note_job()
    assert job.keys_pass
    automatic._look()
    assert not asked and job.is_welcome()
    bpy.ops.object.mode_set(mode="EDIT")
    assert not job.is_welcome()
    automatic._look()
    assert asked == ["cancel"] and not automatic._refused  # it comes again
    bpy.ops.object.mode_set(mode="OBJECT")
    automatic.wait()
    assert asked == ["cancel"] * 2


def test_a_result_waits_until_the_last_change_was_looked_at(joined_cubes, monkeypatch):
    """The change may have put it out of date, and then ends the update."""
    _, operand = joined_cubes
    sharpen(output="LIVE")
    automatic._look()
    assert automatic._is_welcome()
    operand.location.x = 0.7
    bpy.context.view_layer.update()
    assert not automatic._is_welcome()
    automatic._look()
    assert automatic._is_welcome()


def test_a_change_meanwhile_ends_an_update(joined_cubes, monkeypatch):
    _, operand = joined_cubes
    sharpen(output="LIVE")
    asked = []
    automatic._look()
    job = SimpleNamespace(cancel=lambda: asked.append("cancel"))
    monkeypatch.setattr(automatic, "_job", job)
    monkeypatch.setattr(automatic, "_updated", bpy.context.object.session_uid)
    monkeypatch.setattr(automatic, "_refused", {bpy.context.object.session_uid})
    monkeypatch.setattr(automatic, "_undone", time.monotonic())
    monkeypatch.setattr(automatic.jobs, "current", lambda: job)
    automatic._look()
    assert not asked
    operand.location.x = 0.7
    bpy.context.view_layer.update()
    assert automatic._look() == pytest.approx(automatic.REST, abs=0.1)
    assert asked == ["cancel"] and not automatic._refused  # it comes again, after an undo too
    monkeypatch.setattr(automatic, "_updated", -1)
    operand.location.x = 0.8
    bpy.context.view_layer.update()
    automatic._look()
    assert asked == ["cancel"]  # that of another copy goes on


@pytest.mark.parametrize(("pause", "state"), [(0.0, "fresh"), (60.0, "moved")])
def test_only_a_change_after_a_pause_is_followed_at_once(joined_cubes, monkeypatch, pause, state):
    _, operand = joined_cubes
    sharpen(output="LIVE")
    copy = bpy.context.object
    bpy.ops.shock_filter.auto_update_live()
    monkeypatch.setattr(automatic, "_PAUSE", pause)
    monkeypatch.setattr(automatic, "_undone", -10.0)
    for shift in (0.1, 0.2):
        operand.location.x = 1.0 - shift
        bpy.context.view_layer.update()
        automatic._look()
    assert live.state(copy) == state
    monkeypatch.setattr(automatic, "REST", 0.0)
    operand.location.x = 0.5
    bpy.context.view_layer.update()
    automatic._look()
    assert live.state(copy) == "fresh"


def count_runs(monkeypatch):
    """Return a list that gets the surfaces that runs compute."""
    computed, run = [], operators.Task.run

    def note(task, progress):
        computed.extend(target.name for target in task.targets)
        return run(task, progress)

    monkeypatch.setattr(operators.Task, "run", note)
    return computed


def test_linked_duplicates_of_a_copy_follow_with_it(joined_cubes, monkeypatch):
    _, operand = joined_cubes
    sharpen(output="LIVE")
    copy = bpy.context.object
    bpy.ops.object.duplicate(linked=True)
    twin = bpy.context.object
    assert twin != copy and twin.data == copy.data and live_source(twin) == live_source(copy)
    amount(twin, 0.5)
    copy.select_set(True)
    bpy.ops.shock_filter.auto_update_live()
    computed = count_runs(monkeypatch)
    for count, press in enumerate((bpy.ops.shock_filter.update_live, automatic.run), 1):
        old = seen(copy), seen(twin)
        operand.location.x -= 0.1
        bpy.context.view_layer.update()
        assert live.state(copy) == live.state(twin) == "moved"
        automatic._refused.clear()
        press()
        assert len(computed) == count
        assert live.state(copy) == live.state(twin) == "fresh" and copy.data == twin.data
        assert [seen(copy).tobytes(), seen(twin).tobytes()] != [each.tobytes() for each in old]
    assert (seen(copy) != seen(twin)).any()  # each with its own amount
    assert [stacks.read_input(live_modifier(each), graph.AMOUNT) for each in (copy, twin)] == [
        1,
        0.5,
    ]


def test_objects_with_one_mesh_are_updated_by_one_run(rounded_box, select, monkeypatch):
    box = rounded_box()
    sharpen(output="LIVE")
    bpy.ops.object.duplicate(linked=True)
    twin = bpy.context.object
    bpy.ops.object.duplicate(linked=False)
    other = bpy.context.object
    select(twin, box, other)
    computed = count_runs(monkeypatch)
    assert bpy.ops.shock_filter.update_live() == {"FINISHED"}
    assert computed == [twin.name, other.name]
    select(box, twin)
    steps = [live_updating.steps_of(obj)[0] for obj in (box, twin, other)]
    assert steps[0].does(steps[1]) and not steps[0].does(steps[2])


@pytest.mark.parametrize("how", ["object", "collection"])
def test_copies_follow_a_source_that_is_disabled(joined_cubes, how):
    cube, operand = joined_cubes
    sharpen(output="LIVE")
    copy = bpy.context.object
    if how == "object":
        cube.hide_viewport = True
    else:
        collection = bpy.data.collections.new("Away")
        bpy.context.scene.collection.children.link(collection)
        for other in list(cube.users_collection):
            other.objects.unlink(cube)
        collection.objects.link(cube)
        bpy.context.view_layer.layer_collection.children["Away"].exclude = True
    before = read_positions(copy.data)
    operand.location.x = 0.7
    bpy.context.view_layer.update()
    assert live.state(copy) == "moved"
    live.update(copy)
    after = read_positions(copy.data)
    assert len(after) > 1000 and after.tobytes() != before.tobytes()
    assert live.state(copy) == "fresh"


@pytest.mark.parametrize("has_groups", [True, False])
def test_layers_of_a_source_are_in_its_live_copy(joined_cubes, has_groups):
    cube, _ = joined_cubes
    cube.modifiers.remove(cube.modifiers["Remesh"])
    cube.data.color_attributes.new("Paint", "BYTE_COLOR", "CORNER")
    cube.data.attributes.new("own", "FLOAT", "FACE")
    cube.data.uv_layers.new(name="Second")
    if has_groups:
        cube.vertex_groups.new(name="Some").add([0, 1], 0.5, "REPLACE")
    sharpen(output="LIVE", where="everywhere")
    mesh = bpy.context.object.data
    assert {"Paint", "own", "UVMap", "Second"} <= set(mesh.attributes.keys())
    assert any(len(vertex.groups) for vertex in mesh.vertices) == has_groups


def test_painting_where(rounded_box):
    box = rounded_box()
    sharpen(output="LIVE")
    after = seen(box)
    bpy.ops.shock_filter.paint_live()
    assert bpy.context.mode == "PAINT_WEIGHT"
    np.testing.assert_array_equal(seen(box), after)
    bpy.ops.object.mode_set(mode="OBJECT")
    group = box.vertex_groups.active
    half = range(0, len(after), 2)
    group.add(list(half), 0.0, "REPLACE")
    np.testing.assert_array_equal(seen(box)[::2], read_positions(box.data)[::2])
    np.testing.assert_array_equal(seen(box)[1::2], after[1::2])
    bpy.ops.shock_filter.paint_live()
    assert len(box.vertex_groups) == 1


def test_painting_where_an_attribute_was_the_mask_paints_what_is_read(rounded_box):
    box = rounded_box()
    sharpen(output="LIVE")
    box.data.attributes.new("m", "FLOAT", "POINT")
    modifier = live_modifier(box)
    stacks.link_input(modifier, graph.MASK, "m")
    bpy.ops.shock_filter.paint_live()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert stacks.linked_input(modifier, graph.MASK) == box.vertex_groups.active.name


def test_keyframes_of_amount(rounded_box):
    box = rounded_box()
    before = read_positions(box.data)
    sharpen(output="LIVE")
    after = seen(box)
    modifier = live_modifier(box)
    key = graph.input_of(modifier.node_group, graph.AMOUNT)
    owner, path = (modifier, f'["{key}"]')
    if hasattr(modifier, "properties"):
        owner, path = getattr(modifier.properties.inputs, key), "value"
    for frame, value in ((1, 0.0), (11, 1.0)):
        amount(box, value)
        owner.keyframe_insert(path, frame=frame)
    bpy.context.scene.frame_set(1)
    np.testing.assert_array_equal(seen(box), before)
    bpy.context.scene.frame_set(11)
    np.testing.assert_array_equal(seen(box), after)


def test_objects_without_a_live_result_are_named(rounded_box):
    box = rounded_box()
    with pytest.raises(RuntimeError, match="has no live result"):
        live.update(box)
    assert live.state(box) == ""
    bpy.context.view_layer.objects.active = None
    with pytest.raises(RuntimeError, match="Select a mesh object"):
        bpy.ops.shock_filter.update_live()


@pytest.mark.parametrize("count", [0, 1, 2, 7, 100_000])
def test_marks_of_faces_tell_that_one_was_replaced(count):
    found = marks_of(np.zeros((3, 3), np.float32), triangles(count))
    assert is_fitting(found, triangles(count))
    assert np.abs(found.faces).max(initial=0.0) < 1 << 12  # so that sums are exact in float32
    for number in range(min(count, 5) if count > 1 else 0):
        for other in (found.faces[number - 1], np.zeros(3, np.float32)):
            faces = found.faces.copy()
            faces[number] = other
            assert not is_fitting(replace(found, faces=faces), triangles(count))


def triangles(count):
    ends = np.array([[0, 1], [1, 2], [2, 0]])
    return Connectivity(ends, np.tile([0, 1, 2], count), np.arange(0, 3 * count, 3))


@pytest.mark.parametrize("mode", ["EDIT", "SCULPT", "OBJECT"])
def test_an_update_says_that_it_keeps_no_selection_or_mask(rounded_box, capfd, mode):
    box = rounded_box()
    upper = read_positions(box.data)[:, 2] > 0.0
    bpy.ops.object.mode_set(mode=mode)
    if mode == "EDIT":
        mesh = bmesh.from_edit_mesh(box.data)
        for vertex in mesh.verts:
            vertex.select = bool(upper[vertex.index])
        mesh.select_flush_mode()
    elif mode == "SCULPT":
        mask = box.data.attributes.new(".sculpt_mask", "FLOAT", "POINT")
        mask.data.foreach_set("value", 1.0 - upper)
    sharpen(output="LIVE")
    bpy.ops.object.mode_set(mode="OBJECT")
    settled = (seen(box) == read_positions(box.data))[~upper].all()
    assert settled == (mode != "OBJECT")
    capfd.readouterr()
    for is_said in (mode != "OBJECT", False):  # the result is one of the whole mesh then
        assert bpy.ops.shock_filter.update_live() == {"FINISHED"}
        assert (f"{box.name}: changes as a whole" in capfd.readouterr().out) == is_said
        assert (seen(box) != read_positions(box.data))[~upper].any()
