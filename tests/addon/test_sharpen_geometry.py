# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator Sharpen Geometry."""

import re
from types import SimpleNamespace

import bmesh
import bpy
import numpy as np
import pytest
from mathutils import Matrix
from shock_filter import core
from shock_filter.shock_addon.data.mesh.meshes import (
    read_corner_vertices,
    read_positions,
    read_triangle_corners,
    write_positions,
)
from shock_filter.shock_addon.data.mesh.shading import count_marks
from shock_filter.shock_addon.operators import base as operators
from shock_filter.shock_addon.operators.meshes import notes

sharpen = bpy.ops.shock_filter.sharpen_geometry


def flatness(obj):
    """Mean over the faces of the largest component of their normal: 1 for a box."""
    normals = np.array([polygon.normal for polygon in obj.data.polygons])
    return np.abs(normals).max(axis=1).mean()


def test_a_rounded_box_becomes_crisper(rounded_box):
    box = rounded_box()
    before = flatness(box)
    assert sharpen(time=64.0) == {"FINISHED"}
    assert 1.0 - flatness(box) < 0.8 * (1.0 - before)
    assert np.isfinite(read_positions(box.data)).all()


def test_suzanne_of_quads_and_triangles_keeps_its_faces():
    bpy.ops.mesh.primitive_monkey_add()
    mesh = bpy.context.object.data
    before, faces = read_positions(mesh), [tuple(p.vertices) for p in mesh.polygons]
    assert sharpen(time=16.0) == {"FINISHED"}
    assert (read_positions(mesh) != before).any()
    assert [tuple(p.vertices) for p in mesh.polygons] == faces


def test_n_gons_go_through():
    bpy.ops.mesh.primitive_cylinder_add(vertices=24)
    mesh = bpy.context.object.data
    assert max(len(p.vertices) for p in mesh.polygons) == 24
    assert sharpen(time=16.0, feature_threshold=0.0) == {"FINISHED"}
    assert np.isfinite(read_positions(mesh)).all()


def test_time_zero_changes_no_bit(rounded_box):
    box = rounded_box()
    box.scale = (1.0, 2.0, 3.0)
    bpy.context.view_layer.update()
    before = read_positions(box.data)
    before[0, 0] = -0.0
    write_positions(box.data, before)
    assert sharpen(time=0.0) == {"FINISHED"}
    assert read_positions(box.data).tobytes() == before.tobytes()
    assert "none moved" in operators.summaries["geometry"]


def test_steady_state_is_the_infinite_time(rounded_box):
    box = rounded_box()
    start = read_positions(box.data)
    sharpen(steady_state=True, time=1.0)
    steady = read_positions(box.data)
    write_positions(box.data, start)
    sharpen(time=1e30)
    np.testing.assert_array_equal(read_positions(box.data), steady)
    write_positions(box.data, start)
    sharpen(time=1.0)
    assert (read_positions(box.data) != steady).any()


def test_several_objects_and_what_is_no_mesh(rounded_box, select):
    boxes = [rounded_box(), rounded_box(location=(5, 0, 0))]
    before = [read_positions(box.data) for box in boxes]
    bpy.ops.object.light_add()
    select(bpy.context.object, *boxes)
    assert sharpen() == {"FINISHED"}
    for box, old in zip(boxes, before, strict=True):
        assert (read_positions(box.data) != old).any()
    assert operators.summaries["geometry"].startswith("Sharpened 2 meshes: ")


def test_a_mesh_with_two_users_is_sharpened_once(rounded_box, select):
    alone, shared = rounded_box(), rounded_box()
    twin = bpy.data.objects.new("Twin", shared.data)
    bpy.context.collection.objects.link(twin)
    select(alone)
    sharpen()
    select(shared, twin)
    sharpen()
    assert operators.summaries["geometry"].startswith("Sharpened 1 mesh: ")
    np.testing.assert_array_equal(read_positions(shared.data), read_positions(alone.data))


def test_uniform_scale_changes_nothing(rounded_box, select):
    small, large = rounded_box(), rounded_box()
    large.matrix_world = Matrix.Rotation(1.0, 4, "Y") @ Matrix.Scale(1000.0, 4)
    bpy.context.view_layer.update()
    select(small, large)
    sharpen()
    np.testing.assert_array_equal(read_positions(small.data), read_positions(large.data))


def test_a_scale_of_zero_is_named(rounded_box):
    box = rounded_box()
    box.scale = (1.0, 0.0, 1.0)
    bpy.context.view_layer.update()
    before = read_positions(box.data)
    with pytest.raises(RuntimeError, match="its scale is zero along an axis"):
        sharpen()
    np.testing.assert_array_equal(read_positions(box.data), before)


def test_a_transform_without_numbers_is_named_and_others_go_on(rounded_box, select, capfd):
    broken, whole = rounded_box(), rounded_box()
    broken.scale.x = float("nan")
    bpy.context.view_layer.update()
    select(broken, whole)
    before = read_positions(broken.data)
    assert sharpen() == {"FINISHED"}
    assert f"Skipped {broken.name}: its transform holds NaN" in capfd.readouterr().out
    np.testing.assert_array_equal(read_positions(broken.data), before)
    assert (read_positions(whole.data) != before).any()


def test_creases_that_a_weak_mask_holds_are_neither_closed_nor_nothing(rounded_box):
    box = rounded_box()
    group = box.vertex_groups.new(name="Weak")
    group.add(range(len(box.data.vertices)), 1e-6, "REPLACE")
    assert sharpen(vertex_group="Weak") == {"FINISHED"}
    said = operators.summaries["geometry"]
    assert said.startswith("Sharpened 1 mesh: ")
    assert "none moved" in said
    assert "Closed creases" not in said
    assert "To keep threads" not in said


def test_loose_vertices_and_edges_stay(rounded_box):
    box = rounded_box()
    mesh = box.data
    count = len(mesh.vertices)
    corner = mesh.vertices[0].co.copy()
    mesh.vertices.add(3)
    mesh.vertices[count].co = corner  # at the place of a vertex that moves
    mesh.vertices[count + 1].co = (9.0, 9.0, 9.0)
    mesh.vertices[count + 2].co = (9.0, 9.0, 8.0)
    mesh.edges.add(1)
    mesh.edges[-1].vertices = (count + 1, count + 2)
    mesh.update()
    before = read_positions(mesh)
    sharpen()
    after = read_positions(mesh)
    assert (after[0] != before[0]).any()
    np.testing.assert_array_equal(after[count:], before[count:])


def test_seams_of_split_meshes_stay_closed_if_welded(rounded_box):
    box = rounded_box()
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.edge_split()
    bpy.ops.object.mode_set(mode="OBJECT")
    before = read_positions(box.data)
    _, place = np.unique(before, axis=0, return_inverse=True)
    assert place.max() + 1 < len(before)

    def widest_crack():
        after = read_positions(box.data)
        _, first = np.unique(place, return_index=True)
        return np.abs(after - after[first][place.reshape(-1)]).max()

    sharpen(weld=True)
    assert (read_positions(box.data) != before).any()
    assert widest_crack() == 0.0
    write_positions(box.data, before)
    sharpen(weld=False, feature_threshold=0.0)
    assert np.isfinite(widest_crack())


def test_no_faces_is_named():
    bpy.ops.mesh.primitive_circle_add(fill_type="NOTHING")
    with pytest.raises(RuntimeError, match=r"Skipped Circle: it has no faces"):
        sharpen()


def test_a_nan_is_named_and_nothing_changes(rounded_box):
    mesh = rounded_box().data
    before = read_positions(mesh)
    before[7, 1] = np.nan
    write_positions(mesh, before)
    with pytest.raises(RuntimeError, match=r"Vertex 7 .*NaN"):
        sharpen()
    np.testing.assert_array_equal(read_positions(mesh), before)


@pytest.mark.parametrize("operator", [sharpen, bpy.ops.shock_filter.denoise])
def test_a_nan_in_a_loose_vertex_is_named(rounded_box, operator):
    """Loose vertices that come before do not shift its number."""
    mesh = rounded_box().data
    count = len(mesh.vertices)
    mesh.vertices.add(3)
    before = read_positions(mesh)
    before[count + 1] = np.nan
    write_positions(mesh, before)
    with pytest.raises(RuntimeError, match=f"Vertex {count + 1} has no valid position"):
        operator()
    np.testing.assert_array_equal(read_positions(mesh), before)
    before[count + 1] = 0.0
    before[7] = np.inf
    order = np.r_[count : count + 3, :count]
    faces = [[int(v) + 3 for v in face.vertices] for face in mesh.polygons]
    mesh.clear_geometry()
    mesh.from_pydata(before[order].tolist(), [], faces)
    with pytest.raises(RuntimeError, match=r"Vertex 10 has no valid position"):
        operator()


def test_a_bad_mesh_does_not_stop_the_good_one(rounded_box, select):
    good, bad = rounded_box(), rounded_box()
    before = read_positions(good.data)
    broken = before.copy()
    broken[3] = np.inf
    write_positions(bad.data, broken)
    select(good, bad)
    assert sharpen() == {"FINISHED"}
    assert (read_positions(good.data) != before).any()
    np.testing.assert_array_equal(read_positions(bad.data), broken)


def test_only_moves_that_are_seen_count(rounded_box):
    box = rounded_box(cuts=31)
    before = read_positions(box.data)
    sharpen(time=4.0)
    moves = np.linalg.norm(read_positions(box.data) - before, axis=1)
    triangles = before[read_corner_vertices(box.data)[read_triangle_corners(box.data)]]
    edge = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).mean()
    seen = np.count_nonzero(moves > 0.02 * edge)
    said = int(re.search(r"moved ([\d,]+),", operators.summaries["geometry"])[1].replace(",", ""))
    assert 0.9 * seen < said < 1.1 * seen
    assert 0 < said < 0.9 * np.count_nonzero(moves)


@pytest.mark.parametrize(
    ("shape", "vertices", "words"),
    [
        (
            "ico_sphere",
            642,
            "round, flat and coarse parts stay. For more, set Where to Everywhere.",
        ),
        ("cube", 8, "The creases are sharp already."),
    ],
)
def test_a_mesh_may_have_nothing_to_sharpen(shape, vertices, words):
    add = getattr(bpy.ops.mesh, f"primitive_{shape}_add")
    add(subdivisions=4) if shape == "ico_sphere" else add()
    assert sharpen() == {"FINISHED"}
    said = operators.summaries["geometry"]
    assert said.startswith(f"Found nothing to sharpen in 1 mesh: {vertices} vertices, none moved, ")
    assert words in said
    assert "raise Time" not in said  # which changes nothing where there are no creases


@pytest.mark.parametrize("kind", ["CLOUDS", "noise"])
def test_steep_edges_of_what_is_uneven_all_over_are_not_marked(kind):
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=6)
    rock = bpy.context.object
    if kind == "noise":
        positions = read_positions(rock.data)
        positions += 0.005 * np.random.default_rng(0).normal(size=positions.shape)
        rock.data.vertices.foreach_set("co", positions.reshape(-1))
    else:
        rough = rock.modifiers.new("Displace", "DISPLACE")
        rough.texture, rough.strength = bpy.data.textures.new("Clouds", kind), 0.4
        bpy.ops.object.modifier_apply(modifier=rough.name)
    rock.data.shade_smooth()
    assert sharpen() == {"FINISHED"}
    built = bmesh.new()
    built.from_mesh(rock.data)
    steep = sum(edge.calc_face_angle() > np.radians(30.0) for edge in built.edges)
    built.free()
    assert steep > 1000
    assert count_marks(rock.data) < 0.06 * steep
    assert "sharp already" not in operators.summaries["geometry"]


def test_rims_of_cylinders_of_few_sides_are_marked():
    for sides in (12, 13, 20, 32):
        bpy.ops.mesh.primitive_cylinder_add(vertices=sides)
        cylinder = bpy.context.object
        cylinder.data.shade_smooth()
        assert sharpen() == {"FINISHED"}
        assert count_marks(cylinder.data) >= 2 * sides


def test_marks_are_counted_once_in_a_report():
    bpy.ops.mesh.primitive_cube_add()
    smooth = bpy.context.object
    smooth.data.shade_smooth()
    bpy.ops.mesh.primitive_cube_add(location=(4.0, 0.0, 0.0))
    assert sharpen() == {"FINISHED"}  # the flat one
    said = operators.summaries["geometry"]
    assert said.count("Edges marked as sharp") == 1
    assert "Edges marked as sharp: 12; that shows on smooth faces only" in said
    smooth.select_set(True)
    assert sharpen() == {"FINISHED"}
    said = operators.summaries["geometry"]
    assert said.count("Edges marked as sharp") == 1
    assert "Edges marked as sharp: 24; that shows on smooth faces only" in said


def test_what_modifiers_make_is_not_sharpened_in_the_mesh_and_the_panel_says_so():
    bpy.ops.mesh.primitive_cube_add()
    bpy.context.object.modifiers.new("Remesh", "REMESH")
    assert sharpen(output="MESH") == {"FINISHED"}
    said = operators.summaries["geometry"]
    assert "Found nothing to sharpen" in said
    assert "to filter their result, apply them first" in said


def test_linked_meshes_are_skipped(rounded_box, select, tmp_path):
    box = rounded_box()
    box.data.name = "Library Mesh"
    library = str(tmp_path / "library.blend")
    bpy.data.libraries.write(library, {box.data})
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(library, link=True) as (_, wanted):
        wanted.meshes = ["Library Mesh"]
    linked = bpy.data.objects.new("Linked", wanted.meshes[0])
    bpy.context.collection.objects.link(linked)
    before = read_positions(linked.data)
    select(linked)
    with pytest.raises(RuntimeError, match=r"Skipped Linked: its mesh is linked .* make it local"):
        sharpen()
    local = rounded_box()
    select(local, linked)
    assert sharpen() == {"FINISHED"}
    np.testing.assert_array_equal(read_positions(linked.data), before)


def test_nothing_selected_greys_the_button_out():
    assert not sharpen.poll()
    with pytest.raises(RuntimeError, match="Select a mesh object"):
        sharpen()


def test_modifiers_and_custom_normals_stay_and_are_noted(rounded_box):
    box = rounded_box()
    box.modifiers.new("Solid", "SOLIDIFY")
    box.data.normals_split_custom_set_from_vertices([(0.0, 0.0, 1.0)] * len(box.data.vertices))
    assert sharpen() == {"FINISHED"}
    assert [modifier.name for modifier in box.modifiers] == ["Solid"]
    assert box.data.has_custom_normals
    text = notes([box], SimpleNamespace(custom_normals="KEEP", mark_sharp=False, output="MESH"))
    assert "Modifiers were left in place" in text
    assert "Custom normals were kept" in text


def test_the_summary_counts(rounded_box):
    box = rounded_box()
    before = read_positions(box.data)
    box.data.calc_loop_triangles()
    sharpen()
    faces = [triangle.vertices[:] for triangle in box.data.loop_triangles]
    visible = 0.02 * core.TriangleMesh(before, faces).mean_edge_length
    moved = (np.linalg.norm(read_positions(box.data) - before, axis=1) > visible).sum()
    assert moved > 100
    assert (
        f"{len(before):,} vertices, moved {moved:,}, largest move"
        in operators.summaries["geometry"]
    )


def test_undo_brings_the_old_shape_back(rounded_box):
    box = rounded_box()
    name, before = box.name, read_positions(box.data)
    bpy.ops.ed.undo_push(message="Before")
    sharpen()
    bpy.ops.ed.undo_push(message="After")
    after = read_positions(bpy.data.objects[name].data)
    assert (after != before).any()
    bpy.ops.ed.undo()
    np.testing.assert_array_equal(read_positions(bpy.data.objects[name].data), before)
    bpy.ops.ed.redo()
    np.testing.assert_array_equal(read_positions(bpy.data.objects[name].data), after)


def test_undo_takes_back_what_was_said(rounded_box):
    rounded_box()
    bpy.ops.ed.undo_push(message="Before")
    sharpen("EXEC_DEFAULT", True)
    assert operators.summaries["geometry"].startswith("Sharpened 1 mesh")
    bpy.ops.ed.undo()
    assert operators.summaries == {}


def test_redo_with_other_settings_starts_from_the_old_shape(rounded_box):
    # What F9 does: undo, then execute again with new values.
    other = rounded_box()
    sharpen(time=4096.0)
    expected = read_positions(other.data)
    box = rounded_box()
    name = box.name
    bpy.ops.ed.undo_push(message="Before")
    sharpen(time=16.0)
    bpy.ops.ed.undo_push(message="After")
    bpy.ops.ed.undo()
    sharpen(time=4096.0)
    np.testing.assert_array_equal(read_positions(bpy.data.objects[name].data), expected)


def test_vertices_that_only_rounding_moves_are_not_counted():
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32)
    sphere = bpy.context.object
    before = read_positions(sphere.data)
    sharpen(time=0.001)
    moved = (read_positions(sphere.data) != before).any(axis=1).sum()
    assert moved < len(before) / 2


def test_the_same_objects_stay_in_edit_mode_whatever_is_selected(rounded_box, select):
    first, second, third = (rounded_box(location=(4 * i, 0, 0)) for i in range(3))
    select(first, second)
    bpy.ops.object.mode_set(mode="EDIT")
    second.select_set(False)
    third.select_set(True)
    assert sharpen(selected_only=False) == {"FINISHED"}
    assert [each.mode for each in (first, second, third)] == ["EDIT", "EDIT", "OBJECT"]
    assert [each.select_get() for each in (first, second, third)] == [True, False, True]
