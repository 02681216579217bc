# SPDX-License-Identifier: GPL-3.0-or-later
"""Before and after: by a key in previews, in all modes, and by a button after runs."""

import bpy
import scene
from harness import (
    DRAWN,
    PICTURES,
    Steps,
    addon,
    area,
    buttons,
    click,
    different,
    finished,
    open_tab,
    over,
    park,
    picture,
    press,
    report,
    run,
)
from seeing import drag, middle, object_seen, said, state

MODES = {"SCULPT": "geometry", "VERTEX_PAINT": "colors", "EDIT": "geometry"}
"""What is previewed in each of Blender's modes of the 3D view."""

BEFORE_AFTER = 2
"""Number of the button in the tab after a run, from the top."""


def scenario() -> Steps:
    """Preview in each mode, drop it, and apply it; swap the result by clicks, and undo that."""
    scene.clear()
    scene.add_monkey("Monkey", 2)
    scene.look()
    settings = bpy.context.scene.shock_filter
    settings.geometry.where, settings.geometry.feature_threshold = "everywhere", 0.0
    settings.colors.what, settings.colors.width = "drawing", 8.0
    area("VIEW_3D").spaces.active.shading.color_type = "VERTEX"
    yield from open_tab()
    yield from park()
    for mode, filter_mode in MODES.items():
        bpy.context.scene.shock_filter.mode = filter_mode.upper()  # undo has made it anew
        bpy.ops.object.mode_set(mode=mode)
        if mode == "EDIT":
            bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.ed.undo_push(message="Mode")
        yield DRAWN
        report[mode] = {}
        yield from preview(mode, report[mode])
        yield from swaps(mode, report[mode])
        bpy.ops.object.mode_set(mode="OBJECT")
        bpy.ops.ed.undo_push(message="Object Mode")
    yield from ended_meanwhile()


def preview(mode: str, seen: dict) -> Steps:
    """Look at both by the key, press Esc; then apply with Enter."""
    seen["start"], looked = now(), object_seen()
    run("preview")
    yield from drag(*middle())
    yield 2 * DRAWN  # paint modes draw slowly
    seen["dragged"], seen["shown"] = state(), different(looked, object_seen())
    if mode == "SCULPT":
        picture("preview-in-sculpt-mode", area("VIEW_3D"), width=1400)
    yield from press("b")
    seen["before"], seen["said_before"] = state(), said()
    yield from press("b")
    seen["after"], seen["said_after"] = state(), said()
    yield from press("Escape")
    yield from park()
    yield 2 * DRAWN
    seen["dropped"], seen["left"] = now(), different(looked, object_seen())
    run("preview")
    yield from drag(*middle())
    yield from press("Return")
    yield from finished()
    seen["applied"] = now()


def swaps(mode: str, seen: dict) -> Steps:
    """Click on the button twice, then undo that, and the run."""
    places = yield from buttons()
    seen["clicked"] = []
    for name in ("before", "after"):
        yield from click(places[BEFORE_AFTER])
        yield from park()
        yield DRAWN
        seen["clicked"].append([addon("data.replaced").state(), now()])
        if (mode, name) == ("SCULPT", "before"):
            picture("before-after", area("VIEW_3D"))
    seen["undone"] = []
    for _ in range(3):
        yield from press("ctrl+z")
        seen["undone"].append(now())


def ended_meanwhile() -> Steps:
    """Undo, and save the file, from a script while a preview in Edit Mode is under way."""
    bpy.context.scene.shock_filter.mode = "GEOMETRY"
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.ed.undo_push(message="One")
    bpy.ops.ed.undo_push(message="Two")
    seen = report["ended_meanwhile"] = {"start": now()}
    for end in (bpy.ops.ed.undo, save_file):
        run("preview")
        yield from drag(*middle())
        with over():
            end()
        yield 2 * DRAWN
        seen.setdefault("after", []).append([now(), len(addon("running.jobs").previews)])


def save_file() -> None:
    """Save the file."""
    bpy.ops.wm.save_as_mainfile(filepath=str(PICTURES / "saved.blend"))


def now() -> dict:
    """Return what a preview must bring back, and the mode."""
    obj = bpy.data.objects["Monkey"]
    if obj.mode == "EDIT":
        obj.update_from_editmode()
    selected = sum(vertex.select for vertex in obj.data.vertices)
    found = state() if obj.mode != "EDIT" else {"positions": state()["positions"]}
    return {**found, "mode": obj.mode, "selected": selected}
