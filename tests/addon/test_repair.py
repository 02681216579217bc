# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators Fill Texture, Make Tileable and Remove Blocks."""

import io

import bpy
import numpy as np
import pytest
from PIL import Image
from shock_filter.shock_addon.data.image import images as image_data

filters = bpy.ops.shock_filter
SIZE = 64


def read(name):
    return image_data.read_pixels(bpy.data.images[name])


def add_image(name, pixels, **words):
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(name, width, height, alpha=True, **words)
    image.pixels.foreach_set(np.ascontiguousarray(pixels, np.float32).reshape(-1))
    image.update()
    return image


@pytest.fixture
def sheet():
    """A sheet that shows an image."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=8, y_subdivisions=8, calc_uvs=True)
    obj = bpy.context.object
    material = bpy.data.materials.new("Paint")
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    material.node_tree.nodes.active = node
    obj.data.materials.append(material)
    return node


def ramp():
    pixels = np.ones((SIZE, SIZE, 4), dtype=np.float32)
    pixels[..., :3] = np.linspace(0.2, 0.8, SIZE)[None, :, None]
    return pixels


def test_transparent_texels_are_filled_and_others_stay(sheet):
    pixels = ramp()
    pixels[20:40, 24:36] = 0.0
    sheet.image = add_image("Holes", pixels, float_buffer=True, is_data=True)
    assert filters.fill_texture(output="NEW") == {"FINISHED"}
    result = read("Holes filled")
    assert np.abs(result - ramp())[20:40, 24:36].max() < 0.01
    known = np.ones((SIZE, SIZE), dtype=bool)
    known[20:40, 24:36] = False
    assert (result[known] == read("Holes")[known]).all()


def test_normals_in_object_space_are_repaired_as_values(sheet):
    pixels = ramp()
    pixels[20:40, 24:36] = 0.0
    sheet.image = add_image("Normals", pixels, float_buffer=True, is_data=True)
    tree = sheet.id_data
    node = tree.nodes.new("ShaderNodeNormalMap")
    node.space = "OBJECT"
    tree.links.new(sheet.outputs["Color"], node.inputs["Color"])
    assert filters.repair_texture(output="NEW", fill="opacity") == {"FINISHED"}
    assert np.abs(read("Normals repaired") - ramp())[20:40, 24:36].max() < 0.03


def test_the_report_says_that_there_are_no_blocks_but_not_that_nothing_changes(sheet, capfd):
    pixels = ramp()
    pixels[..., :3] = 0.5 + 0.3 * np.tanh(np.linspace(-12.0, 12.0, SIZE))[None, :, None]
    sheet.image = add_image("Soft", pixels)
    assert filters.repair_texture() == {"FINISHED"}
    said = capfd.readouterr().out
    assert (read("Soft repaired") != read("Soft")).any()
    assert "There are no blocks of JPEG compression. " in said
    assert "stays" not in said


def test_a_mask_says_what_is_missing(sheet):
    pixels = ramp()
    pixels[20:40, 24:36, :3] = 0.9
    sheet.image = add_image("Scratched", pixels, float_buffer=True, is_data=True)
    mask = np.zeros((SIZE, SIZE, 4), dtype=np.float32)
    mask[20:40, 24:36, :3], mask[..., 3] = 1.0, 1.0
    add_image("Mask", mask, is_data=True)
    assert filters.fill_texture(output="NEW", mask_image="Mask") == {"FINISHED"}
    assert np.abs(read("Scratched filled") - ramp())[20:40, 24:36].max() < 0.01


def test_sides_of_an_image_meet():
    add_image("Ground", ramp(), float_buffer=True, is_data=True)
    assert filters.make_tileable(image="Ground", output="NEW") == {"FINISHED"}
    result = read("Ground joined")
    assert np.abs(result[:, 0] - result[:, -1]).max() < 0.02
    assert np.abs(read("Ground")[:, 0] - read("Ground")[:, -1]).max() > 0.5


def test_blocks_go_and_clean_images_stay():
    y, x = np.mgrid[:128, :128] / 128
    rng = np.random.default_rng(0)
    clean = 128 + 60 * np.tanh(30 * np.sin(7 * x + 3 * y)) + rng.normal(0, 6, x.shape)
    clean = np.uint8(np.clip(clean, 0, 255))
    file = io.BytesIO()
    Image.fromarray(clean).save(file, "JPEG", quality=40)
    for name, gray in (("Clean", clean), ("Blocks", np.asarray(Image.open(file)))):
        pixels = np.ones((128, 128, 4), dtype=np.float32)
        pixels[..., :3] = (gray / 255.0)[..., None]
        add_image(name, pixels)
        assert filters.remove_blocks(image=name, output="NEW") == {"FINISHED"}
    assert "Clean cleaned" not in bpy.data.images
    before, after = (
        np.abs(read(name)[..., 0] - read("Clean")[..., 0]).mean()
        for name in ("Blocks", "Blocks cleaned")
    )
    assert 0 < after < before


def test_polygons_with_points_on_straight_borders_are_repaired():
    """They are cut into faces that have no area but for rounding, which count for nothing."""
    bpy.ops.mesh.primitive_cylinder_add(vertices=48, radius=0.7, depth=1.8)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.subdivide(number_cuts=5)
    bpy.ops.object.mode_set(mode="OBJECT")
    for vertex in bpy.context.object.data.vertices:
        vertex.co.xy *= 1 + 0.25 * np.cos(1.4 * vertex.co.z)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.uv.smart_project(island_margin=0.02)
    bpy.ops.object.mode_set(mode="OBJECT")
    y, x = np.mgrid[:256, :256] / 256.0
    waves = [0.5 + 0.3 * np.sin(20.0 * x + 13.0 * y + k) for k in range(3)]
    add_image("Waves", np.stack([*waves, np.ones_like(x)], axis=2))
    assert filters.repair_texture(image="Waves") == {"FINISHED"}
