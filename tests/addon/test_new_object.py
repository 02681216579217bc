# SPDX-License-Identifier: GPL-3.0-or-later
"""The output New Object: what is seen, with modifiers applied, in an object of its own."""

from functools import partial

import bpy
import numpy as np
import pytest
from shock_filter.shock_addon.data import chosen
from shock_filter.shock_addon.data.mesh.meshes import read_positions
from shock_filter.shock_addon.data.skipped import Refused
from shock_filter.shock_addon.modes import find
from shock_filter.shock_addon.operators import base as operators
from shock_filter.shock_addon.operators import poll
from shock_filter.shock_addon.preview import meshes as preview_meshes

sharpen = partial(bpy.ops.shock_filter.sharpen_geometry, where="everywhere")
denoise = bpy.ops.shock_filter.denoise


def seen(obj):
    """The positions that Blender shows."""
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return read_positions(evaluated.data)


def in_world(obj, positions):
    matrix = np.array(obj.matrix_world)
    return positions @ matrix[:3, :3].T + matrix[:3, 3]


@pytest.fixture
def subdivided(rounded_box):
    """A box, moved, turned and scaled, with a subdivision that has faces of its own."""
    box = rounded_box()
    box.location, box.rotation_euler, box.scale = (1, 2, 3), (0.3, 0.2, 0.1), (2, 1, 1)
    modifier = box.modifiers.new("Finer", "SUBSURF")
    modifier.subdivision_type, modifier.levels = "SIMPLE", 1
    bpy.context.view_layer.update()
    return box


def test_it_holds_what_is_seen_and_the_original_stays(subdivided):
    before, shown = read_positions(subdivided.data), seen(subdivided)
    assert sharpen(output="OBJECT") == {"FINISHED"}
    new = bpy.data.objects[f"{subdivided.name} sharpened"]
    assert new.data.name == new.name
    assert len(new.modifiers) == 0
    assert len(read_positions(new.data)) == len(shown) > len(before)
    np.testing.assert_array_equal(read_positions(subdivided.data), before)
    np.testing.assert_array_equal(seen(subdivided), shown)
    assert len(subdivided.modifiers) == 1
    bpy.context.view_layer.update()
    assert new.matrix_world == subdivided.matrix_world
    assert not np.array_equal(read_positions(new.data), shown)
    # The same as if the modifier had been applied by hand.
    applied = subdivided.copy()
    applied.data = bpy.data.meshes.new_from_object(
        subdivided.evaluated_get(bpy.context.evaluated_depsgraph_get())
    )
    applied.modifiers.clear()
    bpy.context.collection.objects.link(applied)
    new.select_set(False)
    applied.select_set(True)
    bpy.context.view_layer.objects.active = applied
    sharpen()
    np.testing.assert_array_equal(read_positions(applied.data), read_positions(new.data))


def test_the_new_object_takes_the_place_of_the_old_one(subdivided):
    other = bpy.data.collections.new("Other")
    bpy.context.scene.collection.children.link(other)
    other.objects.link(subdivided)
    sharpen(output="OBJECT")
    new = bpy.context.object
    assert new.name == f"{subdivided.name} sharpened"
    assert bpy.context.selected_objects == [new]
    assert set(new.users_collection) == set(subdivided.users_collection)
    assert (subdivided.hide_get(), subdivided.hide_render) == (True, True)
    assert (new.hide_get(), new.hide_render) == (False, False)
    said = operators.summaries["geometry"]
    assert f"New: {new.name}. The original is hidden." in said
    assert "Modifiers were left" not in said


def test_materials_and_uvs_are_kept(subdivided):
    for name, link in (("Of Mesh", "DATA"), ("Of Object", "OBJECT")):
        subdivided.data.materials.append(None)
        slot = subdivided.material_slots[-1]
        slot.link = link
        slot.material = bpy.data.materials.new(name)
    subdivided.data.uv_layers.new(name="Map")
    sharpen(output="OBJECT")
    new = bpy.context.object
    assert [slot.material.name for slot in new.material_slots] == ["Of Mesh", "Of Object"]
    assert "Map" in new.data.uv_layers


def test_undo_takes_it_away(subdivided, over_view):
    name = subdivided.name
    bpy.ops.ed.undo_push(message="Start")
    sharpen("EXEC_DEFAULT", True, output="OBJECT")
    count = len(bpy.data.objects)
    over_view(bpy.ops.ed.undo)
    box = bpy.data.objects[name]
    assert len(bpy.data.objects) == count - 1
    assert (box.hide_get(), box.hide_render, box.select_get()) == (False, False, True)


def test_a_redo_makes_one_object(subdivided, adjust):
    bpy.ops.ed.undo_push(message="Start")
    sharpen("EXEC_DEFAULT", True, output="OBJECT")
    names = bpy.data.objects.keys()
    first = read_positions(bpy.context.object.data)
    adjust(amount=0.5)
    assert bpy.data.objects.keys() == names
    assert not np.array_equal(read_positions(bpy.context.object.data), first)


def test_shape_keys_are_applied(rounded_box):
    box = rounded_box()
    box.shape_key_add(name="Basis", from_mix=False)
    lifted = box.shape_key_add(name="Lifted", from_mix=False)
    for point in lifted.points:
        point.co.z += 1.0
    lifted.value = 0.5
    shown = seen(box)
    sharpen(output="OBJECT", time=0.0)
    new = bpy.context.object
    assert new.data.shape_keys is None
    np.testing.assert_array_equal(read_positions(new.data), shown)
    assert len(box.data.shape_keys.key_blocks) == 2


def test_objects_that_share_a_mesh_get_one_each(subdivided):
    twin = subdivided.copy()
    twin.modifiers[0].levels = 0
    bpy.context.collection.objects.link(twin)
    twin.select_set(True)
    sharpen(output="OBJECT")
    sizes = {len(obj.data.vertices) for obj in bpy.context.selected_objects}
    assert len(bpy.context.selected_objects) == len(sizes) == 2


def test_objects_bent_by_their_parent_are_not_bent_twice(rounded_box):
    box = rounded_box()
    armature = bpy.data.objects.new("Rig", bpy.data.armatures.new("Rig"))
    bpy.context.collection.objects.link(armature)
    box.parent, box.parent_type = armature, "ARMATURE"
    sharpen(output="OBJECT")
    new = bpy.context.object
    assert (new.parent, new.parent_type) == (armature, "OBJECT")


def test_a_vertex_group_protects_what_modifiers_make_of_it(subdivided):
    group = subdivided.vertex_groups.new(name="Right")
    x = read_positions(subdivided.data)[:, 0]
    group.add(np.flatnonzero(x > 0).tolist(), 1.0, "REPLACE")
    shown = seen(subdivided)
    sharpen(output="OBJECT", vertex_group="Right")
    moved = (read_positions(bpy.context.object.data) != shown).any(axis=1)
    assert moved.any()
    assert not moved[shown[:, 0] < -0.2].any()


def test_multiresolution_is_sharpened_as_it_is_seen(rounded_box):
    box = rounded_box()
    box.modifiers.new("Detail", "MULTIRES")
    bpy.ops.object.multires_subdivide(modifier="Detail", mode="SIMPLE")
    shown = seen(box)
    assert len(shown) > len(box.data.vertices)
    assert sharpen(output="OBJECT") == {"FINISHED"}
    assert len(bpy.context.object.data.vertices) == len(shown)


def test_both_denoises_shape_and_colors(painted_sheet):
    sheet = painted_sheet()
    sheet.modifiers.new("Finer", "SUBSURF").levels = 1
    assert denoise(target="both", output="OBJECT") == {"FINISHED"}
    new = bpy.context.object
    assert new.name == f"{sheet.name} denoised"
    assert "Paint" in new.data.color_attributes


def test_colors_alone_stay_in_their_object(painted_sheet):
    sheet = painted_sheet()
    count = len(bpy.data.objects)
    assert denoise(target="colors", output="OBJECT") == {"FINISHED"}
    assert (len(bpy.data.objects), bpy.context.object) == (count, sheet)


def test_it_is_refused_outside_object_mode(rounded_box):
    rounded_box()
    bpy.ops.object.mode_set(mode="EDIT")
    sentence = "New objects are made in Object Mode; go there, or choose another output."
    with pytest.raises(RuntimeError, match=sentence):
        sharpen(output="OBJECT")
    settings = bpy.context.scene.shock_filter.geometry
    settings.output = "OBJECT"
    assert poll.of_mode(bpy.context, find("geometry"), settings) == sentence
    bpy.ops.object.mode_set(mode="OBJECT")
    assert poll.of_mode(bpy.context, find("geometry"), settings) == ""


MAKE_FACES = ["REMESH", "BOOLEAN", "BEVEL", "SUBSURF"]


def nodes_modifier(box, name):
    modifier = box.modifiers.new("Nodes", "NODES")
    group = bpy.data.node_groups.new(name, "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    ends = [group.nodes.new(f"NodeGroup{way}") for way in ("Input", "Output")]
    group.links.new(ends[0].outputs[0], ends[1].inputs[0])
    modifier.node_group = group
    return modifier


@pytest.mark.parametrize("kind", MAKE_FACES)
def test_a_modifier_that_makes_faces_chooses_it_by_itself(rounded_box, kind):
    modifier = rounded_box().modifiers.new("Top", kind)
    box = bpy.context.object
    settings = bpy.context.scene.shock_filter.geometry
    assert settings.output == "AUTO"
    said = poll.announcement(bpy.context, find("geometry"), settings)
    assert said.startswith("New Object: Top is the last modifier")
    settings.output = "LIVE"
    said = poll.announcement(bpy.context, find("geometry"), settings)
    assert said.startswith("Live copy: Top is the last modifier")
    settings.output = "MESH"
    assert poll.announcement(bpy.context, find("geometry"), settings) == ""
    settings.output = "AUTO"
    assert chosen.modifier_on_top(box) == modifier
    modifier.show_viewport = False
    assert poll.announcement(bpy.context, find("geometry"), settings) == ""


def test_what_is_sharpened_is_what_is_seen(subdivided):
    before, shown = read_positions(subdivided.data), seen(subdivided)
    assert sharpen() == {"FINISHED"}
    new = bpy.context.object
    assert new.name == f"{subdivided.name} sharpened"
    assert len(read_positions(new.data)) == len(shown)
    np.testing.assert_array_equal(read_positions(subdivided.data), before)
    assert subdivided.hide_get()
    # Pressed again, the new object has no modifiers, and changes in place.
    count = len(bpy.data.objects)
    assert sharpen(amount=0.5) == {"FINISHED"}
    assert len(bpy.data.objects) == count


@pytest.mark.parametrize("above", ["WEIGHTED_NORMAL", "TRIANGULATE", "Smooth by Angle"])
def test_what_leaves_the_shape_does_not_count_as_on_top(rounded_box, above):
    box = rounded_box()
    if " " in above:
        nodes_modifier(box, above)
    else:
        box.modifiers.new("Above", above)
    assert chosen.modifier_on_top(box) is None
    bevel = box.modifiers.new("Bevel", "BEVEL")
    box.modifiers.move(1, 0)
    assert chosen.modifier_on_top(box) == bevel


def test_geometry_nodes_count_and_what_bends_does_not(rounded_box):
    box = rounded_box()
    assert chosen.modifier_on_top(box) is None
    nodes = nodes_modifier(box, "Mine")
    assert chosen.modifier_on_top(box) == nodes
    box.modifiers.new("Bend", "SIMPLE_DEFORM")
    assert chosen.modifier_on_top(box) is None


@pytest.mark.parametrize("output", ["MESH", "SHAPE_KEY"])
def test_an_explicit_choice_stays_possible(subdivided, output):
    before, count = read_positions(subdivided.data), len(bpy.data.objects)
    settings = bpy.context.scene.shock_filter.geometry
    settings.output = output
    assert poll.announcement(bpy.context, find("geometry"), settings) == ""
    assert sharpen(output=output) == {"FINISHED"}
    assert len(bpy.data.objects) == count
    assert np.array_equal(read_positions(subdivided.data), before) == (output == "SHAPE_KEY")
    assert (subdivided.data.shape_keys is not None) == (output == "SHAPE_KEY")


def test_each_object_by_itself(rounded_box, select):
    plain = rounded_box()
    other = rounded_box(location=(5, 0, 0))
    other.modifiers.new("Finer", "SUBSURF")
    select(plain, other)
    before = read_positions(plain.data), read_positions(other.data)
    assert sharpen() == {"FINISHED"}
    assert not np.array_equal(read_positions(plain.data), before[0])
    np.testing.assert_array_equal(read_positions(other.data), before[1])
    assert (plain.hide_get(), other.hide_get()) == (False, True)
    said = operators.summaries["geometry"]
    assert f"New: {other.name} sharpened. The original is hidden." in said


def test_in_other_modes_the_mesh_changes_as_before(subdivided):
    settings = bpy.context.scene.shock_filter.geometry
    bpy.ops.object.mode_set(mode="SCULPT")
    assert poll.announcement(bpy.context, find("geometry"), settings) == ""
    assert poll.of_mode(bpy.context, find("geometry"), settings) == ""
    count = len(bpy.data.objects)
    assert sharpen() == {"FINISHED"}
    assert len(bpy.data.objects) == count


def test_what_changes_nothing_leaves_no_copy(subdivided):
    counts = len(bpy.data.objects), len(bpy.data.meshes)
    assert sharpen(amount=0.0, mark_sharp=False) == {"FINISHED"}
    assert (len(bpy.data.objects), len(bpy.data.meshes)) == counts
    assert not subdivided.hide_get()
    said = operators.summaries["geometry"]
    assert "Nothing has changed, so no new object was made." in said
    assert "apply them first" not in said
    assert "left in place" not in said


def test_nothing_is_left_of_what_fails():
    bpy.ops.mesh.primitive_circle_add()
    circle = bpy.context.object
    counts = len(bpy.data.objects), len(bpy.data.meshes)
    with pytest.raises(RuntimeError, match="it has no faces"):
        sharpen(output="OBJECT")
    assert (len(bpy.data.objects), len(bpy.data.meshes)) == counts
    assert not circle.hide_get()


def test_modifiers_may_make_the_faces(rounded_box):
    bpy.ops.mesh.primitive_circle_add(vertices=24)
    circle = bpy.context.object
    circle.rotation_euler = (1.0, 0.0, 0.0)
    circle.modifiers.new("Turn", "SCREW").screw_offset = 2.0
    assert sharpen(output="OBJECT") == {"FINISHED"}
    assert bpy.context.object.data.polygons


@pytest.mark.parametrize("is_overridden", [False, True])
def test_objects_of_linked_collections_are_read(rounded_box, select, tmp_path, is_overridden):
    made = bpy.data.collections.new("Made")
    made.objects.link(rounded_box())
    path = str(tmp_path / "library.blend")
    bpy.data.libraries.write(path, {made})
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        wanted.collections = ["Made"]
    (linked,) = wanted.collections
    scene = bpy.context.scene
    if is_overridden:
        linked.override_hierarchy_create(scene, bpy.context.view_layer)
    else:
        scene.collection.children.link(linked)
    (box,) = scene.objects
    for press in (
        lambda: sharpen(output="OBJECT"),
        bpy.ops.shock_filter.crisp_low_poly,
        lambda: bpy.ops.shock_filter.mark_creases(output="CURVES"),
    ):
        box.hide_set(False)
        select(box)
        assert press() == {"FINISHED"}
    assert len(scene.collection.objects) == 3


def test_instances_are_said_to_be_no_faces(rounded_box):
    box = rounded_box(cuts=3)
    group = bpy.data.node_groups.new("Instances", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        group.interface.new_socket("G", in_out=direction, socket_type="NodeSocketGeometry")
    first, last = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    instances = group.nodes.new("GeometryNodeGeometryToInstance")
    group.links.new(first.outputs[0], instances.inputs[0])
    group.links.new(instances.outputs[0], last.inputs[0])
    box.modifiers.new("Instances", "NODES").node_group = group
    for press in (sharpen, bpy.ops.shock_filter.crisp_low_poly):
        with pytest.raises(RuntimeError, match="its modifiers leave no faces"):
            press()


def test_a_preview_without_modifiers_shows_the_mesh(rounded_box):
    box = rounded_box()
    bpy.context.scene.shock_filter.geometry.output = "OBJECT"
    preview = preview_meshes.begin(bpy.context, None, find("geometry"))
    assert preview.stage._target.place.output == "MESH"
    preview.end()
    box.modifiers.new("Finer", "SUBSURF")
    for output in ("OBJECT", "AUTO"):
        bpy.context.scene.shock_filter.geometry.output = output
        with pytest.raises(Refused, match="Preview shows the mesh without its modifiers"):
            preview_meshes.begin(bpy.context, None, find("geometry"))
