# SPDX-License-Identifier: GPL-3.0-or-later
"""The maps of a material are sharpened together: the base color leads."""

import bpy
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from shock_filter.core.grid.resize import resized
from shock_filter.shock_addon.data.image import images as image_data
from shock_filter.shock_addon.data.image.maps import maps_of
from shock_filter.shock_addon.operators import base as operators

sharpen = bpy.ops.shock_filter.sharpen_texture
dilate = bpy.ops.shock_filter.dilate_texture

SIZE = 64


def read(image):
    return image_data.read_pixels(image)


def pixels_of(name):
    return read(bpy.data.images[name])


def soft(center=0.5, contrast=0.8, size=SIZE):
    """A soft border between two grays, opaque."""
    place = (np.arange(size) + 0.5) / size
    step = 0.5 + 0.5 * contrast * np.tanh((place - center) / 0.05)
    pixels = np.ones((size, size, 4), dtype=np.float32)
    pixels[..., :3] = step[:, None]
    return pixels


def normals(size=SIZE):
    """Tangent-space normals of a soft bump, as colors."""
    bump = gaussian_filter(np.pad(np.ones((8, 8)), (size - 8) // 2), 4.0)
    slope = np.stack(np.gradient(40.0 * bump)[::-1], axis=-1)
    found = np.concatenate([-slope, np.ones((size, size, 1))], axis=2)
    found /= np.linalg.norm(found, axis=2, keepdims=True)
    opaque = np.ones((size, size, 1))
    return np.concatenate([0.5 + 0.5 * found, opaque], axis=2).astype(np.float32)


def add_image(name, pixels, float_buffer=False):
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(name, width, height, alpha=True, float_buffer=float_buffer)
    image.pixels.foreach_set(np.ascontiguousarray(pixels).reshape(-1))
    image.update()
    return image


class Painted:
    """A sheet whose material has a base color, and what a test adds."""

    def __init__(self):
        bpy.ops.mesh.primitive_grid_add(x_subdivisions=8, y_subdivisions=8)
        self.obj = bpy.context.object
        self.material = bpy.data.materials.new("Paint")
        if bpy.app.version < (5, 0, 0):
            self.material.use_nodes = True
        self.obj.data.materials.append(self.material)
        self.shader = next(n for n in self.nodes if n.type == "BSDF_PRINCIPLED")
        self.color = self.add("Color", soft(), "Base Color")

    @property
    def nodes(self):
        return self.material.node_tree.nodes

    def link(self, output, socket):
        self.material.node_tree.links.new(output, socket)

    def add(self, name, pixels, socket, float_buffer=False):
        node = self.nodes.new("ShaderNodeTexImage")
        node.image = add_image(name, pixels, float_buffer)
        self.link(node.outputs["Color"], self.shader.inputs[socket])
        return node

    def add_normals(self, name="Normal", pixels=None):
        node = self.nodes.new("ShaderNodeTexImage")
        node.image = add_image(name, normals() if pixels is None else pixels, float_buffer=True)
        turn = self.nodes.new("ShaderNodeNormalMap")
        self.link(node.outputs["Color"], turn.inputs["Color"])
        self.link(turn.outputs["Normal"], self.shader.inputs["Normal"])
        return node


@pytest.fixture
def painted():
    return Painted()


def border(pixels):
    """Where the values pass the middle between their ends, in pixels; and how far that takes."""
    profile = pixels[len(pixels) // 2, :, 0]
    shares = (profile - profile[0]) / (profile[-1] - profile[0])
    places = np.interp([0.1, 0.5, 0.9], shares, np.arange(len(profile)))
    return places[1], places[2] - places[0]


def test_all_maps_get_their_border_where_the_base_color_has_it(painted):
    painted.add("Rough", soft(center=0.53, contrast=0.1), "Roughness")
    painted.add("Metal", soft(center=0.47, contrast=0.1), "Metallic", float_buffer=True)
    before = {image.name: read(image) for image in bpy.data.images}
    assert sharpen(maps="MATERIAL") == {"FINISHED"}
    lead = border(pixels_of("Color sharpened"))
    for name in ("Rough", "Metal"):
        np.testing.assert_array_equal(pixels_of(name), before[name])
        old, new = border(before[name]), border(pixels_of(f"{name} sharpened"))
        assert abs(old[0] - lead[0]) > 1.5
        assert abs(new[0] - lead[0]) < 1.0
        assert new[1] < 0.6 * old[1]
    said = operators.summaries["texture"]
    assert said.startswith("Sharpened the texture Color on 1 object into Color sharpened: ")
    assert "With it: Rough sharpened, Metal sharpened." in said
    shown = {node.image.name for node in painted.nodes if node.type == "TEX_IMAGE"}
    assert shown == {"Color sharpened", "Rough sharpened", "Metal sharpened"}


def test_the_lead_gets_what_it_gets_alone(painted):
    painted.add("Rough", soft(0.4), "Roughness")
    sharpen(image="Color", assign=False)
    alone = pixels_of("Color sharpened")
    bpy.data.images.remove(bpy.data.images["Color sharpened"])
    sharpen(image="Color", maps="MATERIAL")
    np.testing.assert_array_equal(pixels_of("Color sharpened"), alone)


def test_the_base_color_leads_whatever_is_chosen(painted):
    rough = painted.add("Rough", soft(0.4, contrast=0.1), "Roughness")
    painted.nodes.active = rough
    maps = maps_of(bpy.context, rough.image)
    assert (maps.lead.name, maps.left) == ("Color", [])
    assert {image.name: kind for image, kind in maps.followers.items()} == {"Rough": "values"}
    sharpen(maps="MATERIAL")
    assert "Sharpened the texture Color " in operators.summaries["texture"]


def test_without_a_base_color_the_chosen_image_leads(painted):
    painted.material.node_tree.links.remove(painted.color.outputs["Color"].links[0])
    rough = painted.add("Rough", soft(0.4), "Roughness")
    maps = maps_of(bpy.context, rough.image)
    assert maps.lead == rough.image
    assert [image.name for image in maps.followers] == ["Color"]


def test_normals_stay_unit_vectors(painted):
    painted.add_normals()
    sharpen(maps="MATERIAL", width=6.0)
    vectors = 2.0 * pixels_of("Normal sharpened")[..., :3] - 1.0
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=-1), 1.0, atol=1e-4)
    assert (pixels_of("Normal sharpened") != pixels_of("Normal")).any()


def test_normals_are_found_behind_other_nodes(painted):
    node = painted.add_normals()
    apart, joined = (
        painted.nodes.new(f"ShaderNode{kind}Color") for kind in ("Separate", "Combine")
    )
    (link,) = node.outputs["Color"].links
    target = link.to_socket
    painted.link(node.outputs["Color"], apart.inputs[0])
    for number in range(3):
        painted.link(apart.outputs[number], joined.inputs[number])
    painted.link(joined.outputs[0], target)
    assert list(maps_of(bpy.context, painted.color.image).followers.values()) == ["normals"]


def test_maps_of_another_size_follow(painted):
    painted.add("Rough", soft(center=0.51, contrast=0.1, size=128), "Roughness")
    sharpen(maps="MATERIAL", what="drawing")
    place, width = border(pixels_of("Rough sharpened"))
    lead, _ = border(pixels_of("Color sharpened"))
    assert abs((place + 0.5) / 128 - (lead + 0.5) / SIZE) < 0.012
    assert width < 0.6 * border(pixels_of("Rough"))[1]


def test_maps_that_lie_elsewhere_are_left_out_with_the_reason(painted):
    rough = painted.add("Rough", soft(), "Roughness")
    moved = painted.nodes.new("ShaderNodeMapping")
    painted.link(moved.outputs["Vector"], rough.inputs["Vector"])
    metal = painted.add("Metal", soft(), "Metallic")
    places = painted.nodes.new("ShaderNodeTexCoord")
    painted.link(places.outputs["UV"], metal.inputs["Vector"])
    maps = maps_of(bpy.context, painted.color.image)
    assert [image.name for image in maps.followers] == ["Metal"]
    reason = "Skipped Rough: it is mapped to the surface in another way than Color."
    assert maps.left == [reason]
    sharpen(maps="MATERIAL")
    assert reason in operators.summaries["texture"]
    assert "Rough sharpened" not in bpy.data.images
    painted.link(moved.outputs["Vector"], painted.color.inputs["Vector"])
    assert [i.name for i in maps_of(bpy.context, painted.color.image).followers] == ["Rough"]


def test_images_that_cannot_be_filtered_are_left_out_with_the_reason(painted):
    painted.add("Rough", soft(), "Roughness").image.source = "SEQUENCE"
    tiled = bpy.data.images.new("Tiled", 8, 8, tiled=True)
    painted.add("Metal", soft(), "Metallic").image = tiled
    sharpen(maps="MATERIAL")
    said = operators.summaries["texture"]
    assert "Skipped Rough: it is an image sequence" in said
    assert "Skipped Tiled: only one of it and Color has UDIM tiles." in said


def test_redo_writes_the_same_images_again(painted, adjust):
    painted.add("Rough", soft(0.4), "Roughness")
    bpy.ops.ed.undo_push(message="Start")
    sharpen("EXEC_DEFAULT", True, maps="MATERIAL")
    first = pixels_of("Rough sharpened")
    names = bpy.data.images.keys()
    adjust(amount=0.5)
    assert bpy.data.images.keys() == names
    assert (pixels_of("Rough sharpened") != first).any()


def test_after_all_maps_redo_of_one_takes_the_chosen_image(painted, adjust):
    painted.add("Rough", soft(0.4), "Roughness")
    bpy.ops.ed.undo_push(message="Start")
    sharpen("EXEC_DEFAULT", True, image="Rough", maps="MATERIAL")
    adjust(maps="ONE")
    assert "the texture Rough" in operators.summaries["texture"]


def test_redo_of_replaced_maps_starts_from_the_old_pixels(painted, adjust):
    painted.add("Rough", soft(0.4), "Roughness")
    for image in bpy.data.images:
        image.use_fake_user = True
    old = {name: pixels_of(name) for name in ("Color", "Rough")}
    bpy.ops.ed.undo_push(message="Start")
    sharpen("EXEC_DEFAULT", True, maps="MATERIAL", output="REPLACE")
    assert all((pixels_of(name) != old[name]).any() for name in old)
    adjust(amount=0.0)
    for name, pixels in old.items():
        inside = slice(2, -2)
        np.testing.assert_array_equal(pixels_of(name)[inside, inside], pixels[inside, inside])


def test_dilating_takes_all_maps_too(painted):
    painted.add("Rough", soft(), "Roughness")
    for corner in painted.obj.data.uv_layers.active.uv:
        corner.vector = [0.25 + 0.5 * each for each in corner.vector]
    assert dilate(maps="MATERIAL") == {"FINISHED"}
    assert {"Color dilated", "Rough dilated"} <= set(bpy.data.images.keys())


@pytest.mark.parametrize("size", [(32, 32), (128, 128), (24, 100), (64, 64)])
def test_resizing_keeps_means_and_slopes(size):
    y, x = (np.mgrid[:SIZE, :SIZE] + 0.5) / SIZE
    pixels = np.stack([x, y, 0.5 * (x + y)], axis=-1).astype(np.float32)
    result = resized(pixels, size)
    y, x = (np.mgrid[: size[0], : size[1]] + 0.5) / np.reshape(size, (2, 1, 1))
    inside = slice(4, -4)
    np.testing.assert_allclose(result[inside, inside, 0], x[inside, inside], atol=2e-3)
    np.testing.assert_allclose(result[inside, inside, 1], y[inside, inside], atol=2e-3)


def test_resizing_lends_no_color_of_transparent_pixels():
    pixels = np.zeros((16, 16, 4), np.float32)
    pixels[:, 8:] = (0.7, 0.2, 0.1, 1.0)
    result = resized(pixels, (7, 7))
    seen = result[..., 3] > 0
    assert 0 < seen.mean() < 1
    np.testing.assert_allclose(result[seen][:, :3], [[0.7, 0.2, 0.1]] * seen.sum(), atol=1e-6)
