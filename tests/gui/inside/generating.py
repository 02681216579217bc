# SPDX-License-Identifier: GPL-3.0-or-later
"""What Generate makes: pressed by hand, and previewed on the model."""

import time

import bpy
import numpy as np
import scene
from harness import (
    DRAWN,
    Steps,
    addon,
    area,
    buttons,
    click,
    crop,
    different,
    finished,
    move,
    open_own_panel,
    open_tab,
    park,
    picture,
    press,
    region,
    report,
    tallest,
)
from seeing import middle, running_preview

PREVIEW = 1
"""Number of its button in the panel, from the top."""

GENERATE = -3
"""Number of its panel in the tab, from the bottom."""

LIMIT = 60.0


def scenario() -> Steps:
    """Press the button for each target, and preview it."""
    scene.clear()
    monkey = scene.add_monkey("Monkey", 2)
    scene.add_texture(monkey)
    monkey.data.materials.clear()
    scene.look()
    chosen = bpy.context.scene.shock_filter
    chosen.mode = "GENERATE"
    chosen.generate.image_size = "256"
    chosen.generate.pattern_steps = 300
    yield from open_tab()
    yield from open_own_panel(GENERATE)
    for target in ("distance", "streaks", "pattern", "curvature", "occlusion", "thickness", "wear"):
        chosen.generate.target = target
        seen = report[target] = {}
        yield DRAWN
        places = yield from buttons()
        yield from pressed(tallest(places), seen)
        yield from previewed(places[PREVIEW], seen)


def previewed(place: tuple, seen: dict) -> Steps:
    """Drag on the model, and leave."""
    before, names = model_seen(), sorted(bpy.data.images.keys())
    yield from click(place)
    x, y = middle()
    yield from updated(0)
    while not addon("running.jobs").previews[0].operator._arrived:  # the mouse has to rest at first
        move(x, y)
        yield DRAWN
    yield DRAWN
    seen["drawn"] = different(before, model_seen())
    once, updates, began = model_seen(), running_preview().updates, time.perf_counter()
    move(x + 60, y)  # to the left, an automatic width stays
    yield from updated(updates)
    seen["seconds"] = time.perf_counter() - began
    yield DRAWN
    seen["dragged"] = different(once, model_seen())
    picture(f"preview-generate-{seen_target()}", area("VIEW_3D"), width=1400)
    yield from press("Escape")
    yield from finished()
    yield from park()
    yield DRAWN
    seen["left"] = different(before, model_seen())
    seen["made_meanwhile"] = sorted(set(bpy.data.images.keys()) - set(names))


def pressed(place: tuple, seen: dict) -> Steps:
    """Press the main button."""
    before = set(bpy.data.images.keys())
    yield from click(place)
    yield from park()
    yield from finished()
    made = sorted(set(bpy.data.images.keys()) - before)
    seen["made"] = made
    seen["said"] = addon("operators.base").summaries.get("generate", "")
    if made:
        image = bpy.data.images[made[0]]
        flat = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(flat)
        seen["deviation"] = float(flat[::4].std())
    picture(f"generate-{seen_target()}", area("VIEW_3D"), width=1400)
    seen["material"] = [each.name for each in bpy.data.objects["Monkey"].data.materials]


def seen_target() -> str:
    """Name what is generated now."""
    return bpy.context.scene.shock_filter.generate.target


def model_seen() -> np.ndarray:
    """Return the picture of the view."""
    return crop(region("VIEW_3D"))[:, : int(0.6 * region("VIEW_3D").width)]


def updated(before: int) -> Steps:
    """Wait until the preview shows more results than before."""
    end = time.monotonic() + LIMIT
    while running_preview().updates <= before:
        if time.monotonic() > end:
            raise TimeoutError("The preview shows nothing.")
        yield 0.01
