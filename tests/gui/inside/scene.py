# SPDX-License-Identifier: GPL-3.0-or-later
"""The things that scenarios work on."""

from __future__ import annotations

from importlib import import_module

import bpy
import numpy as np
from harness import MODULE, area
from mathutils import Euler

SIDE = 256


def clear() -> None:
    """Remove all objects."""
    for obj in list(bpy.data.objects):
        bpy.data.objects.remove(obj)


def look() -> None:
    """Look at the world's origin from the front, a little from the right and above."""
    view = area("VIEW_3D").spaces.active.region_3d
    view.view_location = (0, 0, 0)
    view.view_rotation = Euler((1.25, 0, 0.5)).to_quaternion()
    view.view_distance = 6.2
    overlay = area("VIEW_3D").spaces.active.overlay
    overlay.show_floor = overlay.show_axis_x = overlay.show_axis_y = overlay.show_cursor = False


def add_monkey(name: str, levels: int) -> bpy.types.Object:
    """Add Blender's monkey with some ``500 * 4**levels`` vertices, painted in soft bands."""
    bpy.ops.mesh.primitive_monkey_add()
    monkey = bpy.context.object
    monkey.name = name
    monkey.modifiers.new("Finer", "SUBSURF").levels = levels
    bpy.ops.object.modifier_apply(modifier="Finer")
    paint(monkey)
    return monkey


def paint(obj: bpy.types.Object) -> None:
    """Paint the vertices of an object in soft bands."""
    mesh = obj.data
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    colors = mesh.color_attributes.new("Paint", "FLOAT_COLOR", "POINT")
    colors.data.foreach_set("color", bands(points.reshape(-1, 3)).ravel())
    mesh.color_attributes.active_color = colors


def add_remeshed_part(name: str) -> None:
    """Add a box with a cut corner and a channel, out of Blender's voxel remesh, askew to it."""
    bpy.ops.mesh.primitive_cube_add(size=1.6)
    part = bpy.context.object
    part.name = name
    bpy.ops.mesh.primitive_cube_add(size=1.0, location=(0.8, -0.8, 0.8))
    corner = bpy.context.object
    bpy.ops.mesh.primitive_cylinder_add(
        vertices=96, radius=0.4, depth=4.0, location=(-0.2, 0.0, 0.8), rotation=(np.pi / 2, 0, 0)
    )
    for tool in (corner, bpy.context.object):
        cut = part.modifiers.new("Cut", "BOOLEAN")
        cut.operation, cut.object = "DIFFERENCE", tool
    bpy.context.view_layer.objects.active = part
    for cut in list(part.modifiers):
        bpy.ops.object.modifier_apply(modifier=cut.name)
    for tool in (corner, *(obj for obj in bpy.data.objects if obj.name.startswith("Cylinder"))):
        bpy.data.objects.remove(tool)
    part.select_set(True)
    part.data.transform(Euler((0.3, 0.5, 0.2)).to_matrix().to_4x4())
    voxel = part.modifiers.new("Remesh", "REMESH")
    voxel.mode, voxel.voxel_size = "VOXEL", 0.035
    bpy.ops.object.modifier_apply(modifier="Remesh")
    part.data.transform(Euler((0.3, 0.5, 0.2)).to_matrix().to_4x4().inverted())
    part.data.shade_smooth()


def add_bumpy_grid(name: str, side: int) -> None:
    """Add a grid of ``side * side`` vertices with bumps."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=side - 1, y_subdivisions=side - 1)
    grid = bpy.context.object
    grid.name = name
    flat = np.empty(3 * len(grid.data.vertices), np.float32)
    grid.data.vertices.foreach_get("co", flat)
    flat[2::3] = 0.05 * np.tanh(3 * np.sin(20 * flat[0::3]) * np.sin(20 * flat[1::3]))
    grid.data.vertices.foreach_set("co", flat)
    grid.data.update()


def add_texture(obj: bpy.types.Object) -> bpy.types.Image:
    """Unwrap an object and give it a material with a texture of soft bands."""
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.uv.smart_project(island_margin=0.01)
    bpy.ops.object.mode_set(mode="OBJECT")
    image = as_image("Coat", bands(_baked(obj)))
    material = bpy.data.materials.new("Coat")
    material.use_nodes = True
    tree = material.node_tree
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    tree.links.new(node.outputs[0], tree.nodes["Principled BSDF"].inputs[0])
    tree.nodes.active = node
    obj.data.materials.append(material)
    return image


def add_image(name: str) -> bpy.types.Image:
    """Add an image of soft bands with a little noise."""
    y, x = np.mgrid[:SIDE, :SIDE] * (2.0 / SIDE) - 1.0
    values = bands(np.stack([x, y, 2.0 * y + 0.3 * np.sin(5 * x)], axis=2))
    values[..., :3] += np.random.default_rng(0).normal(scale=0.02, size=(SIDE, SIDE, 3))
    return as_image(name, values)


def as_image(name: str, values: np.ndarray) -> bpy.types.Image:
    height, width = values.shape[:2]
    image = bpy.data.images.new(name, width, height)
    image.pixels.foreach_set(values.clip(0, 1).astype(np.float32).ravel())
    image.update()
    return image


def _baked(obj: bpy.types.Object) -> np.ndarray:
    """Return for each pixel of an object's texture where on the object it lies."""
    core = import_module(f"{MODULE}.core")
    mesh = obj.data
    mesh.calc_loop_triangles()
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    faces = np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("vertices", faces)
    corners = np.empty_like(faces)
    mesh.loop_triangles.foreach_get("loops", corners)
    uv = np.empty(2 * len(mesh.loops), np.float32)
    mesh.uv_layers.active.data.foreach_get("uv", uv)
    points, faces = points.reshape(-1, 3), faces.reshape(-1, 3)
    uv = uv.reshape(-1, 2)[corners].reshape(-1, 3, 2)
    atlas = core.TextureAtlas(core.TriangleMesh(points, faces), uv, size=(SIDE, SIDE))
    return atlas.bake(points[faces])


def bands(points: np.ndarray) -> np.ndarray:
    """Return colors (RGBA) at points, in bands along z with soft edges."""
    colors = np.ones((*points.shape[:-1], 4), np.float32)
    waves = np.sin(8 * points[..., 2] + np.sin(5 * points[..., 0]))
    colors[..., 0] = 0.5 + 0.4 * np.tanh(3 * waves)
    colors[..., 1] = 0.4
    colors[..., 2] = 1 - colors[..., 0]
    return colors
