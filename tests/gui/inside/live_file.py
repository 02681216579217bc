# SPDX-License-Identifier: GPL-3.0-or-later
"""Make a file with live results of all kinds: ``blender -b --python live_file.py -- FILE``.

The extension is enabled.
"""

import sys

import bpy
import numpy as np


def add_box(name: str, place: float) -> bpy.types.Object:
    """Add a box whose edges are rounded, with painted corners; it is the only one selected."""
    bpy.ops.mesh.primitive_cube_add(location=(place, 0, 0))
    box = bpy.context.object
    box.name = name
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.subdivide(number_cuts=7)
    bpy.ops.mesh.vertices_smooth(factor=0.5, repeat=6)
    bpy.ops.object.mode_set(mode="OBJECT")
    paint = box.data.color_attributes.new("Paint", "BYTE_COLOR", "CORNER")
    values = np.random.default_rng(0).random(4 * len(paint.data), np.float32)
    paint.data.foreach_set("color_srgb", values)
    box.data.color_attributes.active_color = paint
    return box


def set_amount(modifier: bpy.types.NodesModifier, value: float, frame: int = 0) -> None:
    """Set the amount of a live result; with a frame also a key."""
    key = inputs(modifier)["Amount"]
    owner, path = modifier, f'["{key}"]'
    if hasattr(modifier, "properties"):  # Blender 5.2
        owner, path = getattr(modifier.properties.inputs, key), "value"
        owner.value = value
    else:
        modifier[key] = value
    if frame:
        owner.keyframe_insert(path, frame=frame)


def set_mask(modifier: bpy.types.NodesModifier, name: str) -> None:
    """Let the mask read a vertex group."""
    key = inputs(modifier)["Mask"]
    if hasattr(modifier, "properties"):
        socket = getattr(modifier.properties.inputs, key)
        socket.type, socket.attribute_name = "ATTRIBUTE", name
    else:
        modifier[f"{key}_use_attribute"] = True
        modifier[f"{key}_attribute_name"] = name


def inputs(modifier: bpy.types.NodesModifier) -> dict[str, str]:
    """Return the keys of the inputs, by their names."""
    items = modifier.node_group.interface.items_tree
    sockets = [each for each in items if each.item_type == "SOCKET" and each.in_out == "INPUT"]
    return {each.name: each.identifier for each in sockets}


def fill() -> None:
    """Add one object for each kind."""
    bpy.ops.wm.read_homefile(use_empty=True)
    masked = add_box("Masked", 0.0)
    bpy.ops.shock_filter.sharpen_geometry(output="LIVE")
    bpy.ops.shock_filter.sharpen_colors(output="LIVE")
    group = masked.vertex_groups.new(name="Where")
    for number in range(len(masked.data.vertices)):
        group.add([number], number % 5 / 4, "REPLACE")
    shape = masked.modifiers["Shock Filter"]
    set_amount(shape, 0.75)
    set_mask(shape, "Where")
    set_amount(masked.modifiers["Shock Filter Colors"], 1.5)

    keyed = add_box("Keyed", 4.0)
    bpy.ops.shock_filter.sharpen_geometry(output="LIVE")
    for frame, value in ((1, 0.0), (11, 1.5)):
        set_amount(keyed.modifiers["Shock Filter"], value, frame)

    bpy.ops.mesh.primitive_cube_add(location=(8, 0, 0))
    remesh = bpy.context.object.modifiers.new("Remesh", "REMESH")
    remesh.mode, remesh.voxel_size = "VOXEL", 0.1
    bpy.ops.shock_filter.sharpen_geometry(output="LIVE")
    bpy.context.object.name = "Copy"


fill()
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[-1])
