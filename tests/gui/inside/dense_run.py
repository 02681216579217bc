# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh of 1.8 million vertices at the defaults: for how long the window answers nothing."""

import time

import bpy
import numpy as np
import scene
from harness import (
    DRAWN,
    Steps,
    addon,
    area,
    finished,
    open_tab,
    park,
    positions,
    press_key,
    report,
    run,
    running,
)

SIDE = 1342
TICK = 0.01
WAITS = 0.1, 0.5, 2.0, 6.0


def scenario() -> Steps:
    """Run each filter to its end, then cancel it at several moments."""
    scene.clear()
    scene.add_monkey("Monkey", 1)  # loads the kernels
    for name in ("sharpen_geometry", "denoise"):
        run(name)
        yield from finished()
    scene.clear()
    scene.add_bumpy_grid("Grid", SIDE)
    add_roof(bpy.data.objects["Grid"].data)
    scene.look()
    # Out of sight: without a graphics card each frame takes longer than what is measured.
    area("VIEW_3D").spaces.active.region_3d.view_location = (1000, 1000, 0)
    yield from open_tab()
    bpy.ops.ed.undo_push(message="Start")
    yield from park()
    yield DRAWN
    report["vertices"] = len(bpy.data.objects["Grid"].data.vertices)
    report["start"] = positions("Grid")
    for name in ("sharpen_geometry", "denoise"):
        seen = report[name] = {"cancelled": []}
        for wait in WAITS:
            yield from cancelled_run(name, seen["cancelled"], wait)
        yield from whole_run(name, seen)
        seen["done"] = positions("Grid")
        bpy.ops.ed.undo()
        yield DRAWN
        seen["undone"] = positions("Grid")


def add_roof(mesh: bpy.types.Mesh) -> None:
    """Add a roof whose ridge is rounded over some edges, and a little noise."""
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    noise = np.random.default_rng(0).normal(size=len(mesh.vertices))
    points[2::3] += (0.05 * noise - np.hypot(SIDE / 2 * points[0::3], 1.5)) * 2 / SIDE
    mesh.vertices.foreach_set("co", points)
    mesh.update()


def whole_run(name: str, seen: dict) -> Steps:
    """Measure the longest times without an answer, and what was said before each of them."""
    begun = time.perf_counter()
    run(name)
    seen["start_seconds"] = time.perf_counter() - begun
    gaps, job = [], addon("running.jobs").current
    last, message = time.perf_counter(), ""
    while job() is not None:
        message = job().message
        yield TICK
        now = time.perf_counter()
        gaps.append((now - last, message))
        last = now
    seen["seconds"] = time.perf_counter() - begun
    seen["end_seconds"] = gaps.pop()[0]
    seen["gaps"] = sorted(gaps)[-5:]
    yield from finished()


def cancelled_run(name: str, found: list, wait: float) -> Steps:
    """Press Esc after a while; measure how long it takes until the run, and its thread, ended."""
    run(name)
    yield wait
    seen = {"after": wait, "was_running": running()}
    begun = time.perf_counter()
    press_key("Escape")
    while addon("running.jobs").current() is not None:
        yield TICK
    seen["seconds"] = time.perf_counter() - begun
    while running():
        yield TICK
    seen["thread_seconds"] = time.perf_counter() - begun
    yield DRAWN
    seen["positions"] = positions("Grid")
    found.append(seen)
    yield from park()
