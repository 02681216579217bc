# SPDX-License-Identifier: GPL-3.0-or-later
"""What may happen while a run is under way: undo, other files, deleted objects, and more.

Each run waits at its first question until the mischief is done; then it goes on to its end.
"""

import tempfile
import threading
import time
from importlib import import_module
from pathlib import Path

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
    finished,
    over,
    park,
    pixels,
    positions,
    press,
    report,
    run,
    running,
    save,
)

SHORT = 0.4

held = threading.Event()


def scenario() -> Steps:
    """Do all the mischief, one after the other."""
    bpy.context.preferences.filepaths.use_auto_save_temporary_files = False
    for mischief in MISCHIEF:
        begin()
        found = yield from mischief()
        report[mischief.__name__] = {**found, "left": left()}
        save()
        yield SHORT


def begin() -> None:
    """Make a file with a bumpy grid, active and selected, and an undo step."""
    bpy.ops.object.mode_set(mode="OBJECT") if bpy.context.object else None
    scene.clear()
    with over():
        scene.add_bumpy_grid("Grid", 60)
        bpy.ops.ed.undo_push(message="Start")


def start(operator: str = "sharpen_geometry", kind: str = "VIEW_3D", **settings) -> Steps:
    """Start a run that waits; bumps are no creases, so geometry is sharpened everywhere."""
    if operator == "sharpen_geometry":
        settings["where"] = "everywhere"
    job = addon("running.jobs").Job
    if not hasattr(job, "asks"):
        job.asks = job._progress
        job._progress = ask_when_let_go
    held.set()
    run(operator, kind, **settings)
    yield SHORT


def ask_when_let_go(job, fraction: float, message: str) -> bool:
    """Wait as long as runs are held, then ask what the run asks."""
    while held.is_set() and not job.cancelled:
        time.sleep(0.005)
    return job.asks(fraction, message)


def let_go() -> Steps:
    """Let the run go on to its end."""
    held.clear()
    yield from finished()


def left() -> dict:
    """Return what is left of runs; all of it is to be empty."""
    windows = bpy.context.window_manager.windows
    names = [operator.bl_idname for window in windows for operator in window.modal_operators]
    return {
        "running": running(),
        "operators": [name for name in names if name.startswith("SHOCK_FILTER")],
    }


def undo_and_redo_keys() -> Steps:
    """Press Ctrl Z and Ctrl Shift Z during the run: they do nothing; then undo and redo it."""
    before = positions("Grid")
    yield from start()
    yield from park()
    yield from press("ctrl+z", "ctrl+shift+z")
    kept = positions("Grid") == before
    yield from let_go()
    after = positions("Grid")
    yield from press("ctrl+z")
    undone = positions("Grid") == before
    yield from press("ctrl+shift+z")
    return {
        "kept": kept,
        "written": after != before,
        "undone": undone,
        "redone": positions("Grid") == after,
    }


def undo_by_script() -> Steps:
    """Undo something else by a script during the run."""
    with over():
        bpy.ops.transform.translate(value=(1, 0, 0))
        bpy.ops.ed.undo_push(message="Moved")
    before = positions("Grid")
    yield from start()
    with over():
        bpy.ops.ed.undo()
    yield from let_go()
    written = positions("Grid") != before
    yield from press("ctrl+z")
    return {"written": written, "undone": positions("Grid") == before}


def undo_of_what_was_read() -> Steps:
    """Undo how the mesh was made as it was read: nothing is written."""
    first = positions("Grid")
    with over():
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.mesh.vertices_smooth(factor=0.5, repeat=2)
        bpy.ops.object.mode_set(mode="OBJECT")
        bpy.ops.ed.undo_push(message="Smoothed")
    yield from start()
    with over():
        for _ in range(5):
            if positions("Grid") != first:
                bpy.ops.ed.undo()
    yield from let_go()
    return {"unchanged": positions("Grid") == first}


def object_deleted() -> Steps:
    """Remove the object."""
    yield from start()
    bpy.data.objects.remove(bpy.data.objects["Grid"])
    yield from let_go()
    return {"objects": list(bpy.data.objects.keys())}


def mesh_deleted() -> Steps:
    """Remove the mesh, and the object with it."""
    yield from start()
    bpy.data.meshes.remove(bpy.data.objects["Grid"].data)
    yield from let_go()
    return {"objects": list(bpy.data.objects.keys())}


def mesh_edited() -> Steps:
    """Change the mesh: the run's result is dropped."""
    yield from start()
    mesh = bpy.data.objects["Grid"].data
    flat = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", flat)
    mesh.vertices.foreach_set("co", 1.5 * flat)
    mesh.update()
    changed = positions("Grid")
    yield from let_go()
    return {"unchanged": positions("Grid") == changed}


def mode_changed() -> Steps:
    """Switch to another mode: the result is written in that mode."""
    found = {}
    for mode in ("EDIT", "SCULPT", "VERTEX_PAINT", "WEIGHT_PAINT"):
        begin()
        before = positions("Grid")
        yield from start()
        with over():
            bpy.ops.object.mode_set(mode=mode)
        yield from let_go()
        found[mode] = [bpy.context.object.mode, positions("Grid") != before]
    return {"modes": found}


def scene_changed() -> Steps:
    """Show another scene."""
    before = positions("Grid")
    window = bpy.context.window_manager.windows[0]
    home = window.scene
    yield from start()
    window.scene = other = bpy.data.scenes.new("Other")
    yield from let_go()
    window.scene = home
    bpy.data.scenes.remove(other)
    yield SHORT
    return {"written": positions("Grid") != before}


def workspace_changed() -> Steps:
    """Show another workspace."""
    before = positions("Grid")
    window = bpy.context.window_manager.windows[0]
    home = window.workspace
    yield from start()
    window.workspace = bpy.data.workspaces["Modeling"]
    yield DRAWN
    yield from let_go()
    window.workspace = home
    yield DRAWN
    bpy.ops.object.mode_set(mode="OBJECT")
    return {"written": positions("Grid") != before}


def area_maximized() -> Steps:
    """Maximize the 3D view."""
    before = positions("Grid")
    yield from start()
    with over():
        bpy.ops.screen.screen_full_area()
    yield DRAWN
    yield from let_go()
    with over():
        bpy.ops.screen.back_to_previous()
    yield DRAWN
    return {"written": positions("Grid") != before}


def second_window_closed() -> Steps:
    """Close the window that the run was started in: the run is cancelled."""
    before = positions("Grid")
    with over():
        bpy.ops.wm.window_new()
    yield DRAWN
    other = list(bpy.context.window_manager.windows)[-1]
    place = next(a for a in other.screen.areas if a.type == "VIEW_3D")
    part = next(r for r in place.regions if r.type == "WINDOW")
    held.set()
    with bpy.context.temp_override(window=other, area=place, region=part):
        bpy.ops.shock_filter.sharpen_geometry("INVOKE_DEFAULT", where="everywhere")
    yield SHORT
    with bpy.context.temp_override(window=other):
        bpy.ops.wm.window_close()
    yield SHORT
    cancelled = addon("running.jobs").current() is None
    yield from let_go()
    return {"cancelled": cancelled, "unchanged": positions("Grid") == before}


def filter_fails() -> Steps:
    """Have the filter fail as a bug would make it."""
    before = positions("Grid")
    filters = import_module(f"{MODULE}.core.shape.sharpening")
    good = filters.sharpen_geometry

    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("on purpose")

    filters.sharpen_geometry = broken
    yield from start()
    yield from let_go()
    filters.sharpen_geometry = good
    yield from press("Escape")
    return {"unchanged": positions("Grid") == before}


def animation_plays() -> Steps:
    """Play an animation: it goes on during the run."""
    before = positions("Grid")
    with over():
        bpy.ops.screen.animation_play()
    yield from start()
    first = bpy.context.scene.frame_current
    yield DRAWN
    moved = bpy.context.scene.frame_current != first
    yield from let_go()
    with over():
        bpy.ops.screen.animation_cancel()
    return {"played": moved, "written": positions("Grid") != before}


def image_removed_or_scaled() -> Steps:
    """Remove, rename or scale the image that is sharpened into itself."""
    area("VIEW_3D").type = "IMAGE_EDITOR"
    yield DRAWN
    found = {}
    for what in ("removed", "renamed", "scaled"):
        image = scene.add_image("Photo")
        before = pixels(image)
        area("IMAGE_EDITOR").spaces.active.image = image
        yield from start("sharpen_image", "IMAGE_EDITOR", output="REPLACE")
        if what == "removed":
            bpy.data.images.remove(image)
        elif what == "renamed":
            image.name = "Renamed"
        else:
            image.scale(128, 128)
            before = pixels(image)
        yield from let_go()
        found[what] = "gone" if what == "removed" else pixels(image) != before
        for rest in list(bpy.data.images):
            bpy.data.images.remove(rest)
    area("IMAGE_EDITOR").type = "VIEW_3D"
    yield DRAWN
    return found


def extension_disabled() -> Steps:
    """Disable the extension, enable it again, and run."""
    before = positions("Grid")
    yield from start()
    addon_utils.disable(MODULE)
    yield SHORT
    unchanged = positions("Grid") == before
    addon_utils.enable(MODULE)
    yield DRAWN
    yield from start()
    yield from let_go()
    return {"unchanged": unchanged, "works_again": positions("Grid") != before}


def extension_disabled_and_enabled_at_once() -> Steps:
    """Do so between two events, and start at once: refused or run, but no crash."""
    before = positions("Grid")
    yield from start()
    addon_utils.disable(MODULE)
    addon_utils.enable(MODULE)
    run("sharpen_geometry", where="everywhere")
    yield DRAWN
    yield from let_go()
    if positions("Grid") == before:
        yield from start()
        yield from let_go()
    return {"works_again": positions("Grid") != before}


def rendering() -> Steps:
    """Render with Cycles: nothing is written while it reads the scene."""
    before = positions("Grid")
    settings = bpy.context.scene
    settings.render.engine = "CYCLES"
    settings.cycles.samples = 1024
    settings.render.resolution_x = settings.render.resolution_y = 256
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location.z = 6
    bpy.context.collection.objects.link(camera)
    settings.camera = camera
    yield from start()
    with over():
        bpy.ops.render.render("INVOKE_DEFAULT")
    rendered = yield from render_begins()
    held.clear()
    early = False
    while bpy.app.is_job_running("RENDER"):
        early |= positions("Grid") != before
        yield 0.1
    yield from finished()
    for window in list(bpy.context.window_manager.windows)[1:]:
        with bpy.context.temp_override(window=window):
            bpy.ops.wm.window_close()
    yield SHORT
    return {"rendered": rendered, "early": early, "written": positions("Grid") != before}


def render_begins() -> Steps:
    """Wait for it; the generator returns whether it has begun."""
    for _ in range(100):
        if bpy.app.is_job_running("RENDER"):
            return True
        yield 0.05
    return False


def file_opened() -> Steps:
    """Open and revert a file, with its windows and without."""
    path = str(Path(tempfile.gettempdir()) / "interrupted.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    before = positions("Grid")
    for keywords in ({"load_ui": True}, {"load_ui": False}):
        yield from start()
        bpy.ops.wm.open_mainfile(filepath=path, **keywords)
        yield DRAWN
        yield from let_go()
    yield from start()
    bpy.ops.wm.revert_mainfile()
    yield DRAWN
    yield from let_go()
    return {"unchanged": positions("Grid") == before}


def new_file() -> Steps:
    """Start a new file."""
    yield from start()
    bpy.ops.wm.read_homefile(app_template="")
    yield DRAWN
    yield from let_go()
    return {"objects": sorted(bpy.data.objects.keys())}


MISCHIEF = [
    undo_and_redo_keys,
    undo_by_script,
    undo_of_what_was_read,
    object_deleted,
    mesh_deleted,
    mesh_edited,
    mode_changed,
    scene_changed,
    workspace_changed,
    area_maximized,
    second_window_closed,
    filter_fails,
    animation_plays,
    image_removed_or_scaled,
    extension_disabled,
    extension_disabled_and_enabled_at_once,
    rendering,
    file_opened,
    new_file,
]
