# SPDX-License-Identifier: GPL-3.0-or-later
"""What Image Editors show after runs, after F9, undo and redo, and what is saved."""

from __future__ import annotations

import bpy
import scene
from harness import (
    DRAWN,
    PICTURES,
    Steps,
    area,
    click,
    drag,
    finished,
    mark,
    marked,
    move,
    over,
    park,
    press,
    report,
    run,
    whole_window,
)

OTHER = "Other"
"""An image that the second editor shows in the end."""


def scenario() -> Steps:
    """Go through all operators on images, each from the same state of the file."""
    scene.clear()
    scene.add_texture(scene.add_monkey("Monkey", 1))
    for name in ("Photo", OTHER):
        scene.add_image(name).scale(48, 48)  # each step of a drag runs once more
    for image in bpy.data.images:
        image.use_fake_user = True
    area("VIEW_3D").type = "IMAGE_EDITOR"
    area("OUTLINER").type = "IMAGE_EDITOR"
    yield DRAWN
    bpy.ops.ed.undo_push(message="Start")
    for operator, name in (
        ("sharpen_image", "Photo"),
        ("denoise_image", "Photo"),
        ("sharpen_texture", "Coat"),
        ("dilate_texture", "Coat"),
    ):
        yield from history(operator, name)
    yield from twice()
    yield from saved()


def history(operator: str, name: str) -> Steps:
    """Run, change a setting as F9 does, undo, and redo."""
    seen = report[operator] = {}
    show(name, name)
    yield from park("IMAGE_EDITOR")
    run(operator, "IMAGE_EDITOR")
    yield from finished()
    seen["run"] = shown()
    yield from adjust()
    seen["adjusted"] = shown()
    show(seen["run"][0], seen["run"][0])
    yield from adjust()
    seen["both adjusted"] = shown()
    yield from press("ctrl+z")
    seen["both undone"] = shown()
    yield from press("ctrl+shift+z")
    seen["both redone"] = shown()
    show(seen["run"][0], OTHER)
    yield from press("ctrl+z")
    seen["undone"] = shown()
    yield from press("ctrl+shift+z")
    seen["redone"] = shown()
    yield from press("ctrl+z")
    show(OTHER, OTHER)
    yield from press("ctrl+shift+z")
    seen["left alone"] = shown()
    yield from press("ctrl+z")


def twice() -> Steps:
    """Run on the result of a run, and go back and forth through both."""
    seen = report["twice"] = {}
    show("Photo", "Photo")
    yield from park("IMAGE_EDITOR")
    for operator in ("sharpen_image", "denoise_image"):
        run(operator, "IMAGE_EDITOR")
        yield from finished()
    seen["run"] = shown()
    for step, key in (
        ("undone", "ctrl+z"),
        ("undone twice", "ctrl+z"),
        ("redone", "ctrl+shift+z"),
        ("redone twice", "ctrl+shift+z"),
    ):
        yield from press(key)
        seen[step] = shown()


def saved() -> Steps:
    """Run on images that nothing else keeps, save the file, and open it again, twice."""
    for image in bpy.data.images:
        image.use_fake_user = False
    seen = report["saved"] = {"made": []}
    for operator, name in (("sharpen_texture", "Coat"), ("sharpen_image", "Photo")):
        show(name, "Photo")
        run(operator, "IMAGE_EDITOR")
        yield from finished()
        seen["made"] += [name, shown()[0]]
    path = str(PICTURES / "kept.blend")
    for _ in range(2):
        bpy.ops.wm.save_as_mainfile(filepath=path)
        bpy.ops.wm.open_mainfile(filepath=path, load_ui=False)
        yield DRAWN
    seen["there"] = bpy.data.images.keys()


def adjust() -> Steps:
    """Drag the first number in what F9 opens, and close it."""
    yield from mark("num", True)
    yield from park("IMAGE_EDITOR")
    before = marked(whole_window())
    with over("IMAGE_EDITOR"):
        bpy.ops.screen.redo_last("INVOKE_DEFAULT")
    yield 2 * DRAWN
    new = [place for place in marked(whole_window()) if place not in before]
    yield from drag(new[0], 30)
    # Leaving it closes it up to 4.3, a click outside in 5.2; the top bar is empty there.
    move(100, 300)
    yield DRAWN
    window = whole_window()
    x, y = 0.747 * window.width, window.height - 12
    yield from click((x, y, x, y))
    yield from mark("num", False)
    yield from park("IMAGE_EDITOR")


def editors() -> list[bpy.types.Area]:
    """List the Image Editors."""
    areas = bpy.context.window_manager.windows[0].screen.areas
    return [each for each in areas if each.type == "IMAGE_EDITOR"]


def show(*names: str) -> None:
    """Show an image in each editor."""
    for each, name in zip(editors(), names, strict=True):
        each.spaces.active.image = bpy.data.images[name]


def shown() -> list[str | None]:
    """Name the image of each editor."""
    images = [each.spaces.active.image for each in editors()]
    return [None if image is None else image.name for image in images]
