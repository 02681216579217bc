# SPDX-License-Identifier: GPL-3.0-or-later
"""Flows that move on the model and in the Image Editor: pressed by hand, stopped, and undone."""

import tempfile
from pathlib import Path

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
    open_own_panel,
    open_tab,
    over,
    park,
    picture,
    press,
    region,
    report,
    running,
    tallest,
)

COUNT = 8
AGAIN = 4


def scenario() -> Steps:
    """Show where a model's creases pull, stop a run, undo one; then a flow map."""
    scene.clear()
    monkey = scene.add_monkey("Monkey", 2)
    scene.add_texture(monkey)
    monkey.data.materials.clear()
    scene.look()
    area("VIEW_3D").spaces.active.shading.color_type = "TEXTURE"
    chosen = bpy.context.scene.shock_filter
    chosen.mode = "VISUALIZE"
    chosen.visualize.image_size, chosen.visualize.frames = "512", COUNT
    with tempfile.TemporaryDirectory() as folder, over():
        bpy.ops.ed.undo_push(message="Start")
        yield from on_the_model(Path(folder))
        yield from stopped(Path(folder))
        yield from in_the_image_editor(Path(folder))


def on_the_model(folder: Path) -> Steps:
    """Press the main button, play, and undo."""
    seen = report["model"] = {}
    settings = bpy.context.scene.shock_filter.visualize
    settings.target, settings.folder = "shape", str(folder / "shape")
    yield from open_tab()
    yield from open_own_panel(-1)
    places = yield from buttons()
    yield from click(tallest(places))
    yield from park()
    yield from finished()
    seen["said"] = addon("operators.base").summaries.get("visualize", "")
    seen["files"] = sorted(path.name for path in (folder / "shape").iterdir())
    seen["images"] = {image.name: image.source for image in bpy.data.images}
    seen["moved"] = yield from played(seen_on("VIEW_3D"))
    picture("flow-film", area("VIEW_3D"), width=1400)
    yield from press("ctrl+z")
    yield DRAWN
    seen["undone"] = sorted(image.name for image in bpy.data.images)
    seen["kept"] = len(list((folder / "shape").iterdir()))


def stopped(folder: Path) -> Steps:
    """Press Esc while frames are drawn."""
    seen = report["stopped"] = {}
    settings = bpy.context.scene.shock_filter.visualize
    settings.target, settings.folder = "shape", str(folder / "long")
    settings.frames = 5000
    before = sorted(image.name for image in bpy.data.images)
    places = yield from buttons()
    yield from click(tallest(places))
    yield from park()
    while not any("frame_" in path.name for path in folder.rglob("*.png")):
        yield DRAWN
    seen["running"] = running()
    yield from press("Escape")
    yield from finished()
    seen["left"] = sorted(path.name for path in folder.iterdir() if path.name != "shape")
    seen["same"] = before == sorted(image.name for image in bpy.data.images)
    settings.frames = COUNT


def in_the_image_editor(folder: Path) -> Steps:
    """Show a flow map by hand."""
    seen = report["map"] = {}
    side = 128
    y, x = np.mgrid[-1 : 1 : side * 1j, -1 : 1 : side * 1j]
    values = np.stack([0.5 - 0.5 * y, 0.5 + 0.5 * x, 0 * x, 1 + 0 * x], axis=-1)
    image = bpy.data.images.new("River", side, side, is_data=True)
    image.pixels.foreach_set(values.astype(np.float32).ravel())
    image.update()
    area("VIEW_3D").type = "IMAGE_EDITOR"
    yield DRAWN
    space = area("IMAGE_EDITOR").spaces.active
    space.image = image
    chosen = bpy.context.scene.shock_filter
    chosen.image_mode = "VISUALIZE"
    chosen.visualize.folder = str(folder / "map")
    yield from open_tab("IMAGE_EDITOR")
    yield from open_own_panel(-1, "IMAGE_EDITOR")
    places = yield from buttons("IMAGE_EDITOR")
    yield from click(tallest(places))
    yield from park("IMAGE_EDITOR")
    yield from finished()
    seen["said"] = addon("operators.base").summaries.get("visualize", "")
    seen["shown"] = [space.image.name, space.image.source]
    seen["moved"] = yield from played(seen_on("IMAGE_EDITOR"))
    # Once more with other settings, while the editor shows the sequence.
    chosen.visualize.frames = AGAIN
    places = yield from buttons("IMAGE_EDITOR")
    yield from click(tallest(places))
    yield from park("IMAGE_EDITOR")
    yield from finished()
    seen["said_again"] = addon("operators.base").summaries.get("visualize", "")


def played(place: object) -> Steps:
    """Go from frame to frame; the generator returns how many pixels changed each time."""
    changed, before = [], None
    for frame in (1, 4, 7):
        bpy.context.scene.frame_set(frame)
        yield DRAWN
        yield DRAWN
        now = crop(place).copy()
        if before is not None:
            changed.append(different(before, now))
        before = now
    return changed


def seen_on(kind: str) -> object:
    """Return the place of a view."""
    return region(kind)
