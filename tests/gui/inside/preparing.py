# SPDX-License-Identifier: GPL-3.0-or-later
"""Kernels are compiled while nobody does anything; then each button is pressed once."""

import sys
import time
from collections import Counter

import bpy
import scene
from harness import MODULE, Steps, addon, area, finished, open_tab, over, picture, report
from preparing_interrupted import begun

LIMIT = 700.0

_OF_IMAGES = ("texture", "textures", "image")


def scenario() -> Steps:
    """Wait until everything is ready, and press each button once."""
    report["began"] = yield from begun()
    began = time.monotonic()
    scene.clear()
    monkey = scene.add_monkey("Monkey", 2)
    add_texture(monkey)
    scene.look()
    yield from open_tab()
    picture("preparing", area("VIEW_3D"))
    fractions = report["fractions"] = []
    while (fraction := addon("running.preparing").fraction()) is not None:
        if time.monotonic() - began > LIMIT:
            raise TimeoutError(f"{fraction:.0%} were compiled.")
        fractions.append(fraction)
        yield 1.0
    report["seconds"] = time.monotonic() - began
    yield from finished()  # until it is loaded
    yield from presses()


def presses() -> Steps:
    """Press the button of each mode, and write down how long it took."""
    area("VIEW_3D").type = "VIEW_3D"
    operators = ["sharpen_geometry", "denoise", "sharpen_colors", "sharpen_texture"]
    operators += ["filter_texture", "stitch_textures", "dilate_texture"]
    operators += ["sharpen_image", "denoise_image", "denoise_texture"]
    generated = [("generate", {"target": each}) for each in ("distance", "streaks", "pattern")]
    presses = [(name, {"image": "Coat"} if name.endswith(_OF_IMAGES) else {}) for name in operators]
    for operator, words in presses + generated:
        small = {"image_size": "256", "pattern_steps": 50} if operator == "generate" else {}
        before = compiled()
        began = time.perf_counter()
        with over("VIEW_3D"):
            result = getattr(bpy.ops.shock_filter, operator)(**words, **small)
        seconds = time.perf_counter() - began
        report["_".join([operator, *words.values()] if small else [operator])] = {
            "result": sorted(result),
            "seconds": seconds,
            "compiled": sorted((compiled() - before).elements()),
        }
        yield 0.2


def compiled() -> Counter[str]:
    """Count, by kernels, what was compiled in this session because it was not on disk."""
    rehearsal = sys.modules.get(f"{MODULE}.core.rehearsal.rehearse")
    kernels = rehearsal.imported_kernels() if rehearsal else ()
    counts = {kernel.__name__: sum(kernel.stats.cache_misses.values()) for kernel in kernels}
    return Counter(counts)


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
