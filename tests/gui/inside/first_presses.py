# SPDX-License-Identifier: GPL-3.0-or-later
"""A session after installing: each button is pressed for the first time, and once more."""

import sys
import time

import bpy
import scene
from harness import Steps, area, finished, open_tab, over, report

MAPS = "curvature", "occlusion", "thickness", "wear"

_OF_IMAGES = ("texture", "textures", "image")


def scenario() -> Steps:
    """Open the tab, and press each button twice."""
    scene.clear()
    monkey = scene.add_monkey("Monkey", 2)
    add_texture(monkey)
    scene.look()
    yield from open_tab()
    yield from finished()  # the kernels are loaded
    yield from presses()
    report["numba"] = "numba" in sys.modules


def presses() -> Steps:
    """Press the button of each mode, and write down how long it took."""
    area("VIEW_3D").type = "VIEW_3D"
    operators = ["sharpen_geometry", "denoise", "sharpen_colors", "sharpen_texture"]
    operators += ["filter_texture", "stitch_textures", "dilate_texture"]
    operators += ["sharpen_image", "denoise_image", "denoise_texture"]
    generated = [
        ("generate", {"target": each}) for each in ("distance", "streaks", "pattern", *MAPS)
    ]
    presses = [(name, {"image": "Coat"} if name.endswith(_OF_IMAGES) else {}) for name in operators]
    for operator, words in presses + generated:
        small = {"image_size": "256", "pattern_steps": 50} if operator == "generate" else {}
        seen = report["_".join([operator, *words.values()] if small else [operator])] = []
        for _ in range(2):
            began = time.perf_counter()
            with over("VIEW_3D"):
                result = getattr(bpy.ops.shock_filter, operator)(**words, **small)
            seen.append({"result": sorted(result), "seconds": time.perf_counter() - began})
            yield 0.2


def add_texture(obj: bpy.types.Object) -> None:
    """Unwrap an object and show it an image, for which nothing is computed by the extension."""
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.uv.smart_project(island_margin=0.01)
    bpy.ops.object.mode_set(mode="OBJECT")
    image = scene.add_image("Coat")
    image.scale(64, 64)
    material = bpy.data.materials.new("Coat")
    material.use_nodes = True
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    material.node_tree.nodes.active = node
    obj.data.materials.append(material)
