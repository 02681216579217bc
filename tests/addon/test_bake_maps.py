# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of Bake Maps: of objects themselves, and of detailed ones onto a simple one."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from shock_filter.shock_addon.data import skipped
from shock_filter.shock_addon.operators import base as operators
from shock_filter.shock_addon.operators import generating
from shock_filter.shock_addon.running import jobs
from shock_filter.shock_addon.ui import translations

SIZE = 256


def bake(**choices):
    return bpy.ops.shock_filter.bake_maps(image_size=str(SIZE), **{"rays": 8, **choices})


def grid(name, cells, height=0.0):
    bpy.ops.mesh.primitive_grid_add(
        x_subdivisions=cells, y_subdivisions=cells, size=2, calc_uvs=True
    )
    obj = bpy.context.object
    obj.name = name
    for vertex in obj.data.vertices:
        square = vertex.co.x**2 + vertex.co.y**2
        vertex.co.z = height * np.exp(-8 * square)
    return obj


@pytest.fixture
def low(select):
    obj = grid("Low", 1)
    select(obj)
    return obj


def read(name):
    image = bpy.data.images[name]
    pixels = np.empty(SIZE * SIZE * 4, dtype=np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(SIZE, SIZE, 4)[..., :3]


def test_all_maps_of_an_object_have_names_that_others_know(low):
    assert bake() == {"FINISHED"}
    names = {image.name for image in bpy.data.images}
    assert names == {"Low_curvature", "Low_ao", "Low_thickness"}
    for image in bpy.data.images:
        assert image.is_float and image.colorspace_settings.is_data and image.packed_file
    assert np.allclose(read("Low_ao"), 1) and np.allclose(read("Low_curvature"), 0.5)
    nodes = low.active_material.node_tree.nodes
    assert {node.image.name for node in nodes if node.type == "TEX_IMAGE"} == names
    assert not nodes["Principled BSDF"].inputs["Base Color"].is_linked
    said = "Baked 3 maps of Low: Curvature, Occlusion, Thickness; "
    assert operators.summaries["maps"].startswith(said)


def test_each_button_says_before_the_press_what_it_bakes():
    """The label counts the maps that the tooltip names."""
    about = generating.SHOCK_FILTER_OT_bake_maps.description
    own, onto = (about(bpy.context, SimpleNamespace(from_selected=each)) for each in (False, True))
    assert "curvature, occlusion and thickness of all selected mesh objects" in own
    assert "onto the active one: normals, height, curvature" in onto


@pytest.mark.parametrize("kind", ["FLOAT_COLOR", "BYTE_COLOR"])
def test_a_detailed_object_comes_onto_the_active_one(low, select, kind):
    high = grid("High", 60, 0.1)
    for obj in (low, high):
        obj.location.x, obj.scale = 3, (2, 2, 2)
    colors = high.data.color_attributes.new("Paint", kind, "POINT")
    for each, vertex in zip(colors.data, high.data.vertices, strict=True):
        each.color = 0.5 + 0.5 * vertex.co.x, 0, 0, 1
    bpy.context.view_layer.update()
    select(low, high)
    assert bake(from_selected=True, cage=0.5) == {"FINISHED"}
    height, normal, color = (read(f"Low_{each}") for each in ("height", "normal", "basecolor"))
    middle = SIZE // 2
    assert height[middle, middle, 0] == pytest.approx(0.5 + 0.5 * 0.2 / 0.5, abs=0.01)
    assert np.abs(normal[middle, middle] - [0.5, 0.5, 1]).max() < 0.05
    assert normal[middle, middle + 30, 0] > 0.6 and normal[middle + 30, middle, 1] > 0.6
    assert np.abs(color[middle, :, 0] - (np.arange(SIZE) + 0.5) / SIZE).max() < 0.01
    tree = low.active_material.node_tree
    shader = tree.nodes["Principled BSDF"]
    assert shader.inputs["Normal"].links[0].from_node.type == "NORMAL_MAP"
    assert shader.inputs["Base Color"].links[0].from_node.image.name == "Low_basecolor"
    assert not high.data.materials


def test_other_visible_objects_stand_in_the_way(low, select):
    wall = grid("Wall", 1)
    wall.rotation_euler.y, wall.scale = np.pi / 2, (9, 9, 9)
    bpy.context.view_layer.update()
    select(low)
    assert bake(maps={"occlusion"}, rays=64) == {"FINISHED"}
    assert abs(read("Low_ao")[SIZE // 2, SIZE // 2 + 4, 0] - 0.5) < 0.05
    assert bake(maps={"occlusion"}, occlude=False, depth="BYTE") == {"FINISHED"}
    assert np.allclose(read("Low_ao.001"), 1)
    wall.hide_set(True)
    assert bake(maps={"occlusion"}) == {"FINISHED"}
    assert np.allclose(read("Low_ao.002"), 1)


def test_faces_of_modifiers_stand_in_the_way(low, select):
    """A wall whose mesh has edges alone, and its faces from a modifier."""
    mesh = bpy.data.meshes.new("Edge")
    mesh.from_pydata([(0, -9, -9), (0, 9, -9)], [(0, 1)], [])
    wall = bpy.data.objects.new("Wall", mesh)
    bpy.context.collection.objects.link(wall)
    modifier = wall.modifiers.new("Screw", "SCREW")
    modifier.angle, modifier.screw_offset, modifier.steps = 0, 18, 1
    modifier.render_steps = 1
    bpy.context.view_layer.update()
    select(low)
    assert bake(maps={"occlusion"}, rays=64) == {"FINISHED"}
    assert abs(read("Low_ao")[SIZE // 2, SIZE // 2 + 4, 0] - 0.5) < 0.05


def test_modifiers_of_the_detailed_object_are_read(low, select):
    """Its mesh lies on the low one; a modifier lifts it, another one adds its faces."""
    high = grid("High", 1)
    lift = high.modifiers.new("Lift", "DISPLACE")
    lift.strength, lift.mid_level = 0.1, 0
    high.modifiers.new("Fine", "SUBSURF").subdivision_type = "SIMPLE"
    bpy.context.view_layer.update()
    select(low, high)
    assert bake(from_selected=True, cage=0.2, maps={"displacement"}) == {"FINISHED"}
    assert np.allclose(read("Low_height"), 0.5 + 0.5 * 0.1 / 0.2, atol=0.01)
    assert "white is 20 cm above" in operators.details["maps"]
    assert "white" not in operators.summaries["maps"]
    lift.show_viewport = False
    assert bake(from_selected=True, cage=0.2, maps={"displacement"}) == {"FINISHED"}
    assert np.allclose(read("Low_height.001"), 0.5, atol=0.01)


def test_a_cage_that_is_too_small_is_said(low, select):
    high = grid("High", 1)
    high.location.z = 0.2
    bpy.context.view_layer.update()
    select(low, high)
    assert bake(from_selected=True, cage=0.1, maps={"normals"}) == {"FINISHED"}
    assert "within 10 cm; raise Cage to about 21 cm." in operators.summaries["maps"]


def test_the_report_is_short_and_no_warning(low, select, monkeypatch):
    """A material that is added is said; what white means is folded, with units."""
    high = grid("High", 60, 0.1)
    bpy.context.view_layer.update()
    select(low, high)
    kinds = []
    tell = jobs.ModalJob.tell
    monkeypatch.setattr(
        jobs.ModalJob, "tell", lambda self, kind, text: (kinds.append(kind), tell(self, kind, text))
    )
    assert bake(from_selected=True, cage=0.5) == {"FINISHED"}
    assert kinds == ["INFO"]
    said = operators.summaries["maps"]
    assert len(said) < 130 and "\n" not in said
    assert "Low had no material" in said
    folded = operators.details_of(bpy.context, "maps")
    assert "white is 50 cm above" in folded and " m" in folded.split("radius of")[1]


def test_objects_are_found_again_whatever_their_names(low, select):
    """One is renamed during the run and gets its maps, another takes its name and gets none."""
    gone = grid("Gone", 1)
    select(low, gone)
    meanwhile = iter([True])

    def rename(*_):
        if next(meanwhile, False):
            bpy.data.objects.remove(gone)
            low.name = "Renamed"
            other = bpy.data.objects.new("Low", low.data.copy())
            bpy.context.collection.objects.link(other)

    operators.listener = rename
    try:
        assert bake(maps={"curvature"}) == {"FINISHED"}
    finally:
        operators.listener = None
    nodes = low.active_material.node_tree.nodes
    assert [node.image.name for node in nodes if node.type == "TEX_IMAGE"] == ["Low_curvature"]
    assert bpy.data.objects["Low"].active_material is None
    assert "Skipped Gone: it was removed meanwhile." in operators.summaries["maps"]


def test_objects_that_share_a_map_are_not_called_filtered(low, select):
    other = grid("Other", 1)
    other.location.x = 3
    bpy.context.view_layer.update()
    select(low, other)
    assert bake(maps={"curvature"}) == {"FINISHED"}
    said = operators.summaries["maps"]
    assert "Faces that overlap in the texture, which holds the values of the first: 4." in said
    assert "filtered" not in said


@pytest.mark.parametrize("language", ["de_DE", "ja_JP"])
def test_what_is_said_of_the_uv_map_is_translated(low, select, monkeypatch, language):
    table = translations.table(language)
    monkeypatch.setattr(skipped, "pgettext_rpt", lambda text: table.get(("*", text), text))
    other = grid("Other", 1)
    bpy.context.view_layer.update()
    select(low, other)
    assert bake(maps={"curvature"}) == {"FINISHED"}
    said = operators.summaries["maps"]
    assert "overlap" not in said
    sentence = "Faces that overlap in the texture, which holds the values of the first: {count}."
    assert table["*", sentence].format(count=4) in said


def test_what_is_missing_is_said(low):
    with pytest.raises(RuntimeError, match="last the one that gets the maps"):
        bake(from_selected=True)
    with pytest.raises(RuntimeError, match="no map is left"):
        bake(maps={"normals"})
    low.data.uv_layers.remove(low.data.uv_layers[0])
    with pytest.raises(RuntimeError, match="Unwrap"):
        bake()


def test_materials_that_cannot_take_the_maps_are_named(low, tmp_path, select):
    path = str(tmp_path / "low.blend")
    bpy.data.libraries.write(path, {low.data})
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        wanted.meshes = [low.data.name]
    linked = bpy.data.objects.new("Linked", wanted.meshes[0])
    bpy.context.collection.objects.link(linked)
    low.data.materials.append(bpy.data.materials.new("Plain"))
    if bpy.app.version >= (5, 0, 0):  # all materials have nodes
        select(linked)
    else:
        select(low, linked)
    assert bake(maps={"curvature", "occlusion"}) == {"FINISHED"}
    said = operators.summaries["maps"]
    assert not linked.material_slots
    assert "Linked cannot take a node; name " in said
    assert "Plain cannot take a node; name " in said or bpy.app.version >= (5, 0, 0)


def test_remeshed_sharpened_simplified_and_baked(select):
    """The whole road: the low poly with its maps is near the sharpened mesh."""
    bpy.ops.mesh.primitive_cube_add(size=2)
    obj = bpy.context.object
    obj.name = "Part"
    remesh = obj.modifiers.new("Remesh", "REMESH")
    remesh.mode, remesh.voxel_size = "VOXEL", 0.12
    bpy.ops.object.modifier_apply(modifier="Remesh")
    assert bpy.ops.shock_filter.sharpen_geometry() == {"FINISHED"}
    assert bpy.ops.shock_filter.crisp_low_poly() == {"FINISHED"}
    low = bpy.context.object
    assert len(low.data.polygons) < 0.2 * len(obj.data.polygons)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.uv.smart_project(island_margin=0.02)
    bpy.ops.object.mode_set(mode="OBJECT")
    obj.hide_set(False)
    select(low, obj)
    maps = {"normals", "displacement", "occlusion", "curvature"}
    assert bake(from_selected=True, maps=maps) == {"FINISHED"}
    assert len(bpy.data.images) == 4
    assert all(np.isfinite(read(image.name)).all() for image in bpy.data.images)
