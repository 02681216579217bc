# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel shows after runs, and what is painted on."""

from types import SimpleNamespace

import bpy
import scene
from harness import (
    DRAWN,
    Steps,
    addon,
    buttons,
    click,
    crop,
    different,
    finished,
    open_tab,
    over,
    park,
    press,
    region,
    report,
    run,
    tallest,
)


def scenario() -> Steps:
    """Click and look without moving the mouse; paint; hide the flow; cancel a run."""
    scene.clear()
    scene.add_texture(scene.add_monkey("Monkey", 2))
    scene.look()
    yield from open_tab()
    yield from words_below_the_buttons()
    yield from hiding_the_flow()
    yield from cancelling()
    yield from texture_paint()


def words_below_the_buttons() -> Steps:
    """Compare them as they are after a click with how they are when the mouse is elsewhere."""
    places = yield from buttons()
    yield from park()
    before = crop(below(places))
    yield from click(tallest(places))
    yield from finished()
    yield from still(below(places))
    after_click = crop(below(places)).copy()
    yield from park()
    yield from still(below(places))
    report["words"] = {
        "shown": different(before, after_click),
        "left": different(after_click, crop(below(places))),
    }


def hiding_the_flow() -> Steps:
    """Click on Hide Flow in another mode, with nothing selected."""
    run("show_flow", mode="geometry")
    yield from finished()
    bpy.context.scene.shock_filter.mode = "TEXTURE"
    monkey = bpy.data.objects["Monkey"]
    monkey.select_set(False)
    yield DRAWN
    places = yield from buttons()
    seen = report["flow"] = {"shown": addon("flow.showing").shown_object()}
    yield from click(places[-1])
    yield DRAWN
    seen["hidden"] = addon("flow.showing").shown_object()
    monkey.select_set(True)


def cancelling() -> Steps:
    """Press Esc in a second run; the panel must not show the first one's success."""
    bpy.context.scene.shock_filter.mode = "GEOMETRY"
    said = addon("operators.base").summaries
    report["cancelled"] = {"before": said["geometry"]}
    yield from park()
    run("sharpen_geometry", time=4096.0, repeat=100, smoothing_passes=50)
    yield from press("Escape")
    yield from finished()
    report["cancelled"]["after"] = said["geometry"]


def texture_paint() -> Steps:
    """Sharpen what is painted on, twice, with the material's image and with a single one."""
    with over():
        bpy.ops.object.mode_set(mode="TEXTURE_PAINT")
    paint = bpy.context.tool_settings.image_paint
    node = bpy.data.materials["Coat"].node_tree.nodes.active
    for mode in ("MATERIAL", "IMAGE"):
        paint.mode, paint.canvas = mode, node.image
        for _ in range(2):
            yield DRAWN
            with over():
                painted = addon("data.chosen").shown_image(bpy.context).name
            run("sharpen_texture", time=256.0)
            yield from finished()
            words = addon("operators.base").summaries["texture"]
            report.setdefault("paint", []).append([painted, node.image.name, words])


def still(place: SimpleNamespace) -> Steps:
    """Wait until panels, which slide to their places, stand there."""
    for _ in range(20):
        before = crop(place).copy()
        yield DRAWN
        if not different(before, crop(place)):
            break


def below(places: list) -> SimpleNamespace:
    """Return the part of the sidebar below the buttons, as high as some lines of words."""
    sidebar = region("VIEW_3D", "UI")
    top = min(bottom for _, bottom, _, _ in places) - 2
    return SimpleNamespace(x=sidebar.x, y=top - 60, width=sidebar.width, height=60)
