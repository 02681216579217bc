# SPDX-License-Identifier: GPL-3.0-or-later
"""Normal maps through Detail and Stitch: they light the model as Blender's tangents say."""

import time

import bpy
import numpy as np
import pytest
from shock_filter.shock_addon.data.image import images as image_data
from shock_filter.shock_addon.modes import find
from shock_filter.shock_addon.operators import base as operators
from shock_filter.shock_addon.preview import images as preview_images
from shock_filter.shock_addon.preview.previewing import parameters_of

filter_texture = bpy.ops.shock_filter.filter_texture
stitch_textures = bpy.ops.shock_filter.stitch_textures

SIZE = 96
CELLS = 8


def add_image(name, pixels):
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(name, width, height, alpha=True, is_data=True, float_buffer=True)
    image.pixels.foreach_set(np.ascontiguousarray(pixels, np.float32).reshape(-1))
    image.update()
    return image


def shown(preview):
    """Tick until the newest settings are shown."""
    for _ in range(6000):
        preview.tick()
        if not preview.is_computing:
            return
        time.sleep(0.01)
    raise AssertionError("The preview did not settle.")


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


class Bumpy:
    """A bumpy sheet whose halves lie turned, and mirrored, in the texture, with waves on it."""

    def __init__(self, sharp=False):
        steps = np.linspace(-1.0, 1.0, CELLS + 1)
        x, y = np.meshgrid(steps, steps, indexing="ij")
        height = 0.3 * np.sin(3.0 * x) * np.cos(2.0 * y)
        vertices = np.stack([x, y, height], axis=-1).reshape(-1, 3)
        a = (np.arange(CELLS)[:, None] * (CELLS + 1) + np.arange(CELLS)).reshape(-1)
        b = a + CELLS + 1
        faces = np.concatenate([np.stack([a, b, b + 1], 1), np.stack([a, b + 1, a + 1], 1)])
        flat = vertices[faces][..., :2]
        x, y = np.moveaxis(flat, -1, 0)
        right = (flat.mean(axis=1)[:, 0] > 0)[:, None, None]
        turned = np.stack([0.5 - 0.4 * y, 0.05 + 0.4 * x], axis=-1)
        self.uv = uv = np.where(right, turned, np.stack([0.5 + 0.4 * y, 0.95 + 0.4 * x], axis=-1))
        mesh = bpy.data.meshes.new("Sheet")
        mesh.from_pydata(vertices.tolist(), [], faces.tolist())
        if not sharp:
            mesh.shade_smooth()
        mesh.uv_layers.new(name="UV").data.foreach_set("uv", uv.reshape(-1).astype(np.float32))
        self.obj = bpy.data.objects.new("Sheet", mesh)
        bpy.context.collection.objects.link(self.obj)
        bpy.context.view_layer.objects.active = self.obj
        self.obj.select_set(True)
        material = bpy.data.materials.new("Paint")
        if bpy.app.version < (5, 0, 0):
            material.use_nodes = True
        self.obj.data.materials.append(material)
        self.nodes, self.links = material.node_tree.nodes, material.node_tree.links
        self.axes = self._axes()

    def _axes(self):
        """Tangents, bitangents and normals of Blender at the corners of the faces."""
        mesh = self.obj.data
        mesh.calc_tangents(uvmap="UV")
        read = {}
        for name in ("tangent", "normal"):
            flat = np.empty(3 * len(mesh.loops), dtype=np.float32)
            mesh.loops.foreach_get(name, flat)
            read[name] = flat.reshape(-1, 3, 3).astype(float)
        signs = np.empty(len(mesh.loops), dtype=np.float32)
        mesh.loops.foreach_get("bitangent_sign", signs)
        across = signs.reshape(-1, 3, 1) * np.cross(read["normal"], read["tangent"])
        mesh.free_tangents()
        return np.stack([read["tangent"], across, read["normal"]], axis=2)

    def at_texels(self):
        """For texels inside faces: rows, columns, the face, and shares of its corners."""
        y, x = np.mgrid[:SIZE, :SIZE]
        u, v = (x + 0.5) / SIZE, (y + 0.5) / SIZE
        found = []
        for face, corners in enumerate(self.uv):
            one, other = corners[1] - corners[0], corners[2] - corners[0]
            place = np.stack([u, v], axis=-1) - corners[0]
            s, t = np.moveaxis(place @ np.linalg.inv(np.stack([one, other])), -1, 0)
            rows, columns = np.nonzero((s >= 0) & (t >= 0) & (s + t < 1))
            s, t = s[rows, columns], t[rows, columns]
            shares = np.stack([1 - s - t, s, t], axis=1)
            found.append((rows, columns, np.full(len(rows), face), shares))
        return [np.concatenate(part) for part in zip(*found, strict=True)]

    def waves(self, in_space):
        """A normal map: unit vectors in the object's space, or in its frames."""
        rows, columns, faces, shares = self.at_texels()
        points = np.stack([self.obj.data.vertices[i].co for i in range((CELLS + 1) ** 2)])
        corners = np.array([p.vertices[:] for p in self.obj.data.polygons])
        places = np.einsum("tk,tkx->tx", shares, points[corners[faces]])
        axes = np.einsum("tk,tkax->tax", shares, self.axes[faces])
        bump = 0.4 * np.stack(
            [np.sin(15 * places[:, 0]), np.cos(10 * places[:, 1]), 0 * places[:, 0]], axis=-1
        )
        vectors = unit(axes[:, 2] + bump)
        if not in_space:
            vectors = np.linalg.solve(np.swapaxes(axes, 1, 2), vectors[..., None])[..., 0]
        pixels = np.full((SIZE, SIZE, 4), 0.5, dtype=np.float32)
        pixels[..., 3] = 1.0
        pixels[rows, columns, :3] = 0.5 + 0.5 * unit(vectors)
        return pixels

    def seen(self, pixels, in_space):
        """The vectors that a map shows at texels, in the object's space."""
        rows, columns, faces, shares = self.at_texels()
        vectors = 2.0 * pixels[rows, columns, :3] - 1.0
        if in_space:
            return unit(vectors)
        axes = np.einsum("tk,tkax->tax", shares, self.axes[faces])
        return unit(np.einsum("ta,tax->tx", vectors, axes))

    def add(self, name, in_space=False, space="TANGENT"):
        """The map in the material, behind a Normal Map node if there is a space."""
        image = add_image(name, self.waves(in_space))
        node = self.nodes.new("ShaderNodeTexImage")
        node.image = image
        self.nodes.active = node
        if space:
            turn = self.nodes.new("ShaderNodeNormalMap")
            turn.space = space
            self.links.new(node.outputs["Color"], turn.inputs["Color"])
        return image


def degrees(one, other):
    return np.degrees(np.arccos(np.clip((one * other).sum(axis=1), -1, 1)))


def pixels_of(name):
    return image_data.read_pixels(bpy.data.images[name])


SOFT = {"gain": 0.0, "radius": 4.0, "seams": "continue", "assign": False}


@pytest.mark.parametrize("scale", [(1, 1, 1), (2, 2, 2), (-1, 1, 1)])
@pytest.mark.parametrize("sharp", [False, True])
def test_maps_of_both_spaces_are_lit_alike(scale, sharp):
    sheet = Bumpy(sharp)
    sheet.obj.scale = scale
    bpy.context.view_layer.update()
    sheet.add("Tangent")
    assert filter_texture(image="Tangent", **SOFT) == {"FINISHED"}
    assert "goes to a Normal Map node" in operators.summaries["detail"]
    sheet.add("Object", in_space=True, space="OBJECT")
    assert filter_texture(image="Object", **SOFT) == {"FINISHED"}
    found = sheet.seen(pixels_of("Tangent filtered"), in_space=False)
    expected = sheet.seen(pixels_of("Object filtered"), in_space=True)
    # Texels on an edge between flat faces have the frame of either.
    assert np.quantile(degrees(found, expected), 0.9 if sharp else 0.99) < 0.5
    before = sheet.seen(pixels_of("Object"), in_space=True)
    assert degrees(found, before).mean() > 5


def test_what_no_node_says_is_said_by_the_setting():
    sheet = Bumpy()
    sheet.add("Plain", space="")
    filter_texture(image="Plain", **SOFT)
    sheet.add("Linked")
    filter_texture(image="Linked", **SOFT)
    expected = pixels_of("Linked filtered")
    assert np.abs(pixels_of("Plain filtered") - expected).max() > 0.1
    filter_texture(image="Plain", content="normals", **SOFT)
    np.testing.assert_array_equal(pixels_of("Plain filtered.001"), expected)


def test_stitched_normals_stay_unit_vectors():
    sheet = Bumpy()
    sheet.add("Tangent")
    stitch_textures(image="Tangent", radius=20.0, assign=False)
    found = sheet.seen(pixels_of("Tangent stitched"), in_space=False)
    before = sheet.seen(pixels_of("Tangent"), in_space=False)
    assert np.quantile(degrees(found, before), 0.9) < 3  # there is no step to take away
    rows, columns, *_ = sheet.at_texels()
    lengths = np.linalg.norm(2 * pixels_of("Tangent stitched")[rows, columns, :3] - 1, axis=1)
    assert np.abs(lengths - 1).max() < 1e-5


def test_a_preview_shows_normals_as_the_run_makes_them():
    sheet = Bumpy()
    image = sheet.add("Tangent")
    settings = bpy.context.scene.shock_filter.detail
    settings.image, settings.seams = image.name, "continue"
    preview = preview_images.begin(bpy.context, None, find("detail"))
    seen = []
    preview.stage.show = lambda result: seen.append(result.pixels)
    preview.parameters.radius = 4.0
    for gain in (2.0, 0.0, 3.0):
        preview.parameters.gain = gain
        shown(preview)
        settings.gain, settings.radius = gain, 4.0
        filter_texture(image="Tangent", gain=gain, radius=4.0, seams="continue", assign=False)
        result = pixels_of(sorted(i.name for i in bpy.data.images if "filtered" in i.name)[-1])
        assert np.abs(seen[-1] - result).max() < 0.02
    preview.end()
    assert parameters_of(bpy.context.scene, find("detail")).content == "values"
