# SPDX-License-Identifier: GPL-3.0-or-later
"""Preview of images and textures in the Image Editor, which draws over the image."""

import addon_utils
import bpy
import numpy as np
import scene
from harness import (
    DRAWN,
    MODULE,
    Steps,
    addon,
    area,
    buttons,
    click,
    crop,
    different,
    finished,
    last_operator,
    move,
    open_tab,
    over,
    park,
    picture,
    pixels,
    press,
    region,
    report,
    run,
    save,
    screen,
)

PREVIEW = 1
"""Number of the button in the tab, from the top."""

OCTAVE = 50


def scenario() -> Steps:
    """Compare kinds of images; preview each mode, drop it, and apply it; end it in other ways."""
    scene.clear()
    scene.add_texture(scene.add_monkey("Monkey", 2))
    area("VIEW_3D").type = "IMAGE_EDITOR"
    yield DRAWN
    scene.add_image("Photo")
    yield from open_tab("IMAGE_EDITOR")
    zoom_in()
    yield from kinds()  # these first: after an undo, Blender 4.3 may draw new images as old ones
    yield from patch()
    zoom_in()
    bpy.ops.ed.undo_push(message="Start")
    for mode, name in (("image", "Photo"), ("denoise_image", "Photo"), ("texture", "Coat")):
        area("IMAGE_EDITOR").spaces.active.image = bpy.data.images[name]
        bpy.context.scene.shock_filter.image_mode = mode.upper()
        report[mode] = {}
        yield from preview(mode, name, report[mode])
    yield from endings()


def zoom_in() -> None:
    """Show each pixel of an image as four."""
    with over("IMAGE_EDITOR"):
        bpy.ops.image.view_zoom_ratio(ratio=2.0)


def preview(mode: str, name: str, seen: dict) -> Steps:
    """Drag and press Esc; then drag and press Enter, and undo."""
    settings = getattr(bpy.context.scene.shock_filter, mode)
    settings.time = 64.0 if mode != "denoise_image" else 1.0
    places = yield from buttons("IMAGE_EDITOR")
    yield from park("IMAGE_EDITOR")
    seen["start"], before = state(name), image_seen()
    yield from click(places[PREVIEW])
    move(*middle())
    yield 2 * DRAWN  # only when it has rested there, the mouse counts
    yield from drag(*middle(), 4 * OCTAVE if mode != "denoise_image" else OCTAVE)
    yield from drawn(before)
    seen["shown"] = different(before, image_seen())
    seen["dragged"] = state(name)
    picture(f"preview-{mode}", area("IMAGE_EDITOR"), width=1400)
    yield from press("Escape")
    yield from park("IMAGE_EDITOR")
    seen["left"] = different(before, image_seen())
    seen["dropped"] = state(name)
    seen["started"] = run("preview", "IMAGE_EDITOR")
    yield from drag(*middle(), 2 * OCTAVE)
    yield from press("Return")
    yield from finished()
    seen["last"] = last_operator()
    result = area("IMAGE_EDITOR").spaces.active.image
    seen["result"] = result.name
    seen["applied"] = state(name)
    seen["changed"] = pixels(result) != pixels(bpy.data.images[name])
    seen["time"] = settings.time
    yield from park("IMAGE_EDITOR")
    yield from press("ctrl+z")
    seen["undone"] = [image.name for image in bpy.data.images if image.name == seen["result"]]


def kinds() -> Steps:
    """Compare an image of each kind with what is drawn over it at time 0: the same."""
    report["kinds"] = {}
    bpy.context.scene.shock_filter.image_mode = "IMAGE"
    for kind in ("bytes", "data", "floats", "clear_bytes", "clear_floats"):
        image = add_image(kind)
        area("IMAGE_EDITOR").spaces.active.image = image
        for channels in ("COLOR_ALPHA", "GREEN"):
            area("IMAGE_EDITOR").spaces.active.display_channels = channels
            yield from park("IMAGE_EDITOR")
            yield DRAWN
            before = inside_seen()
            bpy.context.scene.shock_filter.image.time = 0.0
            run("preview", "IMAGE_EDITOR")
            yield 2 * DRAWN
            report["kinds"][f"{kind} {channels}"] = different_but_for_rounding(before)
            yield from press("Escape")
        area("IMAGE_EDITOR").spaces.active.display_channels = "COLOR_ALPHA"


def patch() -> Steps:
    """Preview a patch of a large image."""
    image = add_image("bytes", 1500)
    area("IMAGE_EDITOR").spaces.active.image = image
    with over("IMAGE_EDITOR"):
        bpy.ops.image.view_all(fit_view=True)
    yield from park("IMAGE_EDITOR")
    yield 2 * DRAWN
    before = image_seen()
    bpy.context.scene.shock_filter.image.time = 1024.0
    run("preview", "IMAGE_EDITOR")
    yield from drawn(before)
    picture("preview-patch", area("IMAGE_EDITOR"), width=1400)
    changed = np.abs(image_seen().astype(int) - before).max(axis=2) > 24
    rows, columns = np.nonzero(changed)
    report["patch"] = {
        "changed": int(changed.sum()),
        "width": int(np.ptp(columns)),
        "height": int(np.ptp(rows)),
        "zoom": area("IMAGE_EDITOR").spaces.active.zoom[0],
    }
    yield from press("Escape")


def endings() -> Steps:
    """End a preview from outside, and see whether its words are gone from the window."""
    report["endings"] = {}
    yield 12 * DRAWN  # in which the last run's report fades from the status bar
    for end in (undo, other_image, other_workspace, extension_disabled, new_file):
        area("IMAGE_EDITOR").spaces.active.image = bpy.data.images["Photo"]
        bpy.context.scene.shock_filter.image.time = 256.0
        bpy.context.scene.shock_filter.image_mode = "IMAGE"
        yield from park("IMAGE_EDITOR")
        yield DRAWN
        before = words_seen()
        run("preview", "IMAGE_EDITOR")
        yield from drag(*middle(), OCTAVE)
        yield DRAWN
        report["endings"][end.__name__] = {"said": different_words(before)}
        yield from end()
        yield from park("IMAGE_EDITOR")
        yield DRAWN
        report["endings"][end.__name__]["left"] = different_words(before)
        save()


def undo() -> Steps:
    """Undo, from a script."""
    with over("IMAGE_EDITOR"):
        bpy.ops.ed.undo_push(message="One")
        bpy.ops.ed.undo_push(message="Two")
        bpy.ops.ed.undo()
    yield DRAWN


def other_image() -> Steps:
    """Show another image, then the old one again."""
    space = area("IMAGE_EDITOR").spaces.active
    space.image = bpy.data.images["Coat"]
    yield DRAWN
    space.image = bpy.data.images["Photo"]
    yield DRAWN


def other_workspace() -> Steps:
    """Go to another workspace, end the preview there, and come back."""
    window = bpy.context.window_manager.windows[0]
    here = window.workspace
    window.workspace = next(each for each in bpy.data.workspaces if each != here)
    yield DRAWN
    addon("preview.operator").stop()
    yield DRAWN
    window.workspace = here
    yield DRAWN


def extension_disabled() -> Steps:
    """Disable the extension, and enable it again."""
    addon_utils.disable(MODULE)
    yield DRAWN
    addon_utils.enable(MODULE)
    yield DRAWN
    yield from open_tab("IMAGE_EDITOR")


def new_file() -> Steps:
    """Load a new file into this window's workspaces."""
    bpy.ops.wm.read_homefile(app_template="", load_ui=False)
    yield DRAWN
    area("IMAGE_EDITOR").spaces.active.image = scene.add_image("Photo")
    yield DRAWN


def drag(x: float, y: float, pixels_right: int) -> Steps:
    """Move the mouse sideways in steps."""
    for step in range(11):
        move(x + pixels_right * step / 10, y)
        yield 0.1


def drawn(before: np.ndarray) -> Steps:
    """Wait until a result is seen."""
    for _ in range(60):
        if different(before, image_seen()) > 200:
            break
        yield DRAWN
    yield 2 * DRAWN


def middle() -> tuple[float, float]:
    """Return a place in the Image Editor."""
    place = region("IMAGE_EDITOR")
    return place.x + place.width * 0.4, place.y + place.height * 0.5


def add_image(kind: str, side: int = 256) -> bpy.types.Image:
    """Add an image of soft stripes; a clear one has a hole that is half transparent."""
    image = bpy.data.images.new(
        kind, side, side, alpha=True, float_buffer="floats" in kind, is_data=kind == "data"
    )
    y, x = np.mgrid[:side, :side]
    stripes = 0.5 + 0.4 * np.tanh(2 * np.sin(x / 5 + y / 25))
    opacity = np.ones_like(stripes)
    if "clear" in kind:
        opacity[side // 4 : side // 2, side // 4 : side // 2] = 0.5
    values = np.stack([stripes, 0.2 + 0.4 * stripes, 1 - stripes, opacity], axis=2)
    if image.is_float:
        values[..., :3] *= opacity[..., None]
    image.pixels.foreach_set(values.astype(np.float32).ravel())
    image.update()
    return image


def image_seen() -> np.ndarray:
    """Return the picture of the Image Editor without the sidebar."""
    whole = region("IMAGE_EDITOR")
    return crop(whole)[:, : int(0.7 * whole.width)].copy()


def inside_seen() -> np.ndarray:
    """Return the picture of the image without its rim, on which Blender draws a line."""
    whole = region("IMAGE_EDITOR")
    left, bottom = whole.view2d.view_to_region(0.05, 0.1, clip=False)
    right, top = whole.view2d.view_to_region(0.95, 0.9, clip=False)
    return crop(whole)[bottom:top, left:right].copy()


def different_but_for_rounding(before: np.ndarray) -> int:
    """Count pixels of the image that look different by now, if it is moved by a pixel or not."""
    now = inside_seen()
    moved = (np.roll(now, (down, right), (0, 1)) for down in (-1, 0, 1) for right in (-1, 0, 1))
    return min(different(before[2:-2, 2:-2], one[2:-2, 2:-2]) for one in moved)


def words_seen() -> tuple[np.ndarray, np.ndarray]:
    """Return the pictures of the Image Editor's header, and of the left part of the status bar."""
    return crop(region("IMAGE_EDITOR", "HEADER")).copy(), screen()[:20, :400].copy()


def different_words(before: tuple[np.ndarray, np.ndarray]) -> list[int]:
    """Count the pixels of both that look different by now."""
    return [different(one, other) for one, other in zip(before, words_seen(), strict=True)]


def state(name: str) -> dict:
    """Return what a preview must not change."""
    image = bpy.data.images[name]
    shown = [each.name for each in bpy.data.images if not each.name.startswith(".")]
    return {"pixels": pixels(image), "dirty": image.is_dirty, "images": len(shown)}
