# SPDX-License-Identifier: GPL-3.0-or-later
"""An operator raises while Blender waits for it, and is freed; then it is used again."""

import bpy
import scene
from harness import (
    DRAWN,
    Steps,
    addon,
    finished,
    move,
    open_tab,
    park,
    positions,
    press,
    region,
    report,
    run,
)

WORDS = "raised on purpose"


def scenario() -> Steps:
    """Break Show Flow and Preview, and see what is left."""
    scene.clear()
    scene.add_monkey("Monkey", 3)
    scene.look()
    yield from open_tab()
    yield from park()
    bpy.context.scene.shock_filter.mode = "GEOMETRY"
    bpy.context.scene.shock_filter.geometry.where = "everywhere"  # a monkey has no creases
    report["start"] = positions("Monkey")
    yield from break_run()
    yield from break_preview()


def break_run() -> Steps:
    """Raise when the progress is shown; the run is made to wait as if for a render."""
    jobs = addon("running.jobs")
    operators, show, is_scene_read = [], jobs._Wait.show, jobs.is_scene_read

    def broken(wait: object, context: object) -> None:
        operators.append(wait.operator)
        raise ZeroDivisionError(WORDS)

    jobs._Wait.show, jobs.is_scene_read = broken, lambda: True
    run("show_flow", mode="geometry")
    yield from park()
    yield DRAWN
    jobs._Wait.show, jobs.is_scene_read = show, is_scene_read
    yield from finished()
    report["run"] = seen = {
        "raised": len(operators),
        "freed": [jobs.is_freed(operator) for operator in operators],
        "waits": len(jobs._waits),
        "shown": [addon("flow.showing").shown_object()],
    }
    seen["again"] = run("show_flow", mode="geometry")
    yield from finished()
    seen["shown"].append(addon("flow.showing").shown_object())
    run("hide_flow")
    yield DRAWN


def break_preview() -> Steps:
    """Raise when the mouse moves, after something was shown."""
    preview, jobs = addon("preview.operator"), addon("running.jobs")
    show_text = preview._Session.show_text
    seen = report["preview"] = {}
    run("preview")
    (session,) = jobs.previews
    place = region("VIEW_3D")
    for _ in range(60):  # seconds: a busy Blender is slow
        yield DRAWN
        if session._preview.updates:
            break
    seen["shown"] = positions("Monkey")

    def broken(session: object, context: object) -> None:
        raise ZeroDivisionError(WORDS)

    preview._Session.show_text = broken
    move(place.x + place.width * 0.45, place.y + place.height * 0.5)
    yield DRAWN
    preview._Session.show_text = show_text
    seen["running"] = jobs.is_previewing(), len(jobs.previews)
    seen["freed"] = jobs.is_freed(session.operator)
    seen["kept"] = positions("Monkey")
    seen["again"] = run("preview")
    yield DRAWN
    seen["running_again"] = jobs.is_previewing()
    yield from press("Escape")
    yield DRAWN
    seen["ended"] = not jobs.is_previewing()
