# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators Sharpen Texture, Dilate Texture and Denoise Texture."""

import itertools
import os
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from shock_filter.core import Cancelled, TextureSettings
from shock_filter.core.host.mosaic import Mosaic
from shock_filter.core.host.textures import filter_texture
from shock_filter.shock_addon.data import chosen
from shock_filter.shock_addon.data.image import images as image_data
from shock_filter.shock_addon.data.image import textures as texture_data
from shock_filter.shock_addon.data.image import tiles
from shock_filter.shock_addon.modes import find
from shock_filter.shock_addon.operators import base as operators
from shock_filter.shock_addon.operators import statistics
from shock_filter.shock_addon.operators import textures as texture_operator

sharpen = bpy.ops.shock_filter.sharpen_texture
dilate = bpy.ops.shock_filter.dilate_texture
denoise = bpy.ops.shock_filter.denoise_texture

SIZE = 64


def read(image):
    return image_data.read_pixels(image)


def blend(size=SIZE, center=0.5, width=0.05, axis=1):
    """A soft edge in three channels, opaque; at `center` of the columns, or of the rows."""
    place = (np.arange(size) + 0.5) / size
    step = 0.5 + 0.4 * np.tanh((place - center) / width)
    step = np.broadcast_to(step if axis else step[:, None], (size, size))
    ones = np.ones_like(step)
    return np.stack([step, 1 - step, 0.4 * step, ones], axis=-1).astype(np.float32)


def add_image(name="Wood", pixels=None, float_buffer=False, is_data=False):
    pixels = blend() if pixels is None else pixels
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(
        name, width, height, alpha=True, float_buffer=float_buffer, is_data=is_data
    )
    image.pixels.foreach_set(np.ascontiguousarray(pixels).reshape(-1))
    image.update()
    return image


def new_material(name):
    """A material with nodes; from Blender 5.0 on, all have some."""
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    return material


def add_material(*images, name="Paint"):
    """A material with an image texture node for each image; the first is active."""
    material = new_material(name)
    nodes = [material.node_tree.nodes.new("ShaderNodeTexImage") for _ in images]
    for node, image in zip(nodes, images, strict=True):
        node.image = image
    if nodes:
        material.node_tree.nodes.active = nodes[0]
    return material


def add_sheet(name="Sheet", material=None, left=0.0, right=1.0, cells=4, gap=0.0):
    """A flat sheet of quads over 0..1; its UVs fill the image between two columns.

    With a gap, the half x > 1/2 is a chart of its own, and lies that far to the right.
    """
    ticks = np.linspace(0.0, 1.0, cells + 1)
    points = [(x, y, 0.0) for y in ticks for x in ticks]
    row = cells + 1
    faces = [
        (k, k + 1, k + row + 1, k + row)
        for y in range(cells)
        for k in range(y * row, y * row + cells)
    ]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points, [], faces)
    layer = mesh.uv_layers.new(name="Layout")
    for polygon in mesh.polygons:
        far = mesh.vertices[polygon.vertices[0]].co.x >= 0.5 - 1e-6
        for loop in polygon.loop_indices:
            x, y, _ = mesh.vertices[mesh.loops[loop].vertex_index].co
            u = left + (right - left) * x * (1.0 - gap) + gap * far
            layer.uv[loop].vector = u, y
    if material is not None:
        mesh.materials.append(material)
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.collection.objects.link(obj)
    for other in bpy.context.selected_objects:
        other.select_set(False)
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj
    bpy.context.view_layer.update()
    return obj


@pytest.fixture
def sheet():
    """A sheet that shows a soft edge."""
    image = add_image()
    return SimpleNamespace(obj=add_sheet(material=add_material(image)), image=image)


def node_images(obj):
    nodes = obj.active_material.node_tree.nodes
    return [node.image.name for node in nodes if node.type == "TEX_IMAGE"]


def softness(pixels):
    """How far the red channel is from a step of two values: 0 for a step."""
    red = pixels[..., 0]
    return np.minimum(red - red.min(), red.max() - red).mean()


# ------------------------------------------------------------------------------ images and results


@pytest.mark.parametrize("output", ["NEW", "REPLACE"])
def test_where_only_what_lies_beside_the_charts_would_change_nothing_does(output):
    pixels = np.full((SIZE, SIZE, 4), (0.2, 0.4, 0.6, 1.0), np.float32)
    pixels[:, : SIZE // 2 - 4, :3] = 0.0
    image = add_image(pixels=pixels)
    before, obj = read(image), add_sheet(material=add_material(image), left=0.5)
    sharpen(output=output)
    assert operators.summaries["texture"].startswith("Nothing in Wood has changed")
    assert node_images(obj) == ["Wood"] and len(bpy.data.images) == 1
    np.testing.assert_array_equal(read(image), before)


@pytest.mark.parametrize("between", [[], ["NodeReroute"], ["ShaderNodeMapping"]], ids=str)
def test_the_uv_map_that_the_material_names_is_read(sheet, between):
    mesh, tree = sheet.obj.data, sheet.obj.active_material.node_tree
    sharpen(output="NEW", assign=False, time=64.0)
    wanted = read(bpy.data.images["Wood sharpened"])
    for point in mesh.uv_layers.new(name="Light map").uv:
        point.vector = 0.1 * point.vector
    mesh.uv_layers.active_index = 1
    image_node = next(node for node in tree.nodes if node.type == "TEX_IMAGE")
    named = tree.nodes.new("ShaderNodeUVMap")
    ends = [named, *map(tree.nodes.new, between), image_node]
    for one, other in itertools.pairwise(ends):
        tree.links.new(one.outputs[0], other.inputs[0])
    for name, same in (("Layout", True), ("", True), ("gone", False), ("Light map", False)):
        named.uv_map = name
        sharpen(output="NEW", time=64.0)
        assert np.array_equal(read(image_node.image), wanted) == same
        image_node.image = sheet.image


@pytest.mark.parametrize("rendered", ["Layout", "Light map"])
def test_without_a_name_the_uv_map_of_renders_is_read_as_by_materials(sheet, rendered):
    layers = sheet.obj.data.uv_layers
    for point in layers.new(name="Light map").uv:
        point.vector = 0.1 * point.vector
    layers[rendered].active_render = True
    found = set()
    for layer in layers:
        layers.active = layer
        sharpen(output="NEW", assign=False, time=64.0)
        result = bpy.data.images.get("Wood sharpened")
        found.add(read(result or sheet.image).tobytes())
        if result is not None:
            bpy.data.images.remove(result)
    assert len(found) == 1


@pytest.mark.parametrize("float_buffer", [False, True])
def test_a_soft_edge_becomes_sharp_in_a_new_image(float_buffer):
    image = add_image(float_buffer=float_buffer)
    obj = add_sheet(material=add_material(image))
    before = read(image)
    assert sharpen(time=1024.0) == {"FINISHED"}
    result = bpy.data.images["Wood sharpened"]
    after = read(result)
    np.testing.assert_array_equal(read(image), before)
    assert result.is_float == float_buffer
    assert softness(after) < 0.6 * softness(before)
    assert after.min() >= before.min() - 1e-6
    assert after.max() <= before.max() + 1e-6
    np.testing.assert_array_equal(after[..., 3], before[..., 3])
    assert node_images(obj) == ["Wood sharpened"]
    assert operators.summaries["texture"].startswith(
        "Sharpened the texture Wood on 1 object into Wood sharpened: 4,096 pixels, changed "
    )


def test_the_materials_keep_the_image_if_asked_to(sheet):
    sharpen(time=64.0, assign=False)
    assert "Wood sharpened" in bpy.data.images
    assert node_images(sheet.obj) == ["Wood"]


@pytest.mark.parametrize("assign", [False, True])
def test_the_report_is_about_the_texture_that_is_shown(sheet, assign):
    nodes, source = sheet.obj.active_material.node_tree.nodes, sheet.image
    node = next(n for n in nodes if n.type == "TEX_IMAGE")
    sharpen("EXEC_DEFAULT", assign=assign)
    assert "Wood" in operators.summary_of(bpy.context, "texture")
    node.image = add_image("Another")
    assert operators.summary_of(bpy.context, "texture") == ""
    assert "Wood" in operators.summary_of(bpy.context, "texture", source.name)
    node.image = source
    assert "Wood" in operators.summary_of(bpy.context, "texture")


def test_nodes_in_groups_and_several_materials_get_the_result():
    image = add_image()
    obj = add_sheet(material=add_material(image))
    group = bpy.data.node_groups.new("Inner", "ShaderNodeTree")
    inner = group.nodes.new("ShaderNodeTexImage")
    inner.image = image
    other = add_material(name="Grouped")
    other.node_tree.nodes.new("ShaderNodeGroup").node_tree = group
    obj.data.materials.append(other)
    sharpen(time=64.0)
    assert inner.image.name == "Wood sharpened"
    assert node_images(obj) == ["Wood sharpened"]


def test_replacing_overwrites_the_pixels(sheet):
    before = read(sheet.image)
    assert sharpen(time=256.0, output="REPLACE") == {"FINISHED"}
    assert bpy.data.images.keys() == ["Wood"]
    assert softness(read(sheet.image)) < softness(before)
    assert node_images(sheet.obj) == ["Wood"]


@pytest.mark.parametrize("output", ["NEW", "REPLACE"])
@pytest.mark.parametrize("float_buffer", [False, True])
def test_time_zero_changes_no_bit(output, float_buffer):
    pixels = np.random.default_rng(0).random((SIZE, SIZE, 4)).astype(np.float32)
    if float_buffer:
        pixels[..., :3] = 4.0 * pixels[..., :3] - 1.0
    image = add_image(pixels=pixels, float_buffer=float_buffer, is_data=True)
    add_sheet(material=add_material(image))
    before = read(image).tobytes()
    sharpen(time=0.0, output=output)
    assert read(image).tobytes() == before
    assert "Wood sharpened" not in bpy.data.images


def test_a_packed_float_image_stays_packed_and_float():
    image = add_image(float_buffer=True)
    image.pack()
    add_sheet(material=add_material(image))
    before = read(image)
    sharpen(time=1024.0)
    result = bpy.data.images["Wood sharpened"]
    assert result.packed_file is not None
    assert result.is_float
    assert softness(read(result)) < 0.6 * softness(before)
    assert image.packed_file is not None


def test_values_of_non_color_images_are_filtered_as_they_are():
    plain, data = add_image("Plain"), add_image("Data", is_data=True)
    obj = add_sheet(material=add_material(plain, data))
    sharpen(image="Plain", time=256.0)
    sharpen(image="Data", time=256.0)
    after = bpy.data.images["Data sharpened"]
    assert after.colorspace_settings.is_data
    np.testing.assert_array_equal(read(after), read(bpy.data.images["Plain sharpened"]))
    assert node_images(obj) == ["Plain sharpened", "Data sharpened"]


def test_redo_writes_the_same_image_again(sheet):
    sharpen("EXEC_DEFAULT", True, time=16.0, assign=False)
    kept = bpy.context.window_manager.operators[-1].properties
    assert (kept.image, kept.result) == ("Wood", "Wood sharpened")
    first = read(bpy.data.images["Wood sharpened"])
    sharpen(image=kept.image, result=kept.result, time=1024.0, assign=False)
    assert bpy.data.images.keys() == ["Wood", "Wood sharpened"]
    assert (read(bpy.data.images["Wood sharpened"]) != first).any()


def test_redo_of_a_replaced_image_starts_from_the_old_pixels(sheet, adjust, repeat):
    bpy.ops.ed.undo_push(message="Start")
    sharpen("EXEC_DEFAULT", True, time=256.0, output="REPLACE")
    once = read(bpy.data.images["Wood"])
    adjust(time=256.0)
    np.testing.assert_array_equal(read(bpy.data.images["Wood"]), once)
    repeat()
    assert softness(read(bpy.data.images["Wood"])) < softness(once)


def test_repeated_on_another_object_it_filters_the_texture_of_that(sheet, repeat):
    sharpen("EXEC_DEFAULT", True, time=256.0)
    before = read(bpy.data.images["Wood sharpened"])
    sheet.obj.select_set(False)
    image = add_image("Stone")
    other = add_sheet(material=add_material(image))
    repeat()
    np.testing.assert_array_equal(read(bpy.data.images["Wood sharpened"]), before)
    assert node_images(sheet.obj) == ["Wood sharpened"]
    assert node_images(other) == ["Stone sharpened"]


def test_undo_takes_image_and_assignment_back(sheet):
    bpy.ops.ed.undo_push(message="Before")
    sharpen(time=64.0)
    bpy.ops.ed.undo_push(message="After")
    assert node_images(bpy.data.objects["Sheet"]) == ["Wood sharpened"]
    bpy.ops.ed.undo()
    assert bpy.data.images.keys() == ["Wood"]
    assert node_images(bpy.data.objects["Sheet"]) == ["Wood"]


# -------------------------------------------------------------------------------- across the seams


def test_colors_flow_across_a_seam():
    """Cut into two charts beside the edge, the surface gets the same colors as in one piece."""
    whole = blend(center=0.45 * 0.75, width=0.045)
    cut = np.zeros_like(whole)
    cut[:, :24], cut[:, 40:] = whole[:, :24], whole[:, 24:48]
    uncut = add_sheet("Uncut", add_material(add_image("Whole", whole)), right=0.75)
    sharpen(time=4096.0)
    expected = read(bpy.data.images["Whole sharpened"])[2:-2]
    bpy.data.objects.remove(uncut)
    add_sheet("Cut", add_material(add_image("Cut", cut)), gap=0.25)
    sharpen(time=4096.0, assign=False)
    bpy.ops.shock_filter.sharpen_image(image="Cut", time=4096.0)
    assert abs(expected[:, :48] - whole[2:-2, :48]).max() > 0.2
    worst = []
    for name in ("Cut sharpened", "Cut sharpened.001"):
        both = read(bpy.data.images[name])[2:-2]
        left, right = both[:, :24] - expected[:, :24], both[:, 40:62] - expected[:, 24:46]
        worst.append(max(abs(left).max(), abs(right).max()))
    on_surface, flat = worst
    assert on_surface < 2.5 / 255
    assert flat > 10 * on_surface


def test_materials_that_meet_at_a_seam_stay_apart():
    """Of two colors, each fills its own gutter; told to continue, each has the other one there."""
    pixels = np.full((48, 64, 4), (0.2, 0.2, 0.2, 1.0), dtype=np.float32)
    pixels[:, 24:] = (0.9, 0.7, 0.1, 1.0)
    pixels[:, :20, :3] += np.linspace(0.5, 0.0, 20)[:, None] ** 2 * (np.arange(20) < 8)[:, None]
    cut = add_image("Cut", pixels)
    add_sheet("Cut", add_material(cut), gap=0.25)
    for operator in (sharpen, bpy.ops.shock_filter.dilate_texture):
        for seams, beyond in (("auto", 0.2), ("extend", 0.2), ("continue", 0.9)):
            operator(assign=False, seams=seams)
            made = set(bpy.data.images) - {cut} or {cut}  # none if nothing has changed
            assert [abs(read(image)[24, 25, 0] - beyond) < 2 / 255 for image in made] == [True]
            bpy.data.batch_remove(made - {cut})


def test_two_objects_on_one_image_are_solved_together(select):
    """The same picture, cut into two objects that touch: nothing shows where they meet."""
    image = add_image(pixels=blend(center=0.45))
    material = add_material(image)
    whole = add_sheet("Whole", material)
    sharpen(time=256.0, assign=False)
    expected = taken("Wood sharpened")
    bpy.data.objects.remove(whole)
    left = add_sheet("Left", material, 0.0, 0.5)
    right = add_sheet("Right", material, 0.5, 1.0)
    left.scale = right.scale = (0.5, 1.0, 1.0)
    right.location = (0.5, 0.0, 0.0)
    bpy.context.view_layer.update()
    select(left, right)
    sharpen(time=256.0, assign=False)
    together = taken("Wood sharpened")
    np.testing.assert_allclose(together, expected, atol=2.5 / 255)
    assert "on 2 objects" in operators.summaries["texture"]


def test_an_object_without_the_image_is_left_out_with_the_reason(sheet, select, capfd):
    other = add_sheet("Other", add_material(add_image("Stone"), name="Rock"))
    bare = add_sheet("Bare")
    bare.data.uv_layers.remove(bare.data.uv_layers[0])
    select(sheet.obj, other, bare)
    assert sharpen(time=64.0) == {"FINISHED"}
    said = capfd.readouterr().out
    assert "Skipped Other: no face of it has a material that shows Wood" in said
    assert "Skipped Bare: it has no UV map; unwrap it" in said
    assert "on 1 object " in operators.summaries["texture"]


def test_faces_of_other_materials_take_no_part(sheet):
    """Two halves lie on the same texels; only one of them shows this image."""
    mesh = sheet.obj.data
    mesh.materials.append(add_material(add_image("Stone"), name="Rock"))
    for polygon in mesh.polygons:
        polygon.material_index = int(polygon.center.x > 0.5)
    sharpen(time=1024.0, gutter=0)
    after, before = read(bpy.data.images["Wood sharpened"]), read(sheet.image)
    changed = (after != before).any(axis=(0, 2))
    assert changed[: SIZE // 2].any()
    assert not changed[SIZE // 2 + 2 :].any()


def test_others_that_show_the_image_are_mentioned(sheet, select, capfd):
    add_sheet("Other", sheet.obj.active_material)
    select(sheet.obj)
    sharpen(time=64.0)
    assert "Wood is also on Other, which were not filtered" in capfd.readouterr().out


def taken(name):
    """Read an image and remove it, since an equal one would be taken for the next result."""
    image = bpy.data.images[name]
    pixels = read(image)
    bpy.data.images.remove(image)
    return pixels


def test_object_scale_counts(sheet):
    """Stretched along x, texels are longer there, so the same time reaches fewer of them."""
    sharpen(time=64.0, assign=False)
    plain = taken("Wood sharpened")
    sheet.obj.scale = (1.0, 8.0, 1.0)
    bpy.context.view_layer.update()
    sharpen(time=64.0, assign=False)
    stretched = taken("Wood sharpened")
    assert (plain != stretched).any()
    sheet.obj.scale = (3.0, 3.0, 3.0)
    sheet.obj.rotation_euler = (0.3, 0.2, 0.1)
    bpy.context.view_layer.update()
    sharpen(time=64.0, assign=False)
    turned = taken("Wood sharpened")
    np.testing.assert_allclose(turned, plain, atol=1.5 / 255)


# ------------------------------------------------------------------------------------------- masks


def test_a_vertex_group_protects(sheet):
    group = sheet.obj.vertex_groups.new(name="Upper")
    upper = [v.index for v in sheet.obj.data.vertices if v.co.y >= 0.5]
    group.add(upper, 1.0, "REPLACE")
    sharpen(time=1024.0, vertex_group="Upper", gutter=0)
    changed = (read(bpy.data.images["Wood sharpened"]) != read(sheet.image)).any(axis=(1, 2))
    assert changed[SIZE // 2 + 1 :].all()
    assert not changed[: SIZE // 4 - 1].any()
    sharpen(image="Wood", time=1024.0, vertex_group="Upper", invert_mask=True, gutter=0)
    changed = (read(bpy.data.images["Wood sharpened.001"]) != read(sheet.image)).any(axis=(1, 2))
    assert not changed[SIZE // 2 + 1 :].any()
    assert changed[: SIZE // 4].all()


def test_only_selected_faces_change(sheet):
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.context.tool_settings.mesh_select_mode = (False, False, True)
    bpy.ops.mesh.select_all(action="DESELECT")
    bpy.ops.object.mode_set(mode="OBJECT")
    for polygon in sheet.obj.data.polygons:
        polygon.select = polygon.center.y > 0.5
    bpy.ops.object.mode_set(mode="EDIT")
    assert sharpen(time=1024.0, gutter=0) == {"FINISHED"}
    assert bpy.context.mode == "EDIT_MESH"
    changed = (read(bpy.data.images["Wood sharpened"]) != read(sheet.image)).any(axis=(1, 2))
    assert changed[SIZE // 2 + 1 :].all()
    assert not changed[: SIZE // 2 - 1].any()


def test_a_mask_image_protects(sheet):
    mask = np.zeros((SIZE, SIZE, 4), dtype=np.float32)
    mask[: SIZE // 2, :, :3] = 1.0
    add_image("Mask", mask, is_data=True)
    sharpen(time=1024.0, mask_image="Mask")
    changed = (read(bpy.data.images["Wood sharpened"]) != read(sheet.image)).any(axis=(1, 2))
    assert changed[: SIZE // 2].all()
    assert not changed[SIZE // 2 :].any()
    assert f"{SIZE * SIZE // 2:,} pixels, changed" in operators.summaries["texture"]
    settings = bpy.context.scene.shock_filter.texture
    assert statistics.last_run(find("texture"), settings).filtered == SIZE * SIZE // 2
    sharpen(image="Wood", time=1024.0, mask_image="Mask", invert_mask=True)
    changed = (read(bpy.data.images["Wood sharpened.001"]) != read(sheet.image)).any(axis=(1, 2))
    assert not changed[: SIZE // 2].any()
    assert changed[SIZE // 2 :].all()


@pytest.mark.parametrize(
    ("make", "words", "reason"),
    [
        (lambda: None, {"mask_image": "Gone"}, "there is no mask image named 'Gone'"),
        (
            lambda: add_image("Small", blend(16)),
            {"mask_image": "Small"},
            "its mask Small has another size; scale it to 64 x 64",
        ),
        (
            lambda: add_image("Black", np.zeros((SIZE, SIZE, 4), np.float32)),
            {"mask_image": "Black"},
            "its mask Black leaves nothing to sharpen",
        ),
        (
            lambda: setattr(add_image("Film", blend(SIZE)), "source", "MOVIE"),
            {"mask_image": "Film"},
            "its mask Film cannot be used: it is a movie",
        ),
        (lambda: None, {"vertex_group": "Gone"}, "it has no vertex group named 'Gone'"),
    ],
)
def test_bad_masks_are_named(sheet, make, words, reason):
    make()
    before = bpy.data.images.keys()
    with pytest.raises(RuntimeError, match=reason):
        sharpen(time=64.0, **words)
    assert bpy.data.images.keys() == before


# ------------------------------------------------------------------------------------ which image


def test_the_active_node_chooses_the_image():
    wood, stone = add_image("Wood"), add_image("Stone")
    material = add_material(wood, stone)
    add_sheet(material=material)
    nodes = [node for node in material.node_tree.nodes if node.type == "TEX_IMAGE"]
    material.node_tree.nodes.active = nodes[1]
    sharpen(time=64.0)
    assert "Stone sharpened" in bpy.data.images
    material.node_tree.nodes.active = next(n for n in material.node_tree.nodes if n not in nodes)
    with pytest.raises(RuntimeError, match=r"several images .*; click the node"):
        sharpen(time=64.0)


def test_without_an_active_one_the_base_color_chooses_the_image():
    wood, stone = add_image("Wood"), add_image("Stone")
    material = add_material(stone, wood)
    add_sheet(material=material)
    tree = material.node_tree
    shader = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    mix = tree.nodes.new("ShaderNodeHueSaturation")
    node = next(node for node in tree.nodes if getattr(node, "image", None) == wood)
    tree.links.new(node.outputs["Color"], mix.inputs["Color"])
    tree.links.new(mix.outputs["Color"], shader.inputs["Base Color"])
    tree.nodes.active = shader
    assert chosen.shown_image(bpy.context) == wood


def test_a_named_image_that_no_material_shows_is_on_all_faces():
    add_image("Loose")
    add_sheet()
    assert sharpen(image="Loose", time=256.0) == {"FINISHED"}
    assert "Loose sharpened" in bpy.data.images


def test_texture_paint_mode_takes_what_is_painted_on(sheet):
    canvas = add_image("Canvas")
    paint = bpy.context.tool_settings.image_paint
    bpy.ops.object.mode_set(mode="TEXTURE_PAINT")
    paint.mode = "IMAGE"
    paint.canvas = canvas
    assert chosen.shown_image(bpy.context) == canvas
    paint.mode = "MATERIAL"
    assert chosen.shown_image(bpy.context) == sheet.image
    assert sharpen(time=64.0) == {"FINISHED"}
    assert bpy.context.mode == "PAINT_TEXTURE"


@pytest.mark.parametrize(
    ("mode", "name"), [("texture", "mask_image"), ("detail", "mask_image"), ("detail", "gain_map")]
)
def test_a_mask_that_is_painted_on_is_not_taken_for_the_texture(sheet, mode, name):
    canvas = add_image("Canvas")
    setattr(getattr(bpy.context.scene.shock_filter, mode), name, "Canvas")
    bpy.ops.object.mode_set(mode="TEXTURE_PAINT")
    paint = bpy.context.tool_settings.image_paint
    paint.mode, paint.canvas = "IMAGE", canvas
    assert chosen.shown_image(bpy.context) == sheet.image
    assert sharpen(time=64.0) == {"FINISHED"}
    assert "Wood sharpened" in bpy.data.images
    assert paint.canvas == canvas


@pytest.mark.parametrize("mode", ["MATERIAL", "IMAGE"])
def test_texture_paint_mode_paints_on_the_new_image_from_then_on(sheet, mode):
    bpy.ops.object.mode_set(mode="TEXTURE_PAINT")
    paint = bpy.context.tool_settings.image_paint
    paint.mode, paint.canvas = mode, sheet.image
    for name in ("Wood sharpened", "Wood sharpened.001"):
        sharpen(time=256.0)
        assert bpy.context.mode == "PAINT_TEXTURE"
        assert chosen.shown_image(bpy.context).name == name
        assert node_images(sheet.obj) == [name]
        assert paint.canvas.name == name
    assert softness(read(paint.canvas)) < softness(read(bpy.data.images["Wood sharpened"]))


def test_another_canvas_stays(sheet):
    paint = bpy.context.tool_settings.image_paint
    paint.canvas = add_image("Canvas")
    sharpen(image="Wood", time=256.0)
    assert paint.canvas.name == "Canvas"


def test_the_paint_mask_of_texture_paint_mode_protects(sheet):
    for polygon in sheet.obj.data.polygons:
        polygon.select = polygon.center.y > 0.5
    bpy.ops.object.mode_set(mode="TEXTURE_PAINT")
    sheet.obj.data.use_paint_mask = True
    sharpen(time=1024.0, gutter=0)
    changed = (read(bpy.data.images["Wood sharpened"]) != read(sheet.image)).any(axis=(1, 2))
    assert changed[SIZE // 2 + 1 :].all()
    assert not changed[: SIZE // 2 - 1].any()


def test_the_image_editor_names_the_image_and_shows_the_result():
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    image = add_image()
    add_sheet(material=add_material(add_image("Other")))
    screen, area = next(
        (screen, area)
        for screen in bpy.data.screens
        for area in screen.areas
        if area.type == "IMAGE_EDITOR"
    )
    area.spaces.active.image = image
    with bpy.context.temp_override(screen=screen, area=area):
        assert sharpen(time=64.0) == {"FINISHED"}
    assert area.spaces.active.image == bpy.data.images["Wood sharpened"]


# --------------------------------------------------------------------------------------- bad input


def without_uv(obj):
    obj.data.uv_layers.remove(obj.data.uv_layers[0])
    add_sheet("Other")
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)


def all_uv(value):
    def change(obj):
        for corner in obj.data.uv_layers.active.uv:
            corner.vector = value

    return change


def without_image(obj):
    for node in obj.active_material.node_tree.nodes:
        if node.type == "TEX_IMAGE":
            node.image = None


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda obj: obj.data.materials.clear(), "it has no material"),
        (without_image, "has no Image Texture node with an image"),
        (all_uv((0.0, 0.0)), "Skipped Wood: "),
        (all_uv((np.nan, 0.0)), "Skipped Wood: "),
        (lambda obj: setattr(obj, "scale", (0.0, 1.0, 1.0)), "its scale is zero along an axis"),
    ],
    ids=["no material", "no image", "UVs in a point", "NaN", "scale"],
)
def test_bad_input_is_named_and_nothing_changes(sheet, change, reason):
    change(sheet.obj)
    bpy.context.view_layer.update()
    before, names = read(sheet.image), bpy.data.images.keys()
    with pytest.raises(RuntimeError, match=reason):
        sharpen(time=64.0, output="REPLACE")
    np.testing.assert_array_equal(read(sheet.image), before)
    assert bpy.data.images.keys() == names


def test_nan_pixels_are_named():
    pixels = blend()
    pixels[3, 4, 1] = np.nan
    add_sheet(material=add_material(add_image(pixels=pixels, float_buffer=True)))
    with pytest.raises(RuntimeError, match="NaN"):
        sharpen(time=64.0)
    assert bpy.data.images.keys() == ["Wood"]


def test_unknown_images_are_named(sheet):
    with pytest.raises(RuntimeError, match="There is no image named 'Nowhere'"):
        sharpen(image="Nowhere")


def test_overlapping_uvs_are_reported(sheet, capfd):
    for corner in sheet.obj.data.uv_layers.active.uv:
        corner.vector[0] = abs(corner.vector[0] - 0.5)
    assert sharpen(time=64.0) == {"FINISHED"}
    assert "overlap" in capfd.readouterr().out


@pytest.mark.parametrize("operator", [sharpen, dilate])
def test_the_button_is_grey_without_mesh_uv_map_or_image(operator):
    assert not operator.poll()
    obj = add_sheet()
    assert not operator.poll()
    add_image()
    assert operator.poll()
    obj.data.uv_layers.remove(obj.data.uv_layers[0])
    assert not operator.poll()


def test_linked_images_are_refused_and_linked_meshes_are_read(tmp_path):
    image = add_image()
    image.pack()
    obj = add_sheet(material=add_material(image))
    library = str(tmp_path / "library.blend")
    bpy.data.libraries.write(library, {obj})
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(library, link=True) as (_, wanted):
        wanted.objects = ["Sheet"]
    (linked,) = wanted.objects
    bpy.context.collection.objects.link(linked)
    bpy.context.view_layer.objects.active = linked
    linked.select_set(True)
    with pytest.raises(RuntimeError, match=r"Skipped Wood: it is linked .* make it local"):
        sharpen(time=64.0)
    add_image("Local")
    assert sharpen(image="Local", time=64.0) == {"FINISHED"}


def test_a_linked_material_keeps_its_image_and_says_so(tmp_path, capfd):
    library = str(tmp_path / "library.blend")
    bpy.data.libraries.write(library, {add_material(add_image())})
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(library, link=True) as (_, wanted):
        wanted.materials = ["Paint"]
    (material,) = wanted.materials
    local = add_image("Local")
    obj = add_sheet(material=material)
    obj.data.materials.append(add_material(local, name="Own"))
    image = next(n.image for n in material.node_tree.nodes if n.type == "TEX_IMAGE")
    (note,) = texture_data.assign(["Sheet"], image, local)
    assert "Paint is linked from another file, so it still shows" in note


# -------------------------------------------------------------------------------- cancel and races


def target_of(obj):
    image = chosen.shown_image(bpy.context)
    return texture_data.read_texture(bpy.context, image, SimpleNamespace(gutter=16))[0]


@pytest.mark.parametrize("after", [0, 3, 8])
def test_cancelling_leaves_all_as_it_was(sheet, after, monkeypatch):
    calls = []

    def listen(fraction, message):
        calls.append(fraction)
        return len(calls) <= after

    monkeypatch.setattr(operators, "listener", listen)
    before = read(sheet.image)
    assert sharpen(time=1024.0, output="REPLACE") == {"CANCELLED"}
    np.testing.assert_array_equal(read(sheet.image), before)
    assert bpy.data.images.keys() == ["Wood"]
    assert node_images(sheet.obj) == ["Wood"]


def test_progress_rises_to_one(sheet):
    seen = []
    target = target_of(sheet.obj)
    filter_texture(
        target.surface, "sharpen_texture", TextureSettings(), lambda f, m: seen.append(f) or True
    )
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(1.0)
    with pytest.raises(Cancelled):
        filter_texture(target.surface, "sharpen_texture", TextureSettings(), lambda f, m: f < 0.5)


def test_an_image_that_was_removed_or_scaled_meanwhile_is_skipped(sheet):
    target = target_of(sheet.obj)
    sheet.image.scale(10, 10)
    with pytest.raises(texture_operator.Skipped, match="it was changed meanwhile"):
        image_data.find_image(target)
    bpy.data.images.remove(sheet.image)
    with pytest.raises(texture_operator.Skipped, match="it was removed meanwhile"):
        image_data.find_image(target)


# ---------------------------------------------------------------------------------------- dilation


def test_dilation_continues_the_surface_beyond_the_seam():
    """Around the seam, texels get what the surface holds there; the rest stays."""
    gap, u = 0.25, (np.arange(SIZE) + 0.5) / SIZE
    left, right = u < 0.5 * (1 - gap), u > 0.5 * (1 - gap) + gap
    surface = np.where(left, u, u - gap) / (1 - gap)
    pixels = np.zeros((SIZE, SIZE, 4), dtype=np.float32)
    pixels[:, left | right] = np.stack(3 * [surface] + [np.ones(SIZE)], axis=1)[left | right]
    image = add_image(pixels=pixels)
    obj = add_sheet(material=add_material(image), gap=gap)
    assert dilate(gutter=4) == {"FINISHED"}
    before, after = read(image), read(bpy.data.images["Wood dilated"])
    np.testing.assert_array_equal(after[:, left | right], before[:, left | right])
    filled = np.flatnonzero((after != before).any(axis=(0, 2)))
    first = left.sum()
    np.testing.assert_array_equal(filled, [*range(first, first + 4), *range(36, 40)])
    np.testing.assert_allclose(
        after[8:-8, first : first + 4, 0], before[8:-8, 40:44, 0], atol=1.5 / 64
    )
    assert (after[8:-8, filled, 3] == 1.0).all()
    assert node_images(obj) == ["Wood dilated"]
    assert operators.summaries["texture"].startswith(
        "Dilated the texture Wood on 1 object into Wood dilated: filled 512 of 4,096 pixels"
    )


# -------------------------------------------------------------------------------------- UDIM tiles


def add_tiled(folder, contents, float_buffer=False, packed=False):
    """An image with UDIM tiles, from files."""
    ending, kind = ("exr", "OPEN_EXR") if float_buffer else ("png", "PNG")
    for number, pixels in contents.items():
        part = add_image("part", pixels, float_buffer, is_data=True)
        part.file_format = kind
        part.save(filepath=f"{folder}/wood.{number}.{ending}")
        bpy.data.images.remove(part)
    image = bpy.data.images.load(f"{folder}/wood.{min(contents)}.{ending}")
    image.name = "Wood"
    image.source = "TILED"
    image.colorspace_settings.name = "Non-Color"
    if packed:
        image.pack()
    return image


@pytest.mark.parametrize("space", ["sRGB", "Non-Color", "Linear Rec.709"])
@pytest.mark.parametrize("alpha_mode", ["STRAIGHT", "PREMUL", "CHANNEL_PACKED", "NONE"])
@pytest.mark.parametrize("float_buffer", [False, True])
def test_tiles_of_all_kinds_come_through(tmp_path, float_buffer, alpha_mode, space):
    """What the first tile holds in memory can be read directly, and so be compared."""
    rng = np.random.default_rng(1)
    contents = {1001: rng.random((6, 8, 4)), 1012: rng.random((9, 5, 4))}
    for pixels in contents.values():
        pixels[..., 3] = 0.2 + 0.8 * pixels[..., 3]
        pixels[..., :3] *= pixels[..., 3:]
    contents = {number: pixels.astype(np.float32) for number, pixels in contents.items()}
    image = add_tiled(tmp_path, contents, float_buffer)
    image.alpha_mode = alpha_mode
    image.colorspace_settings.name = space
    parts = tiles.read_tiles(image)
    assert {n: p.shape for n, p in parts.items()} == {n: p.shape for n, p in contents.items()}
    np.testing.assert_array_equal(parts[1001], read(image))
    turned = {number: pixels[::-1].copy() for number, pixels in parts.items()}
    new = tiles.new_tiled_like(image, "New", turned)
    for copy in (new, image):
        if copy == image:
            tiles.write_tiles(image, turned)
        np.testing.assert_allclose(read(copy), turned[1001], atol=1e-6)
        again = tiles.read_tiles(copy)
        for number, pixels in turned.items():
            np.testing.assert_allclose(again[number], pixels, atol=1e-6)
        assert copy.packed_files
        assert copy.is_float == float_buffer


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("float_buffer", [False, True])
@pytest.mark.parametrize("output", ["NEW", "REPLACE"])
def test_tiles_are_sharpened_together(tmp_path, output, float_buffer, packed):
    """The edge lies on the seam between two tiles."""
    left, right = blend(center=1.0, width=0.05), blend(center=0.0, width=0.05)
    contents = {1001: left, 1002: right, 1011: blend(32)}
    image = add_tiled(tmp_path, contents, float_buffer, packed)
    obj = add_sheet(material=add_material(image), right=2.0)
    obj.scale = (2.0, 1.0, 1.0)
    bpy.context.view_layer.update()
    before = tiles.read_tiles(image)
    path = image.filepath_raw
    assert sharpen(time=4096.0, output=output) == {"FINISHED"}
    result = bpy.data.images["Wood" if output == "REPLACE" else "Wood sharpened"]
    assert result.source == "TILED"
    assert [tile.number for tile in result.tiles] == [1001, 1002, 1011]
    assert result.is_float == float_buffer
    after = tiles.read_tiles(result)
    for number, color in ((1001, 0.1), (1002, 0.9)):  # each side's own color, up to the seam
        old, new = (abs(pixels[number][..., 0] - color).mean() for pixels in (before, after))
        assert new < 0.5 * old
    np.testing.assert_array_equal(after[1011], before[1011])
    assert "on 1 object" in operators.summaries["texture"]
    said = operators.summaries["texture"]
    assert f"{2 * SIZE * SIZE:,} pixels" in said  # what no face shows does not count
    if output == "REPLACE":
        assert result.filepath_raw == path
    else:
        assert node_images(obj) == ["Wood sharpened"]
        for number, pixels in tiles.read_tiles(image).items():
            np.testing.assert_array_equal(pixels, before[number])


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("float_buffer", [False, True])
def test_redo_of_replaced_tiles_starts_from_the_old_pixels(tmp_path, adjust, float_buffer, packed):
    image = add_tiled(tmp_path, {1001: blend(), 1002: blend(center=0.6)}, float_buffer, packed)
    add_sheet(material=add_material(image), right=2.0)
    before = tiles.read_tiles(image)
    bpy.ops.ed.undo_push(message="Start")
    sharpen("EXEC_DEFAULT", True, time=4096.0, output="REPLACE")
    after = tiles.read_tiles(bpy.data.images["Wood"])
    assert all((after[number] != pixels).any() for number, pixels in before.items())
    adjust(time=0.0)
    for number, pixels in tiles.read_tiles(bpy.data.images["Wood"]).items():
        np.testing.assert_array_equal(pixels, before[number])


@pytest.mark.parametrize("assign", [True, False])
@pytest.mark.parametrize("operator", [sharpen, dilate])
def test_both_images_come_back_from_the_file(operator, assign, sheet, tmp_path):
    sheet.image.pack()
    for loop in sheet.obj.data.uv_layers.active.uv:
        loop.vector *= 0.75  # there is something to dilate
    pixels = read(sheet.image)
    operator(assign=assign)
    (new,) = set(bpy.data.images.keys()) - {"Wood"}
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "kept.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "kept.blend"))
    np.testing.assert_array_equal(read(bpy.data.images["Wood"]), pixels)
    unused, used = ("Wood", new) if assign else (new, "Wood")
    assert bpy.data.images[unused].use_fake_user
    assert not bpy.data.images[used].use_fake_user  # the material keeps it


def test_sharpened_tiles_come_back_from_the_file(tmp_path):
    image = add_tiled(tmp_path, {1001: blend(), 1002: blend()})
    add_sheet(material=add_material(image), right=2.0)
    sharpen(time=256.0)
    result = bpy.data.images["Wood sharpened"]
    sharp = tiles.read_tiles(result)
    path = str(tmp_path / "kept.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    for number, pixels in tiles.read_tiles(bpy.data.images["Wood sharpened"]).items():
        np.testing.assert_array_equal(pixels, sharp[number])


@pytest.mark.parametrize("kept", [0, 100])
@pytest.mark.parametrize("output", ["NEW", "REPLACE"])
def test_tiles_are_not_lost_on_a_full_disk(tmp_path, monkeypatch, output, kept):
    """Blender writes empty or broken files then."""
    image = add_tiled(tmp_path, {1001: blend(), 1002: blend()}, packed=True)
    add_sheet(material=add_material(image), right=2.0)
    before = tiles.read_tiles(image)
    names = bpy.data.images.keys()
    read_again = tiles._read

    def truncated(path, number, part):
        if number == 1002 and part.name.startswith("tile"):
            os.truncate(path, kept)
        return read_again(path, number, part)

    monkeypatch.setattr(tiles, "_read", truncated)
    with pytest.raises(RuntimeError, match="Skipped Wood: its tile 1002 cannot be saved; make"):
        sharpen(time=64.0, output=output)
    monkeypatch.undo()
    assert bpy.data.images.keys() == names
    assert len(image.packed_files) == 2
    for number, pixels in tiles.read_tiles(image).items():
        np.testing.assert_array_equal(pixels, before[number])


@pytest.mark.parametrize("output", ["NEW", "REPLACE"])
def test_unpacking_writes_the_tiles_under_their_names(tmp_path, output):
    image = add_tiled(tmp_path, {1001: blend(), 1002: blend()})
    add_sheet(material=add_material(image), right=2.0)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    sharpen(time=256.0, output=output)
    result = bpy.data.images["Wood" if output == "REPLACE" else "Wood sharpened"]
    sharp = tiles.read_tiles(result)
    name = "wood" if output == "REPLACE" else "textures/Wood_sharpened"
    result.unpack(method="WRITE_ORIGINAL" if output == "REPLACE" else "WRITE_LOCAL")
    for number in (1001, 1002):
        written = bpy.data.images.load(str(tmp_path / f"{name}.{number}.png"))
        np.testing.assert_array_equal(read(written), sharp[number])


def test_tiles_that_were_never_saved_are_refused():
    image = bpy.data.images.new("New", 8, 8, tiled=True)
    add_sheet(material=add_material(image))
    with pytest.raises(RuntimeError, match="it has tiles that are not saved; save it first"):
        sharpen(time=16.0)


def test_tiles_that_are_not_saved_are_refused_and_missing_ones_left_out(tmp_path, capfd):
    image = add_tiled(tmp_path, {1001: blend(), 1002: blend()})
    add_sheet(material=add_material(image), right=2.0)
    image.pixels[0] = 0.5
    with pytest.raises(RuntimeError, match="it has tiles that are not saved; save it first"):
        sharpen(time=16.0)
    image.reload()
    read(image)
    (tmp_path / "wood.1002.png").unlink()
    assert sharpen(time=16.0) == {"FINISHED"}
    assert "16 triangles lie in no tile" in capfd.readouterr().out
    assert list(tiles.read_tiles(bpy.data.images["Wood sharpened"])) == [1001]


def test_tiles_may_be_numbered_by_column_and_row(tmp_path):
    for number, name in ((1001, "u1_v1"), (1012, "u2_v2")):
        part = add_image("part", blend(center=0.1 + (number - 1001) / 20))
        part.file_format = "PNG"
        part.save(filepath=f"{tmp_path}/wood.{name}.png")
        bpy.data.images.remove(part)
    image = bpy.data.images.load(f"{tmp_path}/wood.u1_v1.png")
    image.source = "TILED"
    assert image.filepath_raw.endswith("wood.<UVTILE>.png")
    parts = tiles.read_tiles(image)
    assert sorted(parts) == [1001, 1012]
    turned = {number: pixels[:, ::-1].copy() for number, pixels in parts.items()}
    tiles.write_tiles(image, turned)
    image.unpack(method="WRITE_ORIGINAL")
    written = bpy.data.images.load(f"{tmp_path}/wood.u2_v2.png")
    np.testing.assert_array_equal(read(written), turned[1012])


def test_faces_outside_the_tiles_take_no_part(tmp_path, capfd):
    image = add_tiled(tmp_path, {1001: blend()})
    obj = add_sheet(material=add_material(image), right=2.0)
    assert sharpen(time=256.0) == {"FINISHED"}
    assert "16 triangles lie in no tile" in capfd.readouterr().out
    for corner in obj.data.uv_layers.active.uv:
        corner.vector[0] += 5.0
    with pytest.raises(RuntimeError, match="no face lies in one of its tiles"):
        sharpen(image="Wood", time=256.0)


def test_a_mosaic_holds_its_tiles_and_places_their_faces():
    rng = np.random.default_rng(0)
    contents = {n: rng.random((h, w, 4)).astype(np.float32)
                for n, (h, w) in {1001: (4, 6), 1002: (8, 8), 1021: (3, 5)}.items()}  # fmt: skip
    mosaic = Mosaic.of({n: p.shape[:2] for n, p in contents.items()}, 2)
    whole = mosaic.compose(contents)
    assert whole.shape[:2] == (mosaic.height, mosaic.width) == (24, 24)
    for number, pixels in mosaic.cut(whole).items():
        np.testing.assert_array_equal(pixels, contents[number])
    row, column = mosaic.places[1002][:2]
    np.testing.assert_array_equal(whole[row - 1, column : column + 8], contents[1002][0])
    faces = [
        [[1.1, 0.1], [1.9, 0.1], [1.5, 0.9]],  # in tile 1002
        [[0.1, 2.1], [0.9, 2.1], [0.5, 2.9]],  # in tile 1021
        [[0.9, 0.1], [1.5, 0.1], [1.5, 0.9]],  # in two tiles
        [[-1.0, 0.0], [-0.5, 0.0], [-0.5, 1.0]],  # in none
    ]
    uv, inside = mosaic.place(np.array(faces))
    assert inside.tolist() == [True, True, False, False]
    x, y = uv[0, 0] * (mosaic.width, mosaic.height)
    assert (x, y) == pytest.approx((column + 0.8, row + 0.8))
    row, column = mosaic.places[1021][:2]
    assert uv[1, 2] * (24, 24) == pytest.approx((column + 2.5, row + 2.7))


# ------------------------------------------------------------------------------------- denoising


def noisy(size=SIZE, center=0.5):
    """A hard edge with noise, opaque."""
    pixels = blend(size, center, width=0.005)
    pixels[..., :3] += 0.06 * np.random.default_rng(0).normal(size=(size, size, 3))
    return np.clip(pixels, 0.0, 1.0).astype(np.float32)


def test_noise_falls_and_the_material_shows_the_result():
    image = add_image(pixels=noisy())
    sheet = add_sheet(material=add_material(image))
    before = read(image)
    assert denoise() == {"FINISHED"}
    assert node_images(sheet) == ["Wood denoised"]
    after = read(bpy.data.images["Wood denoised"])
    flat = np.s_[:, :24, :3]
    assert after[flat].std(axis=(0, 1)).max() < 0.35 * before[flat].std(axis=(0, 1)).min()
    assert abs(after[:, :30, 0].mean() - after[:, 34:, 0].mean()) > 0.7  # the edge is there
    np.testing.assert_array_equal(after[..., 3], before[..., 3])
    np.testing.assert_array_equal(read(image), before)
    assert operators.summaries["denoise_texture"].startswith(
        "Denoised the texture Wood on 1 object"
    )


def test_noise_falls_across_a_seam():
    """Cut into two charts, the surface gets the same colors as in one piece."""
    whole = noisy(center=0.25)
    cut = np.zeros_like(whole)
    cut[:, :24], cut[:, 40:] = whole[:, :24], whole[:, 24:48]
    uncut = add_sheet("Uncut", add_material(add_image("Whole", whole)), right=0.75)
    denoise(seams="continue", beta=7.0)
    expected = read(bpy.data.images["Whole denoised"])
    bpy.data.objects.remove(uncut)
    add_sheet("Cut", add_material(add_image("Cut", cut)), gap=0.25)
    denoise(seams="continue", assign=False, beta=7.0)
    both = read(bpy.data.images["Cut denoised"])
    assert abs(both[:, :24] - expected[:, :24]).max() < 1.5 / 255
    assert abs(both[:, 40:] - expected[:, 24:48]).max() < 1.5 / 255
    bpy.ops.shock_filter.denoise_image(image="Cut", output="NEW", beta=7.0)
    flat = read(bpy.data.images["Cut denoised.001"])
    assert abs(flat[:, :24] - expected[:, :24]).max() > 4 / 255


def test_denoising_and_sharpening_in_one_run():
    image = add_image(pixels=noisy())
    add_sheet("Cut", add_material(image), gap=0.25)
    assert denoise(assign=False, seams="extend", then_sharpen=True, sharpen_time=16.0) == {
        "FINISHED"
    }
    assert operators.summaries["denoise_texture"].startswith("Denoised and sharpened the texture")


def test_denoised_normals_are_unit_length():
    pixels = np.ones((64, 64, 4), dtype=np.float32)
    tangent = 0.05 * np.random.default_rng(0).normal(size=(64, 64, 2))
    pixels[..., :2] = 0.5 + tangent
    pixels[..., 2] = 0.5 + np.sqrt(0.25 - (tangent**2).sum(axis=-1))
    image = add_image("Bumps", pixels, float_buffer=True, is_data=True)
    add_sheet(material=add_material(image))
    denoise(content="normals", assign=False)
    after = read(bpy.data.images["Bumps denoised"])
    lengths = np.linalg.norm(2.0 * after[..., :3] - 1.0, axis=-1)
    np.testing.assert_allclose(lengths, 1.0, atol=1e-4)
    assert after[..., :2].std() < 0.35 * tangent.std()


def test_denoising_for_no_time_changes_no_bit_and_a_bare_mesh_is_refused():
    image = add_image(pixels=noisy())
    sheet = add_sheet(material=add_material(image))
    denoise(time=0.0, assign=False)
    made = bpy.data.images.get("Wood denoised") or image
    np.testing.assert_array_equal(read(made), read(image))
    sheet.data.uv_layers.remove(sheet.data.uv_layers[0])
    with pytest.raises(RuntimeError, match="no UV map"):
        denoise()
