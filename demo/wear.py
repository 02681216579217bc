# SPDX-License-Identifier: GPL-3.0-or-later
"""Render made parts with masks of wear, and a low poly beside what its maps are of.

``python demo/wear.py wear FOLDER`` writes the pictures of wear, ``python demo/wear.py road FOLDER``
that of a part of voxels that is sharpened, simplified and baked.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import shock_filter
from mathutils import Vector
from PIL import Image
from shock_filter import core

SIZE = 512
PIXELS = 360
COUNT = 24
"""Of colors, so that files are small."""
COLORS = (0.06, 0.1, 0.17, 1.0), (0.85, 0.8, 0.7, 1.0)


def bracket() -> None:
    """An angle of two plates with a hole each."""
    upright, along = _box((0.25, 1.2, 1.4), (-0.875, 0, 0.7)), (0, math.pi / 2, 0)
    holes = _cylinder(0.25, 1, (0.4, 0, 0)), _cylinder(0.25, 1, (-0.9, 0, 0.95), along)
    plate = _box((2, 1.2, 0.25), (0, 0, 0.125))
    _boolean(plate, upright, "UNION")
    for hole in holes:
        _boolean(plate, hole, "DIFFERENCE")


def of_voxels() -> None:
    """The bracket, remeshed."""
    bracket()
    _modify("REMESH", mode="VOXEL", voxel_size=0.03)


def with_fillets() -> None:
    """The bracket, beveled."""
    bracket()
    _modify("BEVEL", width=0.05, segments=4, limit_method="ANGLE")


def gear() -> None:
    """A disk with bites, a hollow and a hole."""
    turns = [i * math.pi / 6 for i in range(12)]
    bites = [_cylinder(0.16, 2, (1.03 * math.cos(t), 1.03 * math.sin(t), 0)) for t in turns]
    bites += [_cylinder(0.3, 2, (0, 0, 0)), _cylinder(0.7, 0.3, (0, 0, 0.4))]
    disk = _cylinder(1, 0.4, (0, 0, 0.2), vertices=96)
    for bite in bites:
        _boolean(disk, bite, "DIFFERENCE")


def crate() -> None:
    """A box with sunken sides, turned and remeshed."""
    box = _box((1.6, 1.6, 1.6), (0, 0, 0.8))
    sides = [
        _box([0.3 if i == axis else 1.2 for i in range(3)],
             [0.8 * sign + 0.1 * sign if i == axis else 0.8 * (i == 2) for i in range(3)])
        for axis in range(2) for sign in (-1, 1)
    ]  # fmt: skip
    for side in sides:
        _boolean(box, side, "DIFFERENCE")
    box.rotation_euler = 0.3, 0.2, 0.4
    bpy.ops.object.transform_apply()
    _modify("REMESH", mode="VOXEL", voxel_size=0.025)


def head() -> None:
    """Blender's monkey on a plinth, of voxels."""
    plinth = _box((1.5, 1.5, 0.4), (0, 0, -0.15))
    bpy.ops.mesh.primitive_monkey_add(size=2, location=(0, 0, 0.9))
    monkey = bpy.context.object
    _modify("SUBSURF", levels=2)
    _boolean(monkey, plinth, "UNION")
    _modify("REMESH", mode="VOXEL", voxel_size=0.025)


PARTS = bracket, of_voxels, with_fillets, gear, crate, head


def wear(folder: Path) -> None:
    """Draw worn edges on all parts, and dirt and dust on some."""
    pictures = [_worn(part, "edges", folder) for part in PARTS]
    _tile(pictures, 3).save(folder / "wear-edges.png", optimize=True)
    both = (gear, "dirt"), (head, "dirt"), (head, "dust")
    pictures = [_worn(part, kind, folder) for part, kind in both]
    _tile(pictures, 3).save(folder / "wear-dirt-dust.png", optimize=True)


def road(folder: Path) -> None:
    """Sharpen a part of voxels, simplify it, and bake it onto the result."""
    shock_filter.register()
    _reset()
    of_voxels()
    high = bpy.context.object
    bpy.ops.shock_filter.sharpen_geometry()
    bpy.ops.shock_filter.crisp_low_poly()
    low = bpy.context.object
    _unwrap(low)
    high.hide_set(False)
    high.select_set(True)
    bpy.ops.shock_filter.bake_maps(from_selected=True, image_size="1024")
    material = low.active_material
    nodes, links = material.node_tree.nodes, material.node_tree.links
    shader = nodes["Principled BSDF"]
    shade = next(n for n in nodes if n.type == "TEX_IMAGE" and n.image.name.endswith("_ao"))
    mix = nodes.new("ShaderNodeMixRGB")
    mix.blend_type, mix.inputs[0].default_value = "MULTIPLY", 1.0
    mix.inputs[2].default_value = shader.inputs["Base Color"].default_value  # as the other part is
    links.new(shade.outputs["Color"], mix.inputs[1])
    links.new(mix.outputs[0], shader.inputs["Base Color"])
    print(f"{len(high.data.polygons)} faces, low poly {len(low.data.polygons)}")
    pictures = []
    bpy.context.scene.view_settings.exposure = -0.3  # both are light gray
    for shown, hidden in ((high, low), (low, high)):
        hidden.hide_render, shown.hide_render = True, False
        pictures.append(_render(shown, folder / "part.png", sky=0.3))
    _tile(pictures, 2, 96).save(folder / "road.png", optimize=True)
    shock_filter.unregister()


def _worn(part: Callable[[], None], kind: str, folder: Path) -> Image.Image:
    _reset()
    part()
    obj = bpy.context.object
    _unwrap(obj)
    mesh, uv = _arrays(obj)
    mask = core.wear(mesh, uv, core.WearSettings(kind=kind), size=(SIZE, SIZE))
    _dress(obj, mask)
    return _render(obj, folder / "part.png")


def _reset() -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)


def _box(sides: Iterable[float], place: Iterable[float]) -> Any:
    bpy.ops.mesh.primitive_cube_add(size=1, location=tuple(place))
    bpy.context.object.scale = tuple(sides)
    bpy.ops.object.transform_apply()
    return bpy.context.object


def _cylinder(
    radius: float, depth: float, place: Any, turn: Any = (0, 0, 0), vertices: int = 48
) -> Any:
    bpy.ops.mesh.primitive_cylinder_add(
        radius=radius, depth=depth, location=place, rotation=turn, vertices=vertices
    )
    return bpy.context.object


def _modify(kind: str, **given: Any) -> None:
    obj = bpy.context.object
    modifier = obj.modifiers.new(kind, kind)
    for name, value in given.items():
        setattr(modifier, name, value)
    bpy.ops.object.modifier_apply(modifier=modifier.name)


def _boolean(obj: Any, other: Any, operation: str) -> None:
    bpy.context.view_layer.objects.active = obj
    _modify("BOOLEAN", operation=operation, object=other, solver="EXACT")
    bpy.data.objects.remove(other)


def _unwrap(obj: Any) -> None:
    bpy.ops.object.select_all(action="DESELECT")
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.uv.smart_project(angle_limit=1.15, island_margin=0.004)
    bpy.ops.object.mode_set(mode="OBJECT")


def _arrays(obj: Any) -> tuple[core.TriangleMesh, np.ndarray]:
    data = obj.data
    data.calc_loop_triangles()
    vertices = np.empty(3 * len(data.vertices))
    data.vertices.foreach_get("co", vertices)
    faces, loops = (np.empty(3 * len(data.loop_triangles), np.int32) for _ in range(2))
    data.loop_triangles.foreach_get("vertices", faces)
    data.loop_triangles.foreach_get("loops", loops)
    uv = np.empty(2 * len(data.loops))
    data.uv_layers.active.uv.foreach_get("vector", uv)
    mesh = core.TriangleMesh(vertices.reshape(-1, 3), faces.reshape(-1, 3))
    return mesh, uv.reshape(-1, 2)[loops].reshape(-1, 3, 2)


def _dress(obj: Any, mask: np.ndarray) -> None:
    image = bpy.data.images.new("Mask", *mask.shape[::-1], float_buffer=True, is_data=True)
    pixels = np.ones((*mask.shape, 4), np.float32)
    pixels[..., :3] = mask[..., None]
    image.pixels.foreach_set(pixels.reshape(-1))
    material = bpy.data.materials.new("Material")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    texture, mix = nodes.new("ShaderNodeTexImage"), nodes.new("ShaderNodeMixRGB")
    texture.image = image
    for number, color in enumerate(COLORS):
        mix.inputs[1 + number].default_value = color
    links.new(texture.outputs["Color"], mix.inputs[0])
    links.new(mix.outputs[0], nodes["Principled BSDF"].inputs["Base Color"])
    obj.data.materials.clear()
    obj.data.materials.append(material)


def _render(obj: Any, path: Path, sky: float = 1.0) -> Image.Image:
    scene = bpy.context.scene
    for other in [each for each in bpy.data.objects if each.type in ("LIGHT", "CAMERA")]:
        bpy.data.objects.remove(other)
    scene.render.engine, scene.cycles.samples, scene.cycles.device = "CYCLES", 24, "CPU"
    scene.render.resolution_x = scene.render.resolution_y = PIXELS
    scene.view_settings.view_transform = "Standard"
    scene.world = bpy.data.worlds.new("World")
    scene.world.use_nodes = True
    light = scene.world.node_tree.nodes["Background"].inputs
    light["Color"].default_value, light["Strength"].default_value = (0.6, 0.65, 0.7, 1), sky
    bpy.ops.object.light_add(type="SUN", rotation=(0.6, 0.3, 0.5))
    bpy.context.object.data.energy = 2
    corners = [obj.matrix_world @ Vector(corner) for corner in obj.bound_box]
    middle = sum(corners, Vector()) / 8
    far = max((corner - middle).length for corner in corners)
    along = Vector((1, -1.3, 1)).normalized()
    bpy.ops.object.camera_add(location=middle + 3.2 * far * along)
    scene.camera = bpy.context.object
    scene.camera.rotation_euler = (-along).to_track_quat("-Z", "Y").to_euler()
    scene.camera.data.angle = 0.66
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    picture = Image.open(path).convert("RGB")
    path.unlink()
    return picture


def _tile(pictures: list[Image.Image], columns: int, colors: int = COUNT) -> Image.Image:
    rows = -(-len(pictures) // columns)
    sheet = Image.new("RGB", (columns * PIXELS, rows * PIXELS))
    for number, picture in enumerate(pictures):
        row, column = divmod(number, columns)
        sheet.paste(picture, (column * PIXELS, row * PIXELS))
    return sheet.resize((sheet.width // 2, sheet.height // 2)).quantize(colors, dither=0)


def main() -> None:
    """Render what the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("wear", "road"))
    parser.add_argument("folder", type=Path)
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    {"wear": wear, "road": road}[given.what](given.folder)


if __name__ == "__main__":
    main()
