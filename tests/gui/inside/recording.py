# SPDX-License-Identifier: GPL-3.0-or-later
"""A part out of a voxel remesh is previewed, compared with what it was, and sharpened: a loop."""

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
    crop,
    different,
    finished,
    move,
    open_tab,
    positions,
    press_key,
    region,
    report,
)

LOOP = PICTURES / "loop"
PREVIEW = 1
"""The button's number in the tab, from the top."""


def scenario() -> Steps:
    """Record how Preview is used."""
    LOOP.mkdir()
    scene.clear()
    scene.add_remeshed_part("Part")
    scene.look()
    area("VIEW_3D").spaces.active.shading.show_cavity = True
    bpy.context.scene.shock_filter.mode = "GEOMETRY"
    yield from open_tab()
    places = yield from buttons()
    before = positions("Part")
    yield from record(5)
    yield from click(places[PREVIEW])
    yield from to_the_part(places[PREVIEW])
    yield from shown(before)
    yield from record(6)
    for _ in range(2):
        press_key("b")
        yield 1.0
        yield from record(6)
    press_key("Return")
    yield 1.0
    yield from finished()
    yield from record(6)
    report["changed"] = positions("Part") != before
    frames = [np.load(path) for path in sorted(LOOP.glob("*.npy"))]
    report["frames"] = len(frames)
    report["differ"] = max(different(frames[0], frame) for frame in frames)


def to_the_part(start: tuple[int, int, int, int]) -> Steps:
    """Move the mouse from the button into the view, wait until it counts, and turn the dial."""
    place = region("VIEW_3D")
    x, y = place.x + place.width * 0.3, place.y + place.height * 0.55
    for way in (0.2, 0.4, 0.6, 0.8, 1.0):
        move(start[0] + way * (x - start[0]), start[1] + way * (y - start[1]))
        yield 0.05
    for _ in range(60):
        yield DRAWN
        if addon("running.jobs").previews[0].operator._arrived:
            break
        move(x, y)
    for step in range(8):
        move(x + 5 * step, y)
        yield 0.2


def shown(before: object) -> Steps:
    """Wait for the first result."""
    for _ in range(120):
        if positions("Part") != before:
            break
        yield 0.5
    yield 1.0


def record(count: int) -> Steps:
    """Keep so many pictures of the 3D view."""
    for _ in range(count):
        number = len(list(LOOP.glob("*.npy")))
        np.save(LOOP / f"{number:03}.npy", crop(area("VIEW_3D"))[::-1])
        yield 0.2
