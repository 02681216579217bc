# SPDX-License-Identifier: GPL-3.0-or-later
"""Each mode: by its operator, by a click on its button, undo and redo by keys."""

import bpy
import scene
from harness import (
    DRAWN,
    Steps,
    addon,
    area,
    buttons,
    click,
    colors,
    finished,
    last_operator,
    open_own_panel,
    open_tab,
    over,
    park,
    picture,
    pixels,
    positions,
    press,
    report,
    run,
    tallest,
)

MESH_MODES = {
    "denoise": "denoise",
    "geometry": "sharpen_geometry",
    "colors": "sharpen_colors",
}
GENERATE = -3
"""Number of its panel in the tab, from the bottom."""

IMAGE_MODES = {
    "denoise_image": "denoise_image",
    "image": "sharpen_image",
    "texture": "sharpen_texture",
}


def scenario() -> Steps:
    """Go through the 3D view's modes, then through those of the Image Editor."""
    scene.clear()
    scene.add_texture(scene.add_monkey("Monkey", 3))
    shading = area("VIEW_3D").spaces.active.shading
    shading.color_type = "VERTEX"
    scene.look()
    bpy.context.scene.shock_filter.geometry.where = "everywhere"  # a monkey has no creases
    yield from open_tab()
    for mode, operator in MESH_MODES.items():
        report[mode] = {}
        yield from mesh_mode(mode, operator, report[mode])
    shading.color_type = "TEXTURE"
    report["texture"] = {}
    yield from image_mode("VIEW_3D", "texture", "sharpen_texture", report["texture"])
    yield from generated()
    area("VIEW_3D").type = "IMAGE_EDITOR"
    yield DRAWN
    scene.add_image("Photo")
    yield from open_tab("IMAGE_EDITOR")
    with over("IMAGE_EDITOR"):
        bpy.ops.image.view_zoom_ratio(ratio=1.5)
    for mode, operator in IMAGE_MODES.items():
        seen = report[f"image-editor-{mode}"] = {}
        shown = bpy.data.images["Coat" if mode == "texture" else "Photo"]
        area("IMAGE_EDITOR").spaces.active.image = shown
        yield from image_mode("IMAGE_EDITOR", mode, operator, seen)


def mesh_mode(mode: str, operator: str, seen: dict) -> Steps:
    """Run one mode of the 3D view that changes the mesh."""
    bpy.context.scene.shock_filter.mode = mode.upper()
    bpy.ops.ed.undo_push(message="Start")
    places = yield from buttons()
    seen["buttons"] = len(places)
    seen["start"] = state()
    words = {"where": "everywhere"} if mode == "geometry" else {}
    seen["started"] = run(operator, **words)
    yield from finished()
    seen["by_operator"] = state()
    seen["summary"] = addon("operators.base").summaries.get(mode)
    seen["last"] = last_operator()
    yield from park()
    picture(mode, area("VIEW_3D"))
    yield from press("ctrl+z")
    seen["undone"] = state()
    yield from press("ctrl+shift+z")
    seen["redone"] = state()
    yield from press("ctrl+z")
    yield from click(tallest(places))
    yield from park()
    yield from finished()
    seen["by_click"] = state()
    yield from press("ctrl+z")
    seen["undone_again"] = state()


def image_mode(kind: str, mode: str, operator: str, seen: dict) -> Steps:
    """Run one mode that makes a new image."""
    settings = bpy.context.scene.shock_filter
    if kind == "VIEW_3D":
        settings.mode = mode.upper()
    else:
        settings.image_mode = mode.upper()
    places = yield from buttons(kind)
    seen["buttons"] = len(places)
    before = set(bpy.data.images.keys())
    shown = area(kind).spaces.active.image.name if kind == "IMAGE_EDITOR" else ""
    seen["source"] = pixels(bpy.data.images[shown or "Coat"])
    seen["start"] = {name: pixels(bpy.data.images[name]) for name in before}
    seen["started"] = run(operator, kind)
    yield from finished()
    seen["summary"] = addon("operators.base").summaries.get(mode)
    seen["by_operator"] = new_images(before)
    yield from park(kind)
    picture(mode if kind == "VIEW_3D" else f"image-editor-{mode}", area(kind))
    show_again(kind, shown)
    remove_images(before)
    yield DRAWN
    before_click = set(bpy.data.images.keys())
    yield from click(tallest(places))
    yield from park(kind)
    yield from finished()
    seen["by_click"] = new_images(before_click)
    seen["originals"] = {name: pixels(bpy.data.images[name]) for name in before}
    show_again(kind, shown)
    remove_images(before)


def generated() -> Steps:
    """Let a pattern grow by the panel's button, and take a picture of it."""
    chosen = bpy.context.scene.shock_filter
    chosen.generate.target = "pattern"
    chosen.generate.image_size = "512"
    yield from open_own_panel(GENERATE)
    places = yield from buttons()
    tree = bpy.data.materials["Coat"].node_tree
    before, node, nodes = set(bpy.data.images.keys()), tree.nodes.active, set(tree.nodes)
    yield from click(tallest(places))
    yield from park()
    yield from finished()
    report["generated"] = new_images(before)
    yield 2 * DRAWN  # the panel grows
    picture("generate", area("VIEW_3D"))
    for added in set(tree.nodes) - nodes:
        tree.nodes.remove(added)
    tree.nodes.active = node


def state() -> dict[str, str]:
    """Return what the modes of the 3D view may change."""
    return {"positions": positions("Monkey"), "colors": colors("Monkey")}


def show_again(kind: str, shown: str) -> None:
    """Put the original images back to where the new ones are now."""
    bpy.data.materials["Coat"].node_tree.nodes.active.image = bpy.data.images["Coat"]
    if shown:
        area(kind).spaces.active.image = bpy.data.images[shown]


def remove_images(before: set[str]) -> None:
    """Remove the images that came since: they would stand for the next equal result."""
    for name in set(bpy.data.images.keys()) - before:
        bpy.data.images.remove(bpy.data.images[name])


def new_images(before: set[str]) -> list[str]:
    """Return the fingerprints of the images that came since."""
    new = [image for image in bpy.data.images if image.name not in before]
    return sorted(pixels(image) for image in new if image.type != "RENDER_RESULT")
