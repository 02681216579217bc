# SPDX-License-Identifier: GPL-3.0-or-later
"""The road from voxels to a low poly with maps: each step pressed in a window, and rendered."""

from pathlib import Path

import bpy
import numpy as np
import scene
from harness import (
    DRAWN,
    PICTURES,
    Steps,
    addon,
    area,
    buttons,
    click,
    finished,
    open_own_panel,
    open_tab,
    over,
    park,
    picture,
    report,
    run,
)
from mathutils import Vector

MAPS = -2
"""Number of the header of its panel in the tab, from the bottom."""

SIDE = 256


def scenario() -> Steps:
    """Sharpen, simplify, unwrap, bake, and render both beside each other."""
    scene.clear()
    scene.add_remeshed_part("Part")
    part = bpy.data.objects["Part"]
    scene.look()
    chosen = bpy.context.scene.shock_filter
    chosen.mode = "GENERATE"
    chosen.generate.target, chosen.generate.image_size = "thickness", "512"
    yield from open_tab()
    for name in ("sharpen_geometry", "crisp_low_poly"):
        run(name)
        yield from finished()
    low = bpy.context.object
    report["faces"] = len(part.data.polygons), len(low.data.polygons)
    plain = bpy.data.materials.new("Plain")
    plain.use_nodes = True
    low.data.materials.append(plain)
    bare = rendered(low)
    low.data.materials.clear()
    unwrap(low)
    high = part
    report["is_hidden"] = high.hide_get()
    high.hide_set(False)
    high.select_set(True)
    yield from open_own_panel(MAPS)
    picture("bake-maps-open", area("VIEW_3D"), width=1400)
    places = yield from buttons()
    report["buttons"] = len(places)
    yield from click(places[-1])
    yield from finished()
    yield from park()
    yield DRAWN
    base = addon("operators.base")
    report["told"] = base.summaries.get("maps", "")
    report["details"] = base.details.get("maps", "")
    report["images"] = sorted(bpy.data.images.keys())
    picture("bake-maps", area("VIEW_3D"), width=1400)
    high.data.materials.append(plain)
    both = rendered(high), rendered(low)
    np.save(PICTURES / "bake-maps-high-low.npy", np.hstack([*both, bare])[::-1])
    report["bare"], report["baked"] = (apart(both[0], each) for each in (bare, both[1]))


def unwrap(obj: bpy.types.Object) -> None:
    """Unwrap an object as a person does."""
    with over():
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.uv.smart_project(angle_limit=1.15, island_margin=0.004)
        bpy.ops.object.mode_set(mode="OBJECT")


def rendered(shown: bpy.types.Object) -> np.ndarray:
    """Return a picture of one object alone: (height, width, RGB) bytes, row 0 at the bottom."""
    settings = bpy.context.scene
    for obj in bpy.data.objects:
        obj.hide_render = obj.type == "MESH" and obj != shown
    if settings.camera is None:
        light(settings)
    settings.render.filepath = str(PICTURES / "render.png")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(settings.render.filepath)
    flat = np.empty(4 * SIDE * SIDE, np.float32)
    image.pixels.foreach_get(flat)
    bpy.data.images.remove(image)
    Path(settings.render.filepath).unlink()
    return np.uint8(255 * flat.reshape(SIDE, SIDE, 4)[..., :3].clip(0, 1))


def light(settings: bpy.types.Scene) -> None:
    """Add a sun, a gray sky and a camera, and let Cycles draw."""
    settings.render.engine = "CYCLES"
    settings.cycles.device, settings.cycles.samples = "CPU", 48
    settings.cycles.use_denoising = False  # not all builds can
    settings.render.resolution_x = settings.render.resolution_y = SIDE
    settings.view_settings.view_transform = "Standard"
    settings.world = bpy.data.worlds.new("World")
    settings.world.color = 0.1, 0.1, 0.1
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.rotation_euler, sun.data.energy = (0.9, 0.3, 0.2), 2.0
    along = Vector((1.0, -1.3, 1.0)).normalized()
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.data.angle = 4.4 * along, 0.66
    camera.rotation_euler = (-along).to_track_quat("-Z", "Y").to_euler()
    for obj in (sun, camera):
        settings.collection.objects.link(obj)
    settings.camera = camera


def apart(one: np.ndarray, other: np.ndarray) -> float:
    """Return the mean difference of two pictures, of 255."""
    return float(np.abs(one.astype(int) - other).mean())
