# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators Mark Creases, Show Creases and Hide Creases, and the marks of sharpening."""

from itertools import pairwise
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from shock_filter.core.host.creases import creases_of
from shock_filter.shock_addon.data.mesh.creases import ANGLE, LINE, read_creases
from shock_filter.shock_addon.data.mesh.meshes import read_positions
from shock_filter.shock_addon.flow import creases as drawn
from shock_filter.shock_addon.flow import showing
from shock_filter.shock_addon.operators import base


def mark_creases(**choices):
    return bpy.ops.shock_filter.mark_creases(**choices)


def values(mesh, name, kind=float):
    found = np.empty(len(mesh.edges), dtype=kind)
    mesh.attributes[name].data.foreach_get("value", found)
    return found


def ends(mesh):
    found = np.empty(2 * len(mesh.edges), dtype=np.int32)
    mesh.edges.foreach_get("vertices", found)
    return found.reshape(-1, 2)


def loose_ends(mesh, marked):
    return int((np.bincount(ends(mesh)[marked].reshape(-1)) == 1).sum())


def at_edges_of_box(mesh):
    points = np.abs(read_positions(mesh))
    return (points > 0.85 * points.max(axis=0)).sum(axis=1) >= 2


def test_marks_go_around_a_rounded_box_of_quads_and_nothing_moves(rounded_box):
    box = rounded_box()
    before = read_positions(box.data)
    assert mark_creases() == {"FINISHED"}
    np.testing.assert_array_equal(read_positions(box.data), before)
    marked = values(box.data, "sharp_edge", bool)
    assert 100 < marked.sum() < 200
    assert loose_ends(box.data, marked) == 0
    assert at_edges_of_box(box.data)[ends(box.data)[marked]].all()


@pytest.mark.parametrize(
    ("kind", "name"),
    [("SEAM", "uv_seam"), ("CREASE", "crease_edge"), ("BEVEL", "bevel_weight_edge")],
)
def test_other_marks_lie_at_the_same_edges(rounded_box, kind, name):
    box = rounded_box()
    mark_creases(marks={"SHARP", kind})
    sharp = values(box.data, "sharp_edge", bool)
    np.testing.assert_array_equal(values(box.data, name), sharp.astype(float))


def test_marks_that_are_there_stay(rounded_box):
    box = rounded_box()
    middle = int(np.flatnonzero(~at_edges_of_box(box.data)[ends(box.data)].any(axis=1))[0])
    box.data.edges[middle].use_edge_sharp = True
    mark_creases()
    assert values(box.data, "sharp_edge", bool)[middle]


@pytest.fixture
def leaning_box(rounded_box):
    """A smooth box with custom normals."""
    box = rounded_box()
    bpy.ops.object.shade_smooth()
    box.data.normals_split_custom_set(corner_normals(box.data) + np.float32([0.0, 0.0, 0.4]))
    return box


def corner_normals(mesh):
    found = np.empty(3 * len(mesh.loops), dtype=np.float32)
    mesh.corner_normals.foreach_get("vector", found)
    return found.reshape(-1, 3)


def test_sharp_marks_that_would_turn_custom_normals_are_refused(leaning_box, rounded_box, select):
    mesh = leaning_box.data
    before, marked = corner_normals(mesh), values(mesh, "sharp_edge", bool)
    with pytest.raises(RuntimeError, match="would turn its custom normals; set Custom Normals"):
        mark_creases(marks={"SHARP", "SEAM"})
    assert "uv_seam" not in mesh.attributes
    other = rounded_box()
    select(leaning_box, other)
    assert mark_creases() == {"FINISHED"}
    np.testing.assert_array_equal(values(mesh, "sharp_edge", bool), marked)
    np.testing.assert_array_equal(corner_normals(mesh), before)
    assert values(other.data, "sharp_edge", bool).any()


@pytest.mark.parametrize(
    "choices",
    [{"marks": {"SEAM", "CREASE", "BEVEL"}}, {"output": "ATTRIBUTE"}, {"output": "CURVES"}],
    ids=["marks", "attribute", "curves"],
)
def test_what_leaves_custom_normals_alone_goes_on(leaning_box, choices):
    before = corner_normals(leaning_box.data)
    assert mark_creases(**choices) == {"FINISHED"}
    np.testing.assert_allclose(corner_normals(leaning_box.data), before, atol=1e-3)


@pytest.mark.parametrize("custom_normals", ["RECOMPUTE", "CLEAR"])
def test_sharp_marks_break_custom_normals_that_need_not_stay(leaning_box, custom_normals):
    bpy.context.scene.shock_filter.geometry.custom_normals = custom_normals
    assert mark_creases() == {"FINISHED"}
    mesh = leaning_box.data
    assert mesh.has_custom_normals == (custom_normals == "RECOMPUTE")
    assert values(mesh, "sharp_edge", bool).sum() > 100
    marked = corner_normals(mesh)
    with bpy.context.temp_override(object=leaning_box, active_object=leaning_box, mesh=mesh):
        bpy.ops.mesh.customdata_custom_splitnormals_clear()
    np.testing.assert_allclose(marked, corner_normals(mesh), atol=1e-3)


def test_attributes_hold_angles_and_numbers_of_lines(rounded_box):
    box = rounded_box()
    mark_creases(output="ATTRIBUTE")
    angles, lines = values(box.data, ANGLE), values(box.data, LINE, int)
    assert ((angles != 0) == (lines > 0)).all()
    assert np.median(np.degrees(angles[lines > 0])) == pytest.approx(90, abs=5)
    assert lines.max() >= 12


def test_curves_lie_where_the_lines_are(rounded_box):
    box = rounded_box(location=(3.0, 0.0, 0.0))
    count = len(bpy.data.objects)
    mark_creases(output="CURVES")
    assert len(bpy.data.objects) == count + 1
    (curves,) = [obj for obj in bpy.data.objects if obj.type == "CURVE"]
    assert len(curves.data.splines) >= 12
    assert curves.matrix_world.translation.x == 3.0
    points = [tuple(p.co[:3]) for spline in curves.data.splines for p in spline.points]
    assert set(points) <= {tuple(row) for row in read_positions(box.data).tolist()}


def curves_of(box):
    mark_creases(output="CURVES")
    (curves,) = [obj for obj in bpy.data.objects if obj.type == "CURVE"]
    return curves


def at_some_frames(*objects):
    for frame in (1, 4, 9):
        bpy.context.scene.frame_set(frame)
        yield [np.array(obj.matrix_world) for obj in objects]


def test_curves_follow_parent_and_animation(rounded_box):
    box = rounded_box(location=(1.0, 0.0, 0.0))
    parent = bpy.data.objects.new("Parent", None)
    bpy.context.collection.objects.link(parent)
    box.parent = parent
    box.matrix_parent_inverse = Matrix.Translation((0.0, 2.0, 0.0))
    box.delta_scale = (1.0, 1.0, 2.0)
    parent.rotation_euler.z = 0.5
    for obj in (box, parent):
        obj.keyframe_insert("location", frame=1)
        obj.location.z += 3.0
        obj.keyframe_insert("location", frame=9)
    box.driver_add("rotation_euler", 0).driver.expression = "0.1 * frame"
    curves = curves_of(box)
    assert curves.parent == parent
    places = list(at_some_frames(box, curves))
    for place, of_curves in places:
        np.testing.assert_array_equal(of_curves, place)
    assert all((first != second).any() for (first, _), (second, _) in pairwise(places))


def test_curves_follow_constraints_and_bones(rounded_box):
    box = rounded_box()
    goal = bpy.data.objects.new("Goal", None)
    bones = bpy.data.objects.new("Bones", bpy.data.armatures.new("Bones"))
    for obj in (goal, bones):
        bpy.context.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = bones
    bpy.ops.object.mode_set(mode="EDIT")
    bone = bones.data.edit_bones.new("Arm")
    bone.tail = (0.0, 1.0, 0.5)
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.view_layer.objects.active = box
    box.parent, box.parent_type, box.parent_bone = bones, "BONE", "Arm"
    box.constraints.new("COPY_ROTATION").target = goal
    curves = curves_of(box)
    bones.pose.bones["Arm"].location = (1.0, 2.0, 3.0)
    goal.rotation_euler = (0.1, 0.2, 0.3)
    bpy.context.view_layer.update()
    assert curves.matrix_world == box.matrix_world
    assert box.matrix_world.translation.length > 1.0
    assert box.matrix_world.to_euler().z == pytest.approx(0.3)


def test_curves_do_not_bend_with_a_parent_that_bends_the_mesh(rounded_box):
    box = rounded_box()
    lattice = bpy.data.objects.new("Lattice", bpy.data.lattices.new("Lattice"))
    bpy.context.collection.objects.link(lattice)
    box.parent, box.parent_type = lattice, "LATTICE"
    curves = curves_of(box)
    assert (curves.parent, curves.parent_type) == (lattice, "OBJECT")


def test_marks_end_at_a_mask(rounded_box):
    box = rounded_box()
    right = read_positions(box.data)[:, 0] > 0
    box.vertex_groups.new(name="Right").add(np.flatnonzero(right).tolist(), 1.0, "REPLACE")
    bpy.context.scene.shock_filter.geometry.vertex_group = "Right"
    mark_creases()
    marked = values(box.data, "sharp_edge", bool)
    assert marked.any()
    assert right[ends(box.data)[marked]].all()


def test_what_is_sharp_already_is_marked_by_sharpening(capfd):
    bpy.ops.mesh.primitive_cube_add()
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.subdivide(number_cuts=7)
    bpy.ops.object.mode_set(mode="OBJECT")
    mesh = bpy.context.object.data
    before = read_positions(mesh)
    assert bpy.ops.shock_filter.sharpen_geometry() == {"FINISHED"}
    np.testing.assert_array_equal(read_positions(mesh), before)
    assert values(mesh, "sharp_edge", bool).sum() == 12 * 8
    assert "marked as sharp: 96" in capfd.readouterr().out


def test_sharpening_marks_what_was_found_before(rounded_box):
    box = rounded_box()
    mark_creases()
    before = values(box.data, "sharp_edge", bool)
    other = rounded_box()
    bpy.ops.shock_filter.sharpen_geometry()
    np.testing.assert_array_equal(values(other.data, "sharp_edge", bool), before)


def test_shown_lines_follow_widest_fillet(rounded_box, monkeypatch):
    box = rounded_box()
    panel = bpy.context.scene.shock_filter.geometry
    no_mask = SimpleNamespace(vertex_group="", invert_mask=False, selected_only=False)
    surface = read_creases(box, "OBJECT", no_mask, np.radians(30))[1]
    panel.widest_fillet = 4.0
    settings = drawn.settings_of(drawn.find("geometry"), panel)
    shown = drawn.CreasesOfMesh(box, surface, panel, creases_of(surface, settings, True))
    assert shown.fits(box.data)
    wide = shown.segments()
    assert set(wide) == {"closes"}
    assert "will close" in drawn.counts_of(shown.now()[0].lines)
    old = drawn.said_of("Box", shown.now()[0].lines)
    monkeypatch.setitem(base.summaries, "geometry", "")
    shown.say(old)
    panel.widest_fillet = 0.01
    _, is_news = shown.now()
    assert is_news
    assert base.summaries["geometry"] == drawn.said_of(box.name, shown.now()[0].lines) != old
    assert not shown.now()[1]
    assert sum(map(len, shown.segments().values())) > 0
    box.data.vertices[0].co.x += 1.0
    assert not shown.fits(box.data)


def test_show_and_hide(rounded_box):
    rounded_box()
    assert bpy.ops.shock_filter.show_creases() == {"FINISHED"}
    assert showing.shown_object("creases") is None  # there is no window
    assert not bpy.ops.shock_filter.hide_creases.poll()


def test_a_soft_box_becomes_a_low_poly_with_its_materials_and_uvs(rounded_box):
    box = rounded_box(location=(2.0, 0.0, 0.0), cuts=19)
    for name in ("One", "Two"):
        box.data.materials.append(bpy.data.materials.new(name))
    for polygon in box.data.polygons:
        polygon.material_index = int(polygon.center.z > 0.9)
    assert bpy.ops.shock_filter.crisp_low_poly() == {"FINISHED"}
    assert " s. The original is hidden." in base.summaries["geometry"]
    low = bpy.context.object
    assert low is not box
    assert box.hide_get()
    assert len(low.data.polygons) < 0.1 * len(box.data.polygons)
    assert low.matrix_world.translation.x == 2.0
    assert [each.name for each in low.data.materials] == ["One", "Two"]
    top = [polygon for polygon in low.data.polygons if polygon.material_index == 1]
    assert top
    assert all(polygon.center.z > 0.8 for polygon in top)
    edges = {}
    for polygon in low.data.polygons:
        for key in polygon.edge_keys:
            edges[key] = edges.get(key, 0) + 1
    assert set(edges.values()) == {2}
    uv = np.empty(2 * len(low.data.loops), dtype=np.float32)
    low.data.uv_layers[0].uv.foreach_get("vector", uv)
    assert np.ptp(uv) > 0.3


@pytest.mark.parametrize(("tolerance", "is_told"), [(5.0, True), (0.25, False)])
def test_a_low_poly_that_cuts_off_what_is_round_says_so(tolerance, is_told, capfd):
    bpy.ops.mesh.primitive_cylinder_add(vertices=64)
    assert bpy.ops.shock_filter.crisp_low_poly(tolerance=tolerance) == {"FINISHED"}
    assert ("of the volume" in capfd.readouterr().out) == is_told


@pytest.mark.parametrize("smooth", ["none", "all", "half"])
def test_a_low_poly_is_as_smooth_as_its_original_with_sharp_creases(smooth):
    bpy.ops.mesh.primitive_cylinder_add(vertices=64)
    cylinder = bpy.context.object
    remesh = cylinder.modifiers.new("Remesh", "REMESH")
    remesh.voxel_size = 0.1
    bpy.ops.object.modifier_apply(modifier=remesh.name)
    for face in cylinder.data.polygons:
        face.use_smooth = smooth == "all" or (smooth == "half" and face.center.z > 0.9)
    assert bpy.ops.shock_filter.crisp_low_poly() == {"FINISHED"}
    low = bpy.context.object.data
    flat = [face for face in low.polygons if not face.use_smooth]
    if smooth == "none":
        assert len(flat) == len(low.polygons)
        return
    assert bool(flat) == (smooth == "half")
    assert all(face.use_smooth for face in low.polygons if face.center.z > 0.99)
    sides, caps = (
        {key for face in low.polygons if (abs(face.normal.z) > 0.5) == is_cap
         for key in face.edge_keys}
        for is_cap in (False, True)
    )  # fmt: skip
    sharp = {edge.key for edge in low.edges if edge.use_edge_sharp}
    assert sides & caps <= sharp
    assert len(sharp - caps) < 0.05 * len(sides)


def test_objects_that_share_a_mesh_share_its_low_poly(rounded_box):
    box = rounded_box(cuts=19)
    box.data.materials.append(bpy.data.materials.new("Gray"))
    twin = box.copy()
    twin.location.x = 5.0
    twin.material_slots[0].link = "OBJECT"
    twin.material_slots[0].material = bpy.data.materials.new("Red")
    bpy.context.collection.objects.link(twin)
    twin.select_set(True)
    assert bpy.ops.shock_filter.crisp_low_poly() == {"FINISHED"}
    assert box.hide_get() and twin.hide_get()
    one, other = sorted(bpy.context.selected_objects, key=lambda obj: obj.location.x)
    assert one.data == other.data
    assert (one.location.x, other.location.x) == (0.0, 5.0)
    assert [each.active_material.name for each in (one, other)] == ["Gray", "Red"]
    assert box.hide_render and twin.hide_render
    assert "Cube low poly, Cube.001 low poly: " in base.summaries["geometry"]


def test_a_low_poly_takes_the_place_of_its_original_in_other_scenes_and_layers(rounded_box):
    box = rounded_box()
    other = bpy.data.scenes.new("Other")
    other.collection.objects.link(box)
    layers = [*other.view_layers, bpy.context.scene.view_layers.new("Hidden"),
              bpy.context.view_layer]  # fmt: skip
    for each in layers:
        each.update()
    box.hide_set(True, view_layer=layers[1])
    assert bpy.ops.shock_filter.crisp_low_poly() == {"FINISHED"}
    low = bpy.context.object
    assert [box.hide_get(view_layer=each) for each in layers] == [True, True, True]
    assert [low.hide_get(view_layer=each) for each in layers] == [False, True, False]


def doubled_by_a_modifier(box):
    array = box.modifiers.new("Array", "ARRAY")
    array.use_relative_offset, array.use_constant_offset = False, True
    array.constant_offset_displace = (4.0, 0.0, 0.0)


def stretched_by_a_key(box):
    box.shape_key_add(name="Basis")
    key = box.shape_key_add(name="Long")
    for point in key.points:
        point.co.x *= 3.0
    key.value = 1.0


@pytest.mark.parametrize("change", [doubled_by_a_modifier, stretched_by_a_key])
def test_what_is_seen_becomes_a_low_poly(rounded_box, change):
    box = rounded_box()
    box.data.materials.append(bpy.data.materials.new("Gray"))
    change(box)
    twin = box.copy()
    bpy.context.collection.objects.link(twin)
    twin.select_set(False)
    bpy.context.view_layer.update()
    assert bpy.ops.shock_filter.crisp_low_poly() == {"FINISHED"}
    low = bpy.context.object
    np.testing.assert_allclose(low.dimensions, box.dimensions, atol=0.2)
    assert list(low.data.materials) == list(box.data.materials)
    assert low.data.uv_layers and not low.modifiers
    assert not twin.hide_get()


@pytest.fixture
def linked_box(rounded_box, tmp_path, select):
    """Return a selected box that is linked from another file."""
    path = str(tmp_path / "box.blend")
    bpy.data.libraries.write(path, {rounded_box()})
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        wanted.objects = ["Cube"]
    bpy.context.collection.objects.link(wanted.objects[0])
    select(wanted.objects[0])
    return wanted.objects[0]


def test_what_only_looks_at_a_mesh_takes_a_linked_one(linked_box, monkeypatch):
    shown_objects = []
    monkeypatch.setattr(showing, "show", lambda obj, _: shown_objects.append(obj))
    assert bpy.ops.shock_filter.show_creases() == {"FINISHED"}
    assert bpy.ops.shock_filter.show_flow(mode="geometry") == {"FINISHED"}
    assert shown_objects == [linked_box, linked_box]
    assert bpy.ops.shock_filter.mark_creases(output="CURVES") == {"FINISHED"}
    assert any(obj.type == "CURVE" and obj.library is None for obj in bpy.context.scene.objects)
    for press in (
        lambda: bpy.ops.shock_filter.mark_creases(output="MARKS"),
        lambda: bpy.ops.shock_filter.show_flow(mode="geometry", attributes=True),
    ):
        with pytest.raises(RuntimeError, match="linked from another file"):
            press()


def test_linked_objects_become_a_low_poly(linked_box):
    assert bpy.ops.shock_filter.crisp_low_poly() == {"FINISHED"}
    low = bpy.context.object
    assert low.library is None and low.data.library is None and len(low.data.polygons) < 200


def test_a_low_poly_follows_the_parent_of_what_it_was_made_of(rounded_box):
    box = rounded_box()
    bpy.ops.object.empty_add(location=(0.0, 0.0, 3.0))
    parent = bpy.context.object
    box.parent, box["own"] = parent, 7
    parent.select_set(False)
    box.select_set(True)
    bpy.ops.shock_filter.crisp_low_poly()
    low = next(obj for obj in bpy.context.selected_objects if obj != box)
    assert low.parent == parent and low["own"] == 7
    assert low.matrix_world == box.matrix_world


def test_new_objects_are_made_in_object_mode(rounded_box):
    rounded_box()
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="made in Object Mode; go there first"):
        bpy.ops.shock_filter.crisp_low_poly()  # it has no other output
    with pytest.raises(RuntimeError, match="made in Object Mode; go there, or choose another"):
        bpy.ops.shock_filter.mark_creases(output="CURVES")
    assert bpy.ops.shock_filter.mark_creases() == {"FINISHED"}
    bpy.ops.object.mode_set(mode="OBJECT")
    assert len(bpy.context.scene.objects) == 1
