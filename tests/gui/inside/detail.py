# SPDX-License-Identifier: GPL-3.0-or-later
"""The gain of a texture's detail: dragged in a preview, and painted on the model by a brush."""

import time

import bpy
import numpy as np
import scene
from harness import (
    DRAWN,
    Steps,
    addon,
    area,
    button,
    different,
    finished,
    move,
    open_tab,
    over,
    park,
    picture,
    pixels,
    press,
    report,
    run,
)
from seeing import middle, object_seen, running_preview

SIDES = (1024, 2048)
STROKES = 3
LIMIT = 120.0
SETTLED = 0.6
"""Seconds in which nothing is computed any more."""


def scenario() -> Steps:
    """Drag the gain; then paint it."""
    scene.clear()
    monkey = scene.add_monkey("Monkey", 2)
    image = scene.add_texture(monkey)
    scene.look()
    show_textures()
    bpy.context.scene.shock_filter.mode = "DETAIL"
    yield from open_tab()
    for side in SIDES:
        image.scale(side, side)
        add_grain(image)
        yield from dragged(image, report.setdefault(str(side), {}))
    image.scale(SIDES[0], SIDES[0])
    yield from painted(image)


def show_textures() -> None:
    """Show the materials' textures with Workbench, which is fast without a graphics card."""
    chosen = bpy.context.scene
    chosen.render.engine = "BLENDER_WORKBENCH"
    chosen.display.shading.color_type = "TEXTURE"
    area("VIEW_3D").spaces.active.shading.type = "RENDERED"


def add_grain(image: bpy.types.Image) -> None:
    """Lay grain over an image."""
    flat = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(flat)
    grain = np.random.default_rng(0).normal(0.0, 0.05, (len(flat) // 4, 1))
    flat.reshape(-1, 4)[:, :3] += grain.astype(np.float32)
    image.pixels.foreach_set(flat)
    image.update()


def dragged(image: bpy.types.Image, seen: dict) -> Steps:
    """Write down how long each step of the mouse takes until the model shows it."""
    start = pixels(image)
    yield from park()
    run("preview")
    yield from updated(0)
    x, y = middle()
    while not addon("running.jobs").previews[0].operator._arrived:  # the mouse has to rest at first
        move(x, y)
        yield DRAWN
    seen["gains"], seen["seconds"] = [], []
    for step in range(1, 7):
        before = running_preview().updates
        began = time.perf_counter()
        move(x + 10 * step, y)
        yield from updated(before)
        seen["seconds"].append(time.perf_counter() - began)
        seen["gains"].append(running_preview().parameters.gain)
        yield 0.3
    yield from press("Escape")
    seen["kept"] = pixels(image) == start
    yield from finished()


def updated(before: int) -> Steps:
    """Wait until the preview shows more results than before."""
    end = time.monotonic() + LIMIT
    while running_preview().updates <= before:
        if time.monotonic() > end:
            raise TimeoutError("The preview shows nothing.")
        yield 0.01


def painted(image: bpy.types.Image) -> Steps:
    """Paint with white, take it back, turn the gain, and have the result written."""
    seen = report["painted"] = {}
    start = pixels(image)
    with over():
        seen["began"] = sorted(bpy.ops.shock_filter.paint_gain("INVOKE_DEFAULT", True))
    yield from settled()
    gain_map = bpy.data.images[bpy.context.scene.shock_filter.detail.gain_map]
    seen["mode"], seen["map"], gray = bpy.context.mode, gain_map.name, pixels(gain_map)
    plain = model_pixels()
    seen["starts_as_it_is"] = pixels(model_image()) == start
    yield from stroke()
    yield from settled()
    seen["map_painted"] = pixels(gain_map) != gray
    once = model_pixels()
    seen["changed"] = int((np.abs(once - plain).max(axis=1) > 0.02).sum())
    picture("paint-gain", area("VIEW_3D"), width=1400)
    bpy.context.scene.shock_filter.detail.gain = 4.0
    yield from settled()
    seen["turned"] = int((np.abs(model_pixels() - once).max(axis=1) > 0.02).sum())
    yield from park()
    yield from press("ctrl+z")
    yield from settled()
    seen["undone"] = pixels(bpy.data.images["Coat gain"]) == gray
    seen["seconds"] = []
    for row in range(STROKES):
        yield from timed_stroke(30 * (row - 1), seen["seconds"])
    seen["is_running"] = addon("preview.painting").is_running()
    run("filter_texture", image="Coat", gain_map="Coat gain")
    yield from finished()
    yield from settled()
    seen["ended"] = not addon("preview.painting").is_running()
    seen["shown"] = model_image().name
    seen["kept"] = pixels(bpy.data.images["Coat"]) == start
    seen["used"] = [each.name for each in stand_ins() if each.users]
    end = time.monotonic() + LIMIT
    while stand_ins() and time.monotonic() < end:
        yield 0.5
    seen["left"] = len(stand_ins())
    yield from in_solid_shading()


def in_solid_shading() -> Steps:
    """Paint where Workbench shows what is painted on, so that the result is drawn over it."""
    seen = report["solid"] = {}
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.scene.shock_filter.detail.image = model_image().name
    shading = area("VIEW_3D").spaces.active.shading
    shading.type, shading.color_type = "SOLID", "TEXTURE"
    with over():
        seen["began"] = sorted(bpy.ops.shock_filter.paint_gain("INVOKE_DEFAULT", True))
    seen["shading"] = [shading.type, shading.color_type]
    yield from settled()
    yield from park()
    plain = object_seen()
    picture("paint-gain-solid", area("VIEW_3D"), width=1400)
    seen["gray"] = float(np.abs(plain.astype(int) - plain.mean(axis=2, keepdims=True)).max())
    yield from stroke(-90)  # where nothing is painted yet
    yield from settled()
    yield from park()
    seen["changed"] = different(plain, object_seen())
    run("paint_gain")
    yield from settled()
    seen["ended"] = not addon("preview.painting").is_running()


def stand_ins() -> list[bpy.types.Image]:
    """List the images that stand for others."""
    return [image for image in bpy.data.images if image.name.startswith(".")]


def timed_stroke(height: float, seconds: list[float]) -> Steps:
    """Write down how long it takes from the end of a stroke until the model shows it."""
    stage = addon("preview.painting")._running[-1].stage
    show, shown = type(stage).show, []

    def noted(pixels: np.ndarray) -> None:
        show(stage, pixels)
        shown.append(time.perf_counter())  # drawing, without a graphics card, takes long

    stage.show = noted
    yield from stroke(height)
    end = time.monotonic() + LIMIT
    while addon("preview.gain").is_brush_down():  # a busy Blender is told late of the end
        yield 0.01
    began = time.perf_counter()
    while not shown:
        if time.monotonic() > end:
            raise TimeoutError("The model does not show the stroke.")
        yield 0.01
    seconds.append(shown[0] - began)
    del stage.show
    yield from settled()


def stroke(height: float = 0.0) -> Steps:
    """Paint a line over the model with a white brush."""
    tools = bpy.context.scene.tool_settings
    if tools.image_paint.brush is None:  # Debian's Blender comes without brushes
        bpy.data.brushes.new("White", mode="TEXTURE_PAINT").asset_mark()
        with over():
            bpy.ops.brush.asset_activate(
                asset_library_type="LOCAL", relative_asset_identifier="Brush/White"
            )
        yield DRAWN
    in_5 = getattr(tools.image_paint, "unified_paint_settings", None)
    for owner in (in_5 or tools.unified_paint_settings, tools.image_paint.brush):
        owner.color = (1.0, 1.0, 1.0)
        owner.size = 60
    x, y = middle()
    y += height
    move(x - 60, y)
    yield 0.3
    button("mousedown")
    yield 0.1
    for step in range(7):
        move(x - 60 + 20 * step, y)
        yield 0.05
    button("mouseup")


def settled() -> Steps:
    """Wait until the model shows what is painted and set."""
    end = time.monotonic() + LIMIT
    quiet = 0.0
    while quiet < SETTLED:
        if time.monotonic() > end:
            raise TimeoutError("The painting does not settle.")
        running = addon("preview.painting")._running
        busy = bool(running) and running[-1].preview.is_computing
        quiet = 0.0 if busy else quiet + 0.1
        yield 0.1


def model_image() -> bpy.types.Image:
    """Return the image that the model's material shows."""
    return bpy.data.materials["Coat"].node_tree.nodes.active.image


def model_pixels() -> np.ndarray:
    """Return its pixels, (texels, 4)."""
    image = model_image()
    flat = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(flat)
    return flat.reshape(-1, 4)
