# SPDX-License-Identifier: GPL-3.0-or-later
"""Changing a setting after the run, other modes of the 3D view, menus and search."""

import bpy
import scene
from harness import (
    DRAWN,
    Steps,
    area,
    button,
    click,
    colors,
    drag,
    finished,
    last_operator,
    mark,
    marked,
    move,
    open_tab,
    over,
    park,
    picture,
    pixels,
    positions,
    press,
    region,
    report,
    run,
    type_text,
    whole_window,
)


def scenario() -> Steps:
    """Go through them, always with the same object and undoing each."""
    scene.clear()
    scene.add_remeshed_part("Part")
    scene.paint(bpy.context.object)
    scene.look()
    yield from open_tab()
    yield from park()
    bpy.ops.ed.undo_push(message="Start")
    report["start"] = state()
    yield from drag_in_last_operators_panel("redo_panel")
    yield from drag_in_folded_section()
    yield from search()
    for mode, operator, settings in (
        ("EDIT", "sharpen_geometry", {}),
        ("SCULPT", "denoise", {"target": "geometry"}),
        ("VERTEX_PAINT", "sharpen_colors", {}),
    ):
        report[mode] = {}
        yield from in_mode(mode, operator, settings, report[mode])
    yield from after_painting()
    yield from from_menu()
    yield from from_preset()
    yield from repeat_on_image()


def drag_in_last_operators_panel(name: str) -> Steps:
    """Run, open what F9 opens, drag the number on top (the amount), and undo."""
    seen = report[name] = {"start": state()}
    run("sharpen_colors")
    yield from finished()
    seen["first"] = state()
    yield from mark("num", True)
    before = marked(whole_window())
    yield from park()
    yield from press("F9")
    yield DRAWN
    new = [place for place in marked(whole_window()) if place not in before]
    if not new:  # xdotool's function keys do not reach Blender 5.2
        with over():
            bpy.ops.screen.redo_last("INVOKE_DEFAULT")
        yield 2 * DRAWN
        new = [place for place in marked(whole_window()) if place not in before]
    seen["numbers"] = len(new)
    yield from drag(new[0], -60)
    seen["amount"] = bpy.context.window_manager.operators[-1].properties.amount
    seen["dragged"] = state()
    # Leaving it closes it up to 4.3, a click outside in 5.2; the top bar is empty there.
    move(100, 300)
    yield DRAWN
    window = whole_window()
    x, y = 0.747 * window.width, window.height - 12
    yield from click((x, y, x, y))
    yield DRAWN
    yield from mark("num", False)
    yield from park()
    yield from press("ctrl+z")
    seen["undone"] = state()


def drag_in_folded_section() -> Steps:
    """Run, open the panel in the view's corner and its last section, drag a number there, undo."""
    seen = report["section"] = {}
    run("sharpen_geometry", time=16.0)
    yield from finished()
    panel = region("VIEW_3D", "HUD")
    yield from click((panel.x, panel.y, panel.x + 120, panel.y + panel.height))
    yield from park()
    yield DRAWN
    picture("last-operation", panel)
    seen["first"] = state()
    yield from mark("num", True)
    folded = marked(panel)
    last_title = panel.x, panel.y + 10, panel.x + 150, panel.y + 22
    yield from click(last_title)
    yield from park()
    yield DRAWN
    unfolded = marked(panel)
    seen["numbers"] = len(folded), len(unfolded)
    yield from drag(unfolded[len(folded) + 2], 60)  # below Time and Smoothing
    seen["radius"] = bpy.context.window_manager.operators[-1].properties.screening_radius
    seen["dragged"] = state()
    yield from mark("num", False)
    yield from park()
    yield from press("ctrl+z")
    seen["undone"] = state()


def search() -> Steps:
    """Find the operator by its name in what F3 opens, and run it."""
    seen = report["search"] = {}
    with over():
        bpy.ops.wm.search_menu("INVOKE_DEFAULT")
    yield DRAWN
    yield from type_text("Sharpen Geometry")
    yield from press("Return")
    yield from finished()
    seen["last"] = last_operator()
    seen["done"] = state()
    yield from press("ctrl+z")
    seen["undone"] = state()


def in_mode(mode: str, operator: str, settings: dict, seen: dict) -> Steps:
    """Run in another mode than Object Mode; undo returns to that mode as it was."""
    with over():
        bpy.ops.object.mode_set(mode=mode)
        if mode == "EDIT":
            bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.ed.undo_push(message="Mode")
    yield DRAWN
    yield from park()
    seen["start"] = state()
    seen["started"] = run(operator, **settings)
    yield from finished()
    seen["done"] = state()
    yield from press("ctrl+z")
    seen["undone"] = state()
    yield from press("ctrl+shift+z")
    seen["redone"] = state()
    yield from press("ctrl+z")
    with over():
        bpy.ops.object.mode_set(mode="OBJECT")
    yield DRAWN


def after_painting() -> Steps:
    """Change colors in Vertex Paint Mode, run as before, and undo both."""
    with over():
        bpy.ops.object.mode_set(mode="VERTEX_PAINT")
        bpy.ops.ed.undo_push(message="Mode")
        bpy.ops.paint.vertex_color_brightness_contrast("EXEC_DEFAULT", True, brightness=20.0)
    yield from drag_in_last_operators_panel("painted")
    undone = report["painted"]["undone_further"] = []
    for _ in range(2):
        yield from press("ctrl+z")
        undone.append(state())
    with over():
        bpy.ops.object.mode_set(mode="OBJECT")
        bpy.ops.ed.undo_push(message="Mode")
    yield DRAWN


def from_preset() -> Steps:
    """Click on the entry of the list of presets that Blender puts under the mouse."""
    seen = report["preset"] = {}
    settings = bpy.context.scene.shock_filter.geometry
    settings.time = 77.0  # which each of them changes, the defaults, too
    with over():
        bpy.ops.object.mode_set(mode="OBJECT")
    yield from park()
    with over():
        bpy.ops.wm.call_panel(name="SHOCK_FILTER_PT_geometry_presets", keep_open=False)
    yield DRAWN
    picture("presets", area("VIEW_3D"))
    seen["start"] = values(settings)
    button("click")
    yield 2 * DRAWN
    seen["chosen"] = values(settings)


def repeat_on_image() -> Steps:
    """Replace an image's pixels, and once more with Shift R."""
    seen = report["repeated"] = {}
    area("VIEW_3D").type = "IMAGE_EDITOR"
    yield DRAWN
    photo, twice = scene.add_image("Photo"), scene.add_image("Twice")
    area("IMAGE_EDITOR").spaces.active.image = photo
    settings = {"time": 16.0, "output": "REPLACE"}
    run("sharpen_image", "IMAGE_EDITOR", image="Photo", **settings)
    yield from finished()
    seen["once"] = pixels(photo)
    yield from park("IMAGE_EDITOR")
    yield from press("shift+r")
    yield from finished()
    seen["repeated"] = pixels(photo)
    for _ in range(2):
        bpy.ops.shock_filter.sharpen_image(image="Twice", **settings)
    seen["twice"] = pixels(twice)


def values(settings: bpy.types.PropertyGroup) -> dict:
    """Return the values of all settings."""
    names = [p.identifier for p in settings.bl_rna.properties if not p.is_readonly]
    return {name: getattr(settings, name) for name in names}


def from_menu() -> Steps:
    """Run what stands last in the submenu at the end of the menu of Vertex Paint."""
    seen = report["menu"] = {}
    with over():
        bpy.ops.object.mode_set(mode="VERTEX_PAINT")
        bpy.ops.ed.undo_push(message="Mode")
    yield DRAWN
    seen["start"] = state()
    yield from park()
    with over():
        bpy.ops.wm.call_menu(name="VIEW3D_MT_paint_vertex")
    yield DRAWN
    yield from press("End", "Right", "End", "Return")
    yield from finished()
    seen["last"] = last_operator()
    seen["done"] = state()


def state() -> dict[str, str]:
    """Return the mode and what may change in it."""
    mode = bpy.data.objects["Part"].mode
    return {"mode": mode, "positions": positions("Part"), "colors": colors("Part")}
