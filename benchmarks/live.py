# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure the output Live in Blender: another Amount, against a Set Position node; updates.

``python benchmarks/live.py`` needs Blender as a Python package, like the demo. A change is a new
Amount and the evaluation of the object; median of 30, in processor time, which other programs
hardly change. Also how far the result is from that of the output Mesh, and whether a file shows the
same where the extension is not enabled. Then what an update of a live copy takes, whose source is a
cube with a boolean and a voxel remesh modifier: median of 5.
"""

from __future__ import annotations

import argparse
import hashlib
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from redo import add_relief
from report import Page, Target, table, targets

import bpy  # isort: skip  # redo sets Blender's folders first
import numpy as np
import shock_filter
from shock_filter.shock_addon.live import automatic

SIDES = (200, 400, 1000)
CHANGES = 30
UPDATES = 5
OTHERS = """
import sys, bpy, hashlib, numpy as np
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
mesh = bpy.data.objects["Relief"].evaluated_get(bpy.context.evaluated_depsgraph_get()).data
found = np.empty(3 * len(mesh.vertices), np.float32)
mesh.attributes["position"].data.foreach_get("vector", found)
print("digest", hashlib.sha256(found.tobytes()).hexdigest())
"""
"""What a Blender does that knows nothing of the extension."""


def seen(obj: bpy.types.Object) -> np.ndarray:
    """Return the positions of the evaluated object."""
    from shock_filter.shock_addon.data.mesh.meshes import read_positions

    return read_positions(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data)


def clock(set_amount: Callable[[float], None]) -> float:
    """Return the milliseconds of processor time of a change."""
    taken = []
    for amount in np.linspace(-1.0, 2.0, CHANGES):
        set_amount(float(amount))
        start = time.process_time()
        bpy.context.view_layer.update()
        taken.append(1e3 * (time.process_time() - start))
    return statistics.median(taken)


def plain_group() -> bpy.types.NodeTree:
    """Make a group that adds Amount times the movement, without any checks."""
    from shock_filter.shock_addon.data import MOVE

    tree = bpy.data.node_groups.new("Plain", "GeometryNodeTree")
    for way in ("OUTPUT", "INPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Amount", in_out="INPUT", socket_type="NodeSocketFloat")
    kinds = ("NodeGroupInput", "GeometryNodeInputNamedAttribute", "ShaderNodeVectorMath")
    given, move, scaled = map(tree.nodes.new, kinds)
    moved, end = map(tree.nodes.new, ("GeometryNodeSetPosition", "NodeGroupOutput"))
    move.data_type, move.inputs["Name"].default_value = "FLOAT_VECTOR", MOVE
    scaled.operation = "SCALE"
    vector = next(each for each in move.outputs if each.name == "Attribute" and each.enabled)
    tree.links.new(vector, scaled.inputs[0])
    tree.links.new(given.outputs["Amount"], scaled.inputs["Scale"])
    tree.links.new(given.outputs["Geometry"], moved.inputs["Geometry"])
    tree.links.new(scaled.outputs[0], moved.inputs["Offset"])
    tree.links.new(moved.outputs["Geometry"], end.inputs["Geometry"])
    return tree


def measure(side: int) -> tuple[int, float, float, float, bool]:
    """Return vertices, ms of a change live and plain, the error, and whether a file is the same."""
    from shock_filter.shock_addon.data.chosen import live_modifier
    from shock_filter.shock_addon.data.live import stacks
    from shock_filter.shock_addon.data.mesh.meshes import read_positions, write_positions

    bpy.ops.wm.read_homefile(use_empty=True)
    relief = add_relief(side)
    before = read_positions(relief.data)
    bpy.ops.shock_filter.sharpen_geometry(output="MESH")
    wanted = read_positions(relief.data)
    write_positions(relief.data, before)
    relief.data.update()
    bpy.ops.shock_filter.sharpen_geometry(output="LIVE")
    shown = seen(relief)
    error = float(np.abs(shown - wanted).max())
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "live.blend")
        bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
        run = [sys.executable, "-c", OTHERS, path]
        said = subprocess.run(run, capture_output=True, text=True, check=True).stdout
        is_same = hashlib.sha256(shown.tobytes()).hexdigest() in said
    modifier = live_modifier(relief)
    live = clock(lambda amount: stacks.write_input(modifier, "Amount", amount))
    modifier.node_group = plain_group()
    plain = clock(lambda amount: stacks.write_input(modifier, "Amount", amount))
    return len(before), live, plain, error, is_same


def measure_update() -> tuple[int, dict[str, tuple[float, float]]]:
    """Return vertices of a live copy, and seconds after the operand moves: on the clock, of cores.

    They are those of evaluating the stack, of the update, and of evaluating the copy.
    """
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.mesh.primitive_cube_add(size=0.8, location=(0.8, -0.8, 0.8))
    operand = bpy.context.object
    bpy.ops.mesh.primitive_cube_add(size=1.6)
    part = bpy.context.object
    cut = part.modifiers.new("Cut", "BOOLEAN")
    cut.operation, cut.object = "DIFFERENCE", operand
    voxel = part.modifiers.new("Remesh", "REMESH")
    voxel.mode, voxel.voxel_size = "VOXEL", 0.0175
    bpy.ops.shock_filter.sharpen_geometry(output="LIVE")
    copy = bpy.context.object
    steps: dict[str, Callable[[], object]] = {
        "evaluating the stack": bpy.context.view_layer.update,
        "the update": lambda: shock_filter.live.update(copy),
        "evaluating the copy": lambda: seen(copy),
    }
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in steps}
    for _ in range(UPDATES + 1):
        operand.location.x -= 0.05
        for name, step in steps.items():
            begun = time.perf_counter(), time.process_time()
            step()
            ended = time.perf_counter(), time.process_time()
            found[name].append((ended[0] - begun[0], ended[1] - begun[1]))
    middle = {
        name: tuple(statistics.median(each) for each in zip(*taken[1:], strict=True))
        for name, taken in found.items()
    }
    return len(copy.data.vertices), middle


def update_table() -> str:
    """Write what an update takes."""
    vertices, found = measure_update()
    found["at most until it is noticed"] = (automatic.LOOK_ASLEEP, 0.0)
    clock_sum = sum(clock for clock, _ in found.values())
    rows = [[name, f"{clock:.2f}", f"{cores:.2f}"] for name, (clock, cores) in found.items()]
    head = [f"{vertices:,} vertices", "seconds", "core seconds"]
    bound = Target("s until the new part is there", clock_sum, 1.0)
    return "\n\n".join([table(head, rows, words=1), targets([bound])])


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--write", type=Path, metavar="PAGE", help="put the table into this page")
    arguments = parser.parse_args()
    shock_filter.register()
    try:
        measure(20)  # loads or compiles the kernels
        found = [measure(side) for side in SIDES]
        update = update_table()
    finally:
        shock_filter.unregister()
    rows = [
        [f"{n:,}", f"{live:.1f}", f"{plain:.1f}", f"{error:.1g}", "yes" if same else "**no**"]
        for n, live, plain, error, same in found
    ]
    head = ["vertices", "another Amount, ms", "Set Position alone, ms", "from the output Mesh"]
    head += ["the same without the extension"]
    text = [table(head, rows, words=0)]
    text += [
        targets([Target(f"ms more than Set Position at {n:,} vertices", live - plain, 20.0)])
        for n, live, plain, _, _ in found
        if n == 160_000
    ]
    Page(arguments.write).write("live", "\n\n".join(text))
    Page(arguments.write).write("live updates", update)


if __name__ == "__main__":
    main()
