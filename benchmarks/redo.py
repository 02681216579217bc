# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure Adjust Last Operation in Blender: undo, then the operator with other settings.

``python benchmarks/redo.py`` needs Blender as a Python package, like the demo. The first run of a
surface is compared with redos that reuse what is known about it, and with redos that do not; all
in one process, kernels compiled before, median of five runs.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
import time
from pathlib import Path

os.environ["BLENDER_USER_RESOURCES"] = tempfile.mkdtemp(prefix="shock_filter_redo_")

import bpy
import numpy as np
import shock_filter
from report import Page, Target, table, targets

CHANGES = {
    "Amount": [{"amount": x} for x in (0.9, 0.8, 0.7, 0.6, 0.5)],
    "Widest Fillet": [{"widest_fillet": x} for x in (1.0, 1.5, 2.0, 2.5, 3.0)],
    "Time": [{"time": x} for x in (200.0, 300.0, 400.0, 500.0, 600.0)],
}
SIZES = {"100 K": 318, "1 M": 1002}


def add_relief(side: int) -> bpy.types.Object:
    """Add a sheet of side x side vertices, in quads, with soft steps across it."""
    line = np.linspace(-1.0, 1.0, side)
    x, y = (part.reshape(-1) for part in np.meshgrid(line, line, indexing="ij"))
    z = 0.1 * np.tanh(6.0 * np.sin(9.0 * x + 2.0 * np.sin(4.0 * y)))
    index = np.arange(side * side, dtype=np.int32).reshape(side, side)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1)
    mesh = bpy.data.meshes.new("Relief")
    mesh.vertices.add(len(x))
    mesh.vertices.foreach_set("co", np.stack([x, y, z], axis=1).astype(np.float32).reshape(-1))
    mesh.loops.add(quads.size)
    mesh.loops.foreach_set("vertex_index", quads.reshape(-1))
    mesh.polygons.add(quads.size // 4)
    mesh.polygons.foreach_set("loop_start", np.arange(0, quads.size, 4, dtype=np.int32))
    mesh.update(calc_edges=True)
    relief = bpy.data.objects.new("Relief", mesh)
    bpy.context.collection.objects.link(relief)
    relief.select_set(True)
    bpy.context.view_layer.objects.active = relief
    return relief


def run(**settings: float) -> float:
    """Sharpen what is selected; return the seconds that the person waits."""
    start = time.perf_counter()
    bpy.ops.shock_filter.sharpen_geometry("EXEC_DEFAULT", True, **settings)
    return time.perf_counter() - start


def redo(**settings: float) -> float:
    """Undo the last run and sharpen with other settings; return the seconds of both."""
    start = time.perf_counter()
    bpy.ops.ed.undo()
    return time.perf_counter() - start + run(**settings)


def measure(side: int, changes: list[dict[str, float]]) -> tuple[int, float, float, float]:
    """Return the number of vertices, and the seconds of first run, quick and full redo."""
    from shock_filter.core.host import welding

    bpy.ops.wm.read_homefile(use_empty=True)
    count = len(add_relief(side).data.vertices)
    bpy.ops.ed.undo_push(message="Relief")
    first = run()
    quick = [redo(**settings) for settings in changes]
    full = []
    for settings in changes:
        welding.forget()
        full.append(redo(**settings))
    return count, first, statistics.median(quick), statistics.median(full)


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--write", type=Path, metavar="PAGE", help="put the table into this page")
    parser.add_argument("--only", default=",".join(SIZES), help="sizes to run: %(default)s")
    arguments = parser.parse_args()
    shock_filter.register()
    try:
        measure(20, CHANGES["Amount"])  # loads or compiles the kernels
        found = [
            (setting, *measure(SIZES[name], changes))
            for name in arguments.only.split(",")
            for setting, changes in CHANGES.items()
        ]
    finally:
        shock_filter.unregister()
    rows = [
        [
            f"{count:,}",
            setting,
            f"{first:.2f}",
            f"{quick:.2f}",
            f"{full:.2f}",
            f"{full / quick:.2f}",
        ]
        for setting, count, first, quick, full in found
    ]
    head = ["vertices", "changed", "first run, s", "redo, s", "redo from scratch, s"]
    head += ["from scratch / redo"]
    text = [table(head, rows, words=0)]
    text += [
        targets([Target(f"seconds for another {setting} at {count:,} vertices", quick, 0.3)])
        for setting, count, _, quick, _ in found
        if count < 150_000
    ]
    Page(arguments.write).write("redo", "\n\n".join(text))


if __name__ == "__main__":
    main()
