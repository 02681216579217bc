# SPDX-License-Identifier: GPL-3.0-or-later
"""Textures on the model: their preview, and before and after; and that of images."""

import bpy
import scene
from comparing import BEFORE_AFTER
from harness import (
    DRAWN,
    Steps,
    area,
    buttons,
    click,
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
from seeing import drag, middle, object_seen, running_preview


def scenario() -> Steps:
    """Preview a texture in the 3D view alone; swap what runs have made."""
    scene.clear()
    image = scene.add_texture(scene.add_monkey("Monkey", 3))
    scene.look()
    bpy.context.scene.shock_filter.mode = "TEXTURE"
    yield from open_tab()
    yield from preview(image)
    yield from new_images()


def preview(image: bpy.types.Image) -> Steps:
    """Preview it where the model shows it."""
    view = area("VIEW_3D").spaces.active
    report["preview"] = seen = {}
    with over():
        seen["offered_without_textures"] = bpy.ops.shock_filter.preview.poll()
    view.shading.color_type = "TEXTURE"
    yield from park()
    yield 2 * DRAWN
    seen["start"], looked = texture(image), object_seen()
    run("preview")
    yield from drag(*middle())
    for _ in range(60):  # seconds
        if running_preview().updates > 1:
            break
        yield DRAWN
    yield DRAWN
    seen["shown"], seen["pixels"] = different(looked, object_seen()), texture(image)["pixels"]
    picture("preview-on-the-model", area("VIEW_3D"), width=1400)
    yield from press("b")
    seen["before"] = texture(image)["material"]
    yield from press("b")
    yield from press("Escape")
    yield from park()
    yield DRAWN
    seen["dropped"], seen["left"] = texture(image), different(looked, object_seen())


def new_images() -> Steps:
    """Swap a new texture in the material, and a new image in the Image Editor."""
    seen = report["new_images"] = {}
    node = bpy.data.materials["Coat"].node_tree.nodes.active
    run("sharpen_texture")
    yield from finished()
    seen["texture"] = [node.image.name]
    for _ in range(2):
        run("before_after")
        seen["texture"].append(node.image.name)
    area("VIEW_3D").type = "IMAGE_EDITOR"
    yield DRAWN
    editor = area("IMAGE_EDITOR").spaces.active
    editor.image = scene.add_image("Photo")
    bpy.context.scene.shock_filter.image_mode = "IMAGE"
    yield from open_tab("IMAGE_EDITOR")
    run("sharpen_image", "IMAGE_EDITOR")
    yield from finished()
    seen["image"] = [editor.image.name]
    yield from park("IMAGE_EDITOR")
    places = yield from buttons("IMAGE_EDITOR")
    for _ in range(2):
        yield from click(places[BEFORE_AFTER])
        yield DRAWN
        seen["image"].append(editor.image.name)


def texture(image: bpy.types.Image) -> dict:
    """Return what a preview of a texture must bring back."""
    node = bpy.data.materials["Coat"].node_tree.nodes.active
    state_ = {"pixels": pixels(image), "dirty": image.is_dirty, "users": image.users}
    images = sorted(image.name for image in bpy.data.images if image.users or image.name[0] != ".")
    return {**state_, "material": node.image.name, "images": images}
