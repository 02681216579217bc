# SPDX-License-Identifier: GPL-3.0-or-later
"""Live results: a copy that follows its source, painting where, undo and redo, opening again."""

import time

import bpy
import numpy as np
import scene
from harness import (
    DRAWN,
    MODULE,
    PICTURES,
    Steps,
    addon,
    area,
    button,
    crop,
    fingerprint,
    finished,
    move,
    open_tab,
    over,
    park,
    picture,
    press_key,
    region,
    report,
    run,
)

IN_SIGHT, OUT_OF_SIGHT = 4, 2
STEPS = 20
DABS = 20
LOOP = PICTURES / "live-loop"


def scenario() -> Steps:
    """Go through them."""
    bpy.context.preferences.edit.undo_steps = 3 * STEPS
    LOOP.mkdir()
    scene.clear()
    operand = add_stack()
    scene.look()
    yield from open_tab()
    yield from park()
    yield from make_copy()
    yield from follow(operand.name)
    yield from press_keys(operand.name)
    yield from paint()
    yield from undo_and_redo()
    yield from reopen()


def add_stack() -> bpy.types.Object:
    """Add a cube out of Boolean and Remesh modifiers, and select it; return the operand."""
    bpy.ops.mesh.primitive_cube_add(size=0.8, location=(0.8, -0.8, 0.8))
    operand = bpy.context.object
    operand.name, operand.display_type = "Operand", "WIRE"
    bpy.ops.mesh.primitive_cube_add(size=1.6)
    part = bpy.context.object
    part.name = "Part"
    cut = part.modifiers.new("Cut", "BOOLEAN")
    cut.operation, cut.object = "DIFFERENCE", operand
    voxel = part.modifiers.new("Remesh", "REMESH")
    voxel.mode, voxel.voxel_size = "VOXEL", 0.0175
    return operand


def live() -> object:
    """Return what scripts call."""
    return addon("live")


def seen_state(name: str) -> dict:
    """Describe an object as it is seen."""
    bpy.context.view_layer.update()
    obj = bpy.data.objects[name]
    mesh = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.attributes["position"].data.foreach_get("vector", points)
    return {
        "vertices": len(mesh.vertices),
        "positions": fingerprint(points),
        "operand": list(bpy.data.objects["Operand"].location),
    }


def make_copy() -> Steps:
    """Press, with the output Live."""
    seen = report["made"] = {}
    bpy.ops.ed.undo_push(message="Start")
    run("sharpen_geometry", output="LIVE")
    yield from finished()
    copy = bpy.context.object
    copy.select_set(False)  # its outline would hide the creases
    seen["name"], seen["state"] = copy.name, live().state(copy)
    seen["vertices"] = len(copy.data.vertices)
    seen["modifiers"] = [each.name for each in copy.modifiers]
    yield from park()
    picture("live-copy", area("VIEW_3D"), width=1400)


def follow(name: str) -> Steps:
    """Move the operand, and wait until the copy has followed by itself."""
    seen = report["followed"] = {}
    copy = report["made"]["name"]
    seen["before"] = seen_state(copy)
    start = time.monotonic()
    run("update_live")
    yield from finished()
    seen["by_hand"] = time.monotonic() - start
    with over():
        bpy.ops.shock_filter.auto_update_live()
    seen["seconds"], seen["shown"], seen["states"] = [], [], []
    yield from record(3)
    for number in range(IN_SIGHT + OUT_OF_SIGHT):
        if number == IN_SIGHT:
            look_beside(True)
            yield DRAWN
        drawn = first_draw(copy)
        start = time.monotonic()
        bpy.data.objects[name].location.x -= 0.1
        bpy.context.view_layer.update()
        if "noticed" not in seen:
            seen["noticed"] = live().state(bpy.data.objects[copy])  # takes long
        mesh = bpy.data.objects[copy].data.session_uid
        while bpy.data.objects[copy].data.session_uid == mesh:
            if time.monotonic() > start + 90.0:
                raise TimeoutError("The copy does not follow.")
            yield 0.02
        seen["seconds"].append(time.monotonic() - start)
        while not drawn:
            yield 0.02
        seen["shown"].append(drawn[0] - start)
        yield DRAWN
        yield from finished()
        seen["states"].append(live().state(bpy.data.objects[copy]))
        yield from record(3)
    look_beside(False)
    seen["after"] = seen_state(copy)
    seen["kept"] = keep(bpy.data.objects[copy])
    yield DRAWN
    picture("live-followed", area("VIEW_3D"), width=1400)


def look_beside(beside: bool) -> None:
    """Look far beside the part, which then takes no time to draw, or at it again."""
    view = area("VIEW_3D").spaces.active.region_3d
    view.view_location = (200.0, 0.0, 0.0) if beside else (0.0, 0.0, 0.0)


def press_keys(name: str) -> Steps:
    """Press G during an update, which drags another object: the result waits for the end of it."""
    seen = report["keys"] = {}
    copy = bpy.data.objects[report["made"]["name"]]
    bpy.ops.object.empty_add(location=(0.0, 0.0, 3.0))
    empty = bpy.context.object
    yield from park()
    yield 1.5  # the new object is no change of the source
    mesh = copy.data.session_uid
    bpy.data.objects[name].location.x += 0.05
    bpy.context.view_layer.update()
    for _ in range(200):
        if addon("running.jobs").current() is not None:
            break
        yield 0.01
    press_key("g")
    yield 0.1
    seen["dragged"] = dragged()
    seen["during"] = addon("running.jobs").current() is not None
    yield 3.0
    seen["waited"] = copy.data.session_uid == mesh and bool(dragged())
    press_key("Escape")
    yield DRAWN
    yield from finished()
    seen["ended"], seen["followed"] = not dragged(), copy.data.session_uid != mesh
    seen["state"] = live().state(copy)
    bpy.data.objects.remove(empty)
    bpy.context.view_layer.objects.active = copy


def dragged() -> list[str]:
    """List the drags that are under way."""
    found = bpy.context.window_manager.windows[0].modal_operators
    return [each.bl_idname for each in found if each.bl_idname.startswith("TRANSFORM_OT")]


def first_draw(name: str) -> list[float]:
    """Return a list that gets the time when an object is first drawn with another mesh."""
    old, drawn = bpy.data.objects[name].data.session_uid, []

    def look() -> None:
        if not drawn and bpy.data.objects[name].data.session_uid != old:
            drawn.append(time.monotonic())
            bpy.types.SpaceView3D.draw_handler_remove(handler, "WINDOW")

    handler = bpy.types.SpaceView3D.draw_handler_add(look, (), "WINDOW", "POST_PIXEL")
    return drawn


def keep(copy: bpy.types.Object) -> list[float]:
    """Press Keep beside Widest Fillet; return what the field said, and what it holds then."""
    copy.select_set(True)
    kept = bpy.context.scene.shock_filter.geometry
    with over():
        chosen = addon("operators.keeping").found_by(bpy.context, "geometry", "widest_fillet")
        bpy.ops.shock_filter.keep_auto(mode="geometry", name="widest_fillet")
    values = [chosen.value, kept.widest_fillet]
    kept.property_unset("widest_fillet")
    copy.select_set(False)
    return values


def undo_and_redo() -> Steps:
    """Undo and redo, with Auto Update, which must not end that."""
    seen = report["undone"] = {}
    name = report["made"]["name"]
    bpy.data.objects["Part"].modifiers["Remesh"].voxel_size = 0.08  # many steps
    with over():
        bpy.ops.shock_filter.update_live("EXEC_DEFAULT", True)
    amount = [each for each in bpy.data.node_groups if "shock_filter_live" in each]
    seen["groups"] = len(amount)
    yield DRAWN
    states = [seen_state(name)]
    for number in range(STEPS):
        bpy.data.objects["Operand"].location.y = -0.8 - 0.01 * number
        with over():
            bpy.ops.ed.undo_push(message="Move")
            bpy.ops.shock_filter.update_live("EXEC_DEFAULT", True)
        states.append(seen_state(name))
        yield 0.02
    for ways, operator in ((reversed(states[:-1]), "undo"), (states[1:], "redo")):
        seen[operator] = []
        for state in ways:
            found = None
            for _ in range(4):  # moving and updating are steps of their own
                with over():
                    if not getattr(bpy.ops.ed, operator).poll():
                        break
                    getattr(bpy.ops.ed, operator)()
                yield 0.02
                found = seen_state(name)
                if found["positions"] == state["positions"]:
                    break
            seen[operator].append(found is not None and found["positions"] == state["positions"])


def reopen() -> Steps:
    """Save the file, and open it with the extension and with it disabled."""
    seen = report["reopened"] = {}
    name, path = report["made"]["name"], str(PICTURES / "live.blend")
    seen["before"] = seen_state(name)
    bpy.ops.wm.save_as_mainfile(filepath=path)
    for step in ("enabled", "disabled"):
        if step == "disabled":
            bpy.ops.preferences.addon_disable(module=MODULE)
            yield DRAWN
        bpy.ops.wm.open_mainfile(filepath=path)
        yield DRAWN
        seen[step] = seen_state(name)
    seen["is_known"] = hasattr(bpy.types, "SHOCK_FILTER_OT_update_live")


def paint() -> Steps:
    """Go to Weight Paint Mode, where the result is seen."""
    seen = report["painted"] = {}
    name = report["made"]["name"]
    before = seen_state(name)
    with over():
        bpy.ops.shock_filter.paint_live()
    yield DRAWN
    seen["mode"] = bpy.context.mode
    seen["same"] = seen_state(name)["positions"] == before["positions"]
    seen["frames"] = {}
    modifier = bpy.context.object.modifiers["Shock Filter"]
    take_brush()
    for row, name in enumerate(("warm", "live", "plain", "live", "plain")):
        modifier.show_viewport = name != "plain"  # plain: Blender's painting alone
        yield DRAWN
        frames = yield from stroke(0.35 + 0.02 * row)
        seen["frames"].setdefault(name, []).extend(frames)
    modifier.show_viewport = True
    yield DRAWN
    picture("live-painting", area("VIEW_3D"), width=1400)
    bpy.ops.object.mode_set(mode="OBJECT")
    seen["moved"] = moved_outside(bpy.data.objects[report["made"]["name"]])
    seen["module"] = MODULE


def take_brush() -> None:
    """Take a brush that paints with weight 0."""
    tools = bpy.context.tool_settings
    if tools.weight_paint.brush is None:  # Debian's Blender comes without brushes
        bpy.data.brushes.new("Out", mode="WEIGHT_PAINT").asset_mark()
        with over():
            bpy.ops.brush.asset_activate(
                asset_library_type="LOCAL", relative_asset_identifier="Brush/Out"
            )
    in_5 = getattr(tools.weight_paint, "unified_paint_settings", None)
    for owner in (in_5 or tools.unified_paint_settings, tools.weight_paint.brush):
        owner.weight, owner.size = 0.0, 40
        owner.strength = 1.0


def stroke(height: float) -> Steps:
    """Paint a stroke across the object; the generator returns the seconds between frames."""
    drawn: list[float] = []
    handler = bpy.types.SpaceView3D.draw_handler_add(
        lambda: drawn.append(time.perf_counter()), (), "WINDOW", "POST_PIXEL"
    )
    view = region("VIEW_3D")
    x, y = view.x + view.width * 0.35, view.y + view.height * height
    move(x, y)
    yield 0.3
    button("mousedown")
    yield 0.1
    drawn.clear()
    for step in range(DABS):
        move(x + step * 0.15 * view.width / DABS, y)
        yield 0.03
    found = np.diff(drawn).tolist()
    button("mouseup")
    yield DRAWN
    bpy.types.SpaceView3D.draw_handler_remove(handler, "WINDOW")
    return found


def record(count: int) -> Steps:
    """Keep so many pictures of the 3D view."""
    for _ in range(count):
        number = len(list(LOOP.glob("*.npy")))
        np.save(LOOP / f"{number:03}.npy", crop(area("VIEW_3D"))[::-1])
        yield 0.2


def moved_outside(obj: bpy.types.Object) -> dict:
    """Count the vertices that were painted out, and how many of these move."""
    bpy.context.view_layer.update()
    mesh = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    weights = np.array([sum(each.weight for each in v.groups) for v in obj.data.vertices])
    places = []
    for each in (obj.data, mesh):
        points = np.empty(3 * len(each.vertices), np.float32)
        each.attributes["position"].data.foreach_get("vector", points)
        places.append(points.reshape(-1, 3))
    moves = (places[0] != places[1]).any(axis=1)
    return {"out": int((weights == 0).sum()), "moved": int((moves & (weights == 0)).sum()),
            "shown": int(moves.sum())}  # fmt: skip
