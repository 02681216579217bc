# SPDX-License-Identifier: GPL-3.0-or-later
"""A live texture, and its mask that is painted on the model."""

import time

import bpy
import numpy as np
import scene
from detail import stroke
from harness import (
    DRAWN,
    Steps,
    area,
    different,
    finished,
    open_tab,
    over,
    park,
    picture,
    pixels,
    press,
    report,
    run,
)
from seeing import object_seen

LIMIT = 120.0


def scenario() -> Steps:
    """Make a texture live, paint where it is seen, and take both back."""
    scene.clear()
    monkey = scene.add_monkey("Monkey", 2)
    image = scene.add_texture(monkey)
    scene.look()
    bpy.context.scene.shock_filter.mode = "TEXTURE"
    yield from open_tab()
    bpy.ops.ed.undo_push(message="Start")
    run("sharpen_texture", output="LIVE")
    yield from finished()
    yield from paint(image)
    yield from take_back()


def paint(image: bpy.types.Image) -> Steps:
    """Press Paint Where, and paint a stroke."""
    seen = report["painted"] = {}
    start = pixels(image)
    with over():
        seen["began"] = sorted(bpy.ops.shock_filter.paint_live_texture("INVOKE_DEFAULT", True))
    seen["mode"], seen["shading"] = bpy.context.mode, view().type
    seen["canvas"] = bpy.context.tool_settings.image_paint.canvas.name
    seen["black"] = white_share()
    yield from drawn()
    plain = object_seen()
    yield from stroke()
    end = time.monotonic() + LIMIT
    while white_share() == 0.0 and time.monotonic() < end:  # a busy Blender is told late
        yield DRAWN
    yield from drawn()
    seen["white"], seen["changed"] = white_share(), different(plain, object_seen())
    seen["kept"] = pixels(bpy.data.images["Coat"]) == start
    picture("painting-where", area("VIEW_3D"), width=1400)


def take_back() -> Steps:
    """Undo the stroke, then the press; redo both."""
    seen = report["undone"] = []
    for keys in ("ctrl+z", "ctrl+z", "ctrl+shift+z", "ctrl+shift+z"):
        yield from park()
        yield from press(keys)
        yield 2 * DRAWN
        mask = bpy.data.images.get("Coat mask")
        is_there = mask is not None and mask.users > 0
        seen.append([bpy.context.mode, is_there, white_share() if is_there else 0.0])


def drawn() -> Steps:
    """Wait until the view rests; without a graphics card Material Preview takes long."""
    end, before = time.monotonic() + LIMIT, None
    yield from park()
    while time.monotonic() < end:
        yield 2 * DRAWN
        now = object_seen()
        if before is not None and not different(before, now):
            return
        before = now


def view() -> bpy.types.View3DShading:
    return area("VIEW_3D").spaces.active.shading


def white_share() -> float:
    """Return the mean of the mask."""
    image = bpy.data.images["Coat mask"]
    flat = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(flat)
    return float(flat.reshape(-1, 4)[:, :3].mean())
