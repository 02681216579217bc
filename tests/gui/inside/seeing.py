# SPDX-License-Identifier: GPL-3.0-or-later
"""What shows before a run what it will do: Show Flow and Preview."""

import bpy
import numpy as np
import scene
from harness import (
    DRAWN,
    Steps,
    addon,
    area,
    button,
    buttons,
    click,
    colors,
    crop,
    different,
    finished,
    last_operator,
    move,
    open_tab,
    park,
    picture,
    positions,
    press,
    region,
    report,
    run,
)

PREVIEW = 1
"""Number of the button in the tab, from the top."""


def scenario() -> Steps:
    """Show and hide the flow; preview each mode, drop it, and apply it."""
    scene.clear()
    scene.add_monkey("Monkey", 3)
    scene.look()
    bpy.context.scene.shock_filter.geometry.where = "everywhere"  # a monkey has no creases
    yield from open_tab()
    yield from park()
    bpy.ops.ed.undo_push(message="Start")
    yield DRAWN
    report["start"] = state()
    for mode in ("geometry", "colors"):
        bpy.context.scene.shock_filter.mode = mode.upper()
        report[f"flow_{mode}"] = {}
        yield from flow(mode, report[f"flow_{mode}"])
    for mode in ("geometry", "colors", "denoise"):
        area("VIEW_3D").spaces.active.shading.color_type = (
            "VERTEX" if mode == "colors" else "MATERIAL"
        )
        bpy.context.scene.shock_filter.mode = mode.upper()
        report[f"preview_{mode}"] = {}
        yield from preview(mode, report[f"preview_{mode}"])
    yield from change_by_script()
    yield from new_file_during_both()


def flow(mode: str, seen: dict) -> Steps:
    """Show the flow, hide it again by a click, and show it once more."""
    yield DRAWN
    before = object_seen()
    seen["buttons"] = len((yield from buttons()))
    for step in range(3):
        if step == 1:
            places = yield from buttons()
            yield from click(places[-1])  # Hide Flow
        else:
            run("show_flow", mode=mode)
        yield from park()
        yield from finished()
        yield from park()
        names = bpy.data.objects["Monkey"].data.attributes.keys()
        seen.setdefault("shown", []).append(addon("flow.showing").shown_object())
        seen["attributes"] = sorted(name for name in names if "shock_" in name)
        seen.setdefault("pixels", []).append(different(before, object_seen()))
    picture(f"flow-{mode}", area("VIEW_3D"))
    run("hide_flow")
    yield DRAWN


def preview(mode: str, seen: dict) -> Steps:
    """Drag and press Esc; then drag, turn the wheel and press Enter, and undo."""
    settings = getattr(bpy.context.scene.shock_filter, mode)
    dial = "strength" if mode == "denoise" else "amount"
    setattr(settings, dial, 0.5)  # so that the mouse can raise it
    places = yield from buttons()
    yield from click(places[PREVIEW])
    yield DRAWN
    seen["start_values"] = values()
    for way in (0.2, 0.4, 0.6, 0.8, 1.0):
        (left, bottom, *_), (x, y) = places[PREVIEW], middle()
        move(left + way * (x - left), bottom + way * (y - bottom))
        yield 0.05
    yield DRAWN
    seen["values_at_the_model"] = values()
    seen["said"] = said()
    yield from drag(*middle())
    seen["values_dragged"] = values()
    seen["dragged"] = state()
    picture(f"preview-{mode}", area("VIEW_3D"), width=1400)
    yield from press("Escape")
    yield DRAWN
    seen["dropped"] = state()
    before = getattr(settings, dial)
    yield from park()
    seen["started"] = run("preview")
    yield from drag(*middle())
    for _ in range(2):
        button("click", 4)
        yield 0.3
    yield from press("Return")
    yield from finished()
    seen["applied"] = state()
    seen["dial"] = [before, getattr(settings, dial)]
    seen["last"] = last_operator()
    yield from park()
    yield from press("ctrl+z")
    seen["undone"] = state()


def change_by_script() -> Steps:
    """Begin with a time out of the dial's range, move a vertex meanwhile, and see what is left."""
    vertices, settings = (
        bpy.data.objects["Monkey"].data.vertices,
        bpy.context.scene.shock_filter.geometry,
    )
    settings.time = 65536.0
    before = [tuple(vertices[number].co) for number in (0, 1)]
    yield from park()
    bpy.context.scene.shock_filter.mode = "GEOMETRY"
    run("preview")
    x, y = middle()
    for up in (10, 20, 30):
        move(x + 5, y + up)  # park() ends 5 pixels beside the middle
        yield 0.2
    button("click", 4)
    yield DRAWN
    report["script"] = seen = {"values": values()}
    vertices[0].co = (0, 0, 3)
    move(x - 100, y + 30)
    yield 3 * DRAWN
    seen["running"] = len(addon("running.jobs").previews)
    seen["kept"] = tuple(vertices[0].co)
    seen["back"] = tuple(vertices[1].co) == before[1]
    vertices[0].co = before[0]
    settings.time = 256.0
    yield DRAWN


def values() -> list[float]:
    """Return the one or two values of the preview that is under way."""
    preview = running_preview()
    return [getattr(preview.parameters, n) for n in (preview.dial, preview.second) if n]


def said() -> str:
    """Return what the preview says about itself."""
    return running_preview().text()


def running_preview() -> object:
    """Return the preview that is under way."""
    return addon("running.jobs").previews[0]._preview


def drag(x: float, y: float) -> Steps:
    """Move the mouse to the right, and wait for what the preview shows then."""
    before = state()
    for _ in range(60):  # seconds: a busy Blender is told late that the mouse has come, and rests
        move(x, y)
        yield DRAWN
        if addon("running.jobs").previews[0].operator._arrived:
            break
    for step in range(11):
        move(x + 12 * step, y)
        yield 0.2
    for _ in range(60):  # seconds: a busy Blender is slow
        if state() != before:
            break
        yield DRAWN
    yield 3 * DRAWN


def middle() -> tuple[float, float]:
    """Return a place in the 3D view."""
    place = region("VIEW_3D")
    return place.x + place.width * 0.4, place.y + place.height * 0.5


def new_file_during_both() -> Steps:
    """Start a new file while the flow is shown and a preview is under way."""
    run("show_flow", mode="geometry")
    yield from finished()
    bpy.context.scene.shock_filter.mode = "GEOMETRY"
    run("preview")
    yield from drag(*middle())
    bpy.ops.wm.read_homefile(app_template="")
    yield DRAWN
    report["new_file"] = {
        "shown": addon("flow.showing").shown_object(),
        "objects": sorted(bpy.data.objects.keys()),
    }


def object_seen() -> np.ndarray:
    """Return the picture of the 3D view without the sidebar and brushes, whose icons come late."""
    whole = region("VIEW_3D")
    brushes = [part for part in area("VIEW_3D").regions if part.type.startswith("ASSET_SHELF")]
    shelf = sum(part.height for part in brushes)
    return crop(whole)[shelf:, : int(0.7 * whole.width)]


def state() -> dict[str, str]:
    """Return what a preview changes."""
    return {"positions": positions("Monkey"), "colors": colors("Monkey")}
