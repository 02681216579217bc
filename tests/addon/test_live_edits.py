# SPDX-License-Identifier: GPL-3.0-or-later
"""Edits at random on objects with a live result: nothing fails, explodes, or is stale and seen.

``python tests/addon/test_live_edits.py 500 1`` does 500 edits with the seed 1.
"""

import random
import sys
import tempfile
from collections import Counter
from pathlib import Path

import bpy  # isort: skip

import bmesh  # of bpy
import numpy as np
import pytest
import shock_filter
from shock_filter.shock_addon.data import arrays
from shock_filter.shock_addon.data.chosen import live_modifier, live_modifiers
from shock_filter.shock_addon.data.live import coloring, graph, movement, stacks
from shock_filter.shock_addon.data.mesh.meshes import read_positions
from shock_filter.shock_addon.live import updating

SMALL, LARGE = 100, 6000
"""Vertices of the objects that are edited."""


class Editing:
    """A file that is edited at random."""

    def __init__(self, seed, folder):
        self.random = random.Random(seed)
        self.path = Path(folder) / "live.blend"
        self.done = Counter()
        self.states = Counter()
        self.reset()

    def reset(self):
        bpy.ops.wm.read_homefile(use_empty=True)
        self.add()
        bpy.ops.wm.save_as_mainfile(filepath=str(self.path), copy=True)

    def add(self):
        bpy.ops.object.select_all(action="DESELECT")
        bpy.ops.mesh.primitive_cube_add(location=(self.random.uniform(-3, 3), 0, 0))
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.mesh.subdivide(number_cuts=5)
        bpy.ops.mesh.vertices_smooth(factor=0.5, repeat=3)
        bpy.ops.object.mode_set(mode="OBJECT")
        self.dress(bpy.context.object)
        bpy.ops.shock_filter.sharpen_geometry(output="LIVE")
        bpy.ops.shock_filter.sharpen_colors(output="LIVE")
        bpy.ops.shock_filter.sharpen_texture(output="LIVE")

    def dress(self, obj):
        """Give an object colors and a texture."""
        kind = self.random.choice(["BYTE_COLOR", "FLOAT_COLOR"])
        colors = obj.data.color_attributes.new(
            "Paint", kind, self.random.choice(["POINT", "CORNER"])
        )
        noise = np.random.default_rng(self.random.randint(0, 99)).random(4 * len(colors.data))
        colors.data.foreach_set("color", noise.astype(np.float32))
        obj.data.color_attributes.active_color = colors
        image = bpy.data.images.new("Wood", 16, 16, float_buffer=True)
        image.pixels.foreach_set(np.linspace(0.0, 1.0, 16 * 16 * 4, dtype=np.float32))
        image.pack()
        material = bpy.data.materials.new("Wood")
        if bpy.app.version < (5, 0, 0):
            material.use_nodes = True
        node = material.node_tree.nodes.new("ShaderNodeTexImage")
        node.image = image
        shader = next(n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED")
        material.node_tree.links.new(node.outputs["Color"], shader.inputs["Base Color"])
        obj.data.materials.append(material)

    def own(self):
        """List the objects that may be edited."""
        found = [obj for obj in bpy.context.view_layer.objects if obj.type == "MESH"]
        return [
            obj
            for obj in found
            if not (obj.library or obj.override_library or obj.data.library)
            if SMALL < len(obj.data.vertices) < LARGE
        ]

    def step(self):
        if bpy.context.object is not None and bpy.context.object.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        if not self.own() or len(bpy.data.objects) > 12:
            self.reset()
        obj = self.random.choice(self.own())
        bpy.ops.object.select_all(action="DESELECT")
        bpy.context.view_layer.objects.active = obj
        obj.select_set(True)
        edit = self.random.choice(EDITS)
        edit(self, obj)
        self.done[edit.__name__] += 1
        if bpy.context.object is not None and bpy.context.object.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        bpy.ops.ed.undo_push(message=edit.__name__)  # without it Blender may crash at an undo
        self.check(edit.__name__)

    def check(self, name):
        bpy.context.view_layer.update()
        graph = bpy.context.evaluated_depsgraph_get()
        for obj in list(bpy.context.view_layer.objects):
            if obj.type != "MESH" or len(live_modifiers(obj)) != len(obj.modifiers):
                continue
            self.check_colors(obj, obj.evaluated_get(graph).data, name)
            if live_modifier(obj) is None:
                continue
            before = read_positions(obj.data)
            after = read_positions(obj.evaluated_get(graph).data)
            state = movement.state(obj)
            self.states[state] += 1
            assert after.shape == before.shape, name
            assert np.isfinite(after).all(), name
            if obj.data.shape_keys is None:
                if state in ("stale", ""):
                    assert (after == before).all(), name
                assert np.abs(after - before).max(initial=0.0) < 1.0, name

    def check_colors(self, obj, shown, name):
        names = [before.name for before in obj.data.color_attributes]
        if len(set(names)) < len(names):
            return  # Join may give two of them one name, which Blender mixes up
        for before in obj.data.color_attributes:
            after = shown.color_attributes[before.name]
            if after.domain != before.domain:  # it was converted, and is shown as it was
                assert coloring.state(obj) == "moved", name
                continue
            values = [arrays.read_attribute(each) for each in (before, after)]
            assert np.isfinite(values[1]).all(), name
            if coloring.state(obj) in ("stale", ""):
                assert (values[0] == values[1]).all(), name
            if before.data_type == "FLOAT_COLOR":
                assert np.abs(values[0] - values[1]).max(initial=0.0) < 3.0, name
        self.states["colors " + coloring.state(obj)] += 1


def with_bmesh(change):
    def edit(editing, obj):
        if obj.data.shape_keys is not None:
            obj.shape_key_clear()
        bm = bmesh.new()
        bm.from_mesh(obj.data)
        change(editing, bm)
        bm.to_mesh(obj.data)
        bm.free()
        obj.data.update()

    edit.__name__ = change.__name__
    return edit


@with_bmesh
def delete(editing, bm):
    some = editing.random.sample(list(bm.verts), editing.random.randint(1, 4))
    bmesh.ops.delete(bm, geom=some, context="VERTS")


@with_bmesh
def subdivide(editing, bm):
    some = editing.random.sample(list(bm.edges), editing.random.randint(1, 30))
    bmesh.ops.subdivide_edges(bm, edges=some, cuts=1, use_grid_fill=True)


@with_bmesh
def rotate(editing, bm):
    inside = [edge for edge in bm.edges if len(edge.link_faces) == 2]
    bmesh.ops.rotate_edges(bm, edges=editing.random.sample(inside, min(len(inside), 3)))


@with_bmesh
def dissolve(editing, bm):
    bmesh.ops.dissolve_edges(bm, edges=editing.random.sample(list(bm.edges), 3))


@with_bmesh
def copy_and_delete(editing, bm):
    """As many vertices as before may be left."""
    faces = editing.random.sample(list(bm.faces), 3)
    bmesh.ops.duplicate(bm, geom=faces)
    bmesh.ops.delete(bm, geom=faces, context="FACES")


@with_bmesh
def sculpt(editing, bm):
    for vertex in editing.random.sample(list(bm.verts), 20):
        vertex.co *= editing.random.uniform(0.9, 1.1)


def sort(editing, obj):
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.sort_elements(type="RANDOMIZE", elements={"VERT", "EDGE", "FACE"})


def remesh(editing, obj):
    obj.data.remesh_voxel_size = editing.random.uniform(0.15, 0.3)
    if obj.data.shape_keys is None and not any(m.type == "MULTIRES" for m in obj.modifiers):
        bpy.ops.object.voxel_remesh()


def go_through_modes(editing, obj):
    for mode in ("EDIT", "SCULPT", "WEIGHT_PAINT", "VERTEX_PAINT"):
        bpy.ops.object.mode_set(mode=mode)
    bpy.ops.object.mode_set(mode=editing.random.choice(["EDIT", "OBJECT", "SCULPT"]))


def edit_mesh(editing, obj):
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_random(ratio=0.1, seed=editing.random.randint(0, 99))
    operator = editing.random.choice(
        [bpy.ops.mesh.vertices_smooth, bpy.ops.mesh.extrude_region, bpy.ops.mesh.poke]
    )
    operator()


def join(editing, obj):
    for other in editing.own():
        other.select_set(editing.random.random() < 0.5 and other.data.shape_keys is None)
    obj.select_set(True)
    if obj.data.shape_keys is None:
        bpy.ops.object.join()


def duplicate(editing, obj):
    bpy.ops.object.duplicate(linked=editing.random.random() < 0.5)


def make_single_user(editing, obj):
    bpy.ops.object.make_single_user(object=True, obdata=True)


def append(editing, obj):
    load(editing, link=False)


def link(editing, obj):
    new = load(editing, link=True)
    if editing.random.random() < 0.5:
        own = new.override_create(remap_local_usages=True)
        if own is not None and own.name not in bpy.context.view_layer.objects:
            bpy.context.collection.objects.link(own)


def load(editing, link):
    with bpy.data.libraries.load(str(editing.path), link=link) as (there, wanted):
        wanted.objects = there.objects[:1]
    if wanted.objects[0].name not in bpy.context.scene.collection.objects:
        bpy.context.scene.collection.objects.link(wanted.objects[0])
    return wanted.objects[0]


def undo_and_redo(editing, obj):
    for operator in (bpy.ops.ed.undo, bpy.ops.ed.undo, bpy.ops.ed.redo):
        if operator.poll():
            operator()


def save_and_open(editing, obj):
    path = str(editing.path.with_name("open.blend"))
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)


def amount(editing, obj):
    for modifier in live_modifiers(obj):
        stacks.write_input(modifier, graph.AMOUNT, editing.random.uniform(-1, 2))


def paint(editing, obj):
    if live_modifier(obj) is not None:
        bpy.ops.shock_filter.paint_live()


def paint_texture(editing, obj):
    if bpy.ops.shock_filter.paint_live_texture.poll():
        said(bpy.ops.shock_filter.paint_live_texture)


def update(editing, obj):
    if updating.is_live(obj):
        said(lambda: shock_filter.live.update(obj))


def press(editing, obj):
    try:
        bpy.ops.shock_filter.sharpen_geometry(
            output=editing.random.choice(["AUTO", "LIVE", "LIVE", "MESH", "SHAPE_KEY"])
        )
    except RuntimeError as error:
        assert str(error).strip().endswith("."), error


def press_colors(editing, obj):
    said(lambda: bpy.ops.shock_filter.sharpen_colors(output=editing.random.choice(OUTPUTS)))


def denoise_both(editing, obj):
    said(lambda: bpy.ops.shock_filter.denoise(target="both", output=editing.random.choice(OUTPUTS)))


def paint_colors(editing, obj):
    for colors in obj.data.color_attributes:
        values = arrays.read_attribute(colors)
        values[editing.random.randrange(len(values)) :] *= np.float32(0.9)
        arrays.write_attribute(colors, values)
    obj.data.update()


def change_colors(editing, obj):
    if obj.data.color_attributes:
        if editing.random.random() < 0.3:
            obj.data.color_attributes.remove(obj.data.color_attributes[0])
        else:
            domain, kind = editing.random.choice(["POINT", "CORNER"]), "FLOAT_COLOR"
            bpy.ops.geometry.color_attribute_convert(domain=domain, data_type=kind)


def press_texture(editing, obj):
    outputs = ["NEW", "LIVE", "LIVE", "REPLACE"]
    said(lambda: bpy.ops.shock_filter.sharpen_texture(output=editing.random.choice(outputs)))


def change_material(editing, obj):
    material = obj.active_material
    if material is None or material.library is not None:
        return
    nodes = material.node_tree.nodes
    if editing.random.random() < 0.5:
        nodes.remove(editing.random.choice(list(nodes)))
    else:
        obj.active_material = material.copy()


def said(press):
    """Press, where an error is a sentence."""
    try:
        press()
    except RuntimeError as error:
        assert str(error).strip().endswith("."), error


def swap(editing, obj):
    if bpy.ops.shock_filter.before_after.poll():
        try:
            bpy.ops.shock_filter.before_after()
        except RuntimeError as error:
            assert str(error).strip().endswith("."), error


def apply(editing, obj):
    if live_modifier(obj) is not None and obj.data.users == 1 and obj.data.shape_keys is None:
        bpy.ops.object.modifier_apply(modifier=editing.random.choice(live_modifiers(obj)).name)


def remove(editing, obj):
    bpy.data.objects.remove(obj)


OUTPUTS = ["AUTO", "LIVE", "LIVE", "MESH"]

EDITS = [
    *(delete, subdivide, rotate, dissolve, copy_and_delete, sculpt, sort, remesh),
    *(go_through_modes, edit_mesh, join, duplicate, make_single_user, append, link),
    *(undo_and_redo, save_and_open, amount, paint, update, update, press, press, swap, apply),
    *(press_colors, press_colors, denoise_both, paint_colors, change_colors),
    *(press_texture, press_texture, change_material, paint_texture, remove),
]


@pytest.mark.parametrize("seed", [0, 1])
def test_edits_at_random(seed, tmp_path):
    editing = Editing(seed, tmp_path)
    for _ in range(40):
        editing.step()


if __name__ == "__main__":
    shock_filter.register()
    with tempfile.TemporaryDirectory() as scratch:
        all_of_it = Editing(int(sys.argv[2]), scratch)
        for _number in range(int(sys.argv[1])):
            all_of_it.step()
        print(sum(all_of_it.done.values()), dict(all_of_it.done), dict(all_of_it.states))
    shock_filter.unregister()
