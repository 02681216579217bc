# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh of a million vertices: the window stays alive, and Esc and Cancel end the run."""

import time

import bpy
import scene
from harness import (
    DRAWN,
    Steps,
    addon,
    area,
    button,
    buttons,
    finished,
    move,
    open_tab,
    park,
    picture,
    positions,
    press,
    press_key,
    report,
    run,
    running,
)

TICK = 0.02


def scenario() -> Steps:
    """Run to the end once, then cancel at several moments, by key and by mouse."""
    scene.clear()
    scene.add_monkey("Monkey", 1)  # loads the kernels
    run("sharpen_geometry")
    yield from finished()
    scene.clear()
    scene.add_bumpy_grid("Grid", 1000)
    scene.look()
    # Out of sight: without a graphics card each frame takes longer than what is measured.
    area("VIEW_3D").spaces.active.region_3d.view_location = (1000, 1000, 0)
    yield from open_tab()
    bpy.context.scene.shock_filter.mode = "GEOMETRY"
    bpy.ops.ed.undo_push(message="Start")
    yield from park()
    yield DRAWN
    report["vertices"] = len(bpy.data.objects["Grid"].data.vertices)
    report["start"] = positions("Grid")
    yield from whole_run()
    report["cancelled"] = []
    for wait in (0.3, 1.0, 3.0):
        yield from cancelled_run(wait, "Esc")
    yield from cancelled_run(2.0, "button")


def whole_run() -> Steps:
    """Measure how long the window is deaf while a run is under way."""
    begun = time.perf_counter()
    report["started"] = run("sharpen_geometry", where="everywhere", time=64.0)
    report["start_seconds"] = time.perf_counter() - begun
    gaps = []
    yield TICK
    last = time.perf_counter()
    while addon("running.jobs").current() is not None:
        yield TICK
        now = time.perf_counter()
        gaps.append(now - last)
        last = now
    report["seconds"] = time.perf_counter() - begun
    report["ticks"] = len(gaps)
    report["gaps"] = sorted(gaps[:-1])[-5:]  # in the last one the result is written
    report["end_seconds"] = gaps[-1]
    yield from finished()
    report["done"] = positions("Grid")
    yield from press("ctrl+z")
    yield DRAWN
    report["undone"] = positions("Grid")


def cancelled_run(wait: float, how: str) -> Steps:
    """Cancel after a while; measure how long it takes until the run, and its thread, ended."""
    run("sharpen_geometry", where="everywhere", time=4096.0, repeat=30)
    yield wait
    seen = {"how": how, "after": wait, "was_running": running()}
    if how == "button":
        places = yield from buttons()
        picture("running", area("VIEW_3D"))
        left, bottom, right, top = places[-1]
        move((left + right) / 2, (bottom + top) / 2)
        yield 0.3
        begun = time.perf_counter()
        button("click")
    else:
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
    report["cancelled"].append(seen)
    yield from park()
