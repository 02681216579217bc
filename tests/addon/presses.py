# SPDX-License-Identifier: GPL-3.0-or-later
"""A script: rehearses, runs all that the tab offers, and prints which kernels had new types then.

The library in the extension's zip would lack such kernels. With that library nothing is rehearsed:
what it lacks raises an error, or is compiled by numba and printed.
"""

import json
from tempfile import TemporaryDirectory

import bpy
import numpy as np
import shock_filter
from shock_filter.core.base.compiled import library
from shock_filter.core.rehearsal.rehearse import imported_kernels, rehearse
from shock_filter.shock_addon.modes import MODES

SIDE = 32
FOLDER = TemporaryDirectory()


def main() -> None:
    """Run and print."""
    shock_filter.register()
    bpy.ops.wm.read_homefile(use_empty=True)
    if library() is None:
        rehearse()
    before = types()
    for domain, kind in (("POINT", "FLOAT_COLOR"), ("CORNER", "BYTE_COLOR")):
        add_box(domain, kind)
        for mode in MODES:
            press(mode)
        bpy.ops.shock_filter.show_flow(mode="geometry")
        bpy.ops.shock_filter.show_flow(mode="colors")
        bpy.ops.shock_filter.mark_creases()
        bpy.ops.shock_filter.show_creases()
        bpy.ops.shock_filter.crisp_low_poly()
        bpy.ops.shock_filter.bake_maps(image_size="256", rays=4)
    print(json.dumps(sorted(types() - before)))
    shock_filter.unregister()


def types() -> set[str]:
    """Return the names of all kernels with the types that numba compiled them for."""
    kernels = [vars(each).get("dispatcher", each) for each in imported_kernels()]
    return {
        f"{kernel.py_func.__module__}.{kernel.py_func.__name__}{signature}"
        for kernel in kernels
        for signature in getattr(kernel, "overloads", ())
    }


def press(mode) -> None:
    """Run a mode with each of its presets, and with a mask."""
    operator = getattr(bpy.ops.shock_filter, mode.operator)
    image = {"image": "Image"} if mode.data.in_images else {}
    changes = [preset.values for preset in mode.presets]
    if "what" in mode.names:
        changes += [{"what": word, "width": 4.0} for word in ("drawing", "photo")]
    if len(mode.targets) > 1:
        changes += [{"target": target.key} for target in mode.targets]
    if "image_2" in mode.names:
        changes += [{"image_2": "Other"}]
    if "vertex_group" in mode.names:
        changes += [{**change, "vertex_group": "Some"} for change in ({}, *changes)]
    if "frames" in mode.names:
        small = {"frames": 24, "image_size": "256", "folder": FOLDER.name, "field": "Paint"}
        changes = [{**each, **small, "in_colors": y} for each in changes for y in (False, True)]
    elif "image_size" in mode.names:
        small = {"source": "seams", "image_size": "256", "pattern_steps": 4}
        changes = [{**change, **small} for change in (*changes, {"into": "ATTRIBUTE"})]
        ways = ("BENDING", "X", "ATTRIBUTE")
        words = {"target": "streaks", "along_attribute": "Paint", **small}
        changes += [{**words, "along": way} for way in ways]
    else:
        changes = [{}, *changes]
    for change in changes:
        assert operator(**image, **change) == {"FINISHED"}, (mode.key, change)


def add_box(domain: str, kind: str) -> None:
    """Add a rounded box with colors, a vertex group, UVs and a texture."""
    bpy.ops.mesh.primitive_cube_add()
    box = bpy.context.object
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.subdivide(number_cuts=11)
    bpy.ops.mesh.vertices_smooth(factor=0.5, repeat=6)
    bpy.ops.object.mode_set(mode="OBJECT")
    mesh = box.data
    group = box.vertex_groups.new(name="Some")
    group.add([v.index for v in mesh.vertices if v.co.z > 0], 0.7, "REPLACE")
    paint = mesh.color_attributes.new("Paint", kind, domain)
    values = np.random.default_rng(0).random(4 * len(paint.data), np.float32)
    paint.data.foreach_set("color", values)
    mesh.color_attributes.active_color = paint
    for name in ("Other", "Image"):
        image = bpy.data.images.new(name, SIDE, SIDE)
        image.name = name
        image.pixels.foreach_set(np.random.default_rng(0).random(4 * SIDE**2, np.float32))
    material = bpy.data.materials.new("Image")
    material.use_nodes = True
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    mesh.materials.append(material)


if __name__ == "__main__":
    main()
