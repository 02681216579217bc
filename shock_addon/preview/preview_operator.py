# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator Preview: try settings by mouse, seen at once on the active object."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from bpy.app.handlers import persistent
from bpy.app.translations import pgettext_iface as iface_

from ...core.errors import InvalidMesh
from .. import jobs, obstacles
from ..data.active_object import read_active
from ..data.mesh_data import Target, find, mesh_objects
from ..filters.denoising import PaintedSurface
from ..operators import can_run
from ..properties import NAMES
from ..skipped import Skipped
from .preview_patch import Patch, patch_around, seen_vertex, whole_surface
from .previewing import Preview, kind_of, parameters_of

_INTERVAL = 0.03
_FINE = 0.1
_PASSED_ON = {
    "MIDDLEMOUSE",
    "TRACKPADPAN",
    "TRACKPADZOOM",
    "NDOF_MOTION",
    "WINDOW_DEACTIVATE",
}
_CANCELS = {"ESC", "RIGHTMOUSE"}
_APPLIES = {"RET", "NUMPAD_ENTER", "LEFTMOUSE"}

_running: list[SHOCK_FILTER_OT_preview] = []


class SHOCK_FILTER_OT_preview(bpy.types.Operator):
    """Try settings on the active object, seen at once."""

    bl_idname = "shock_filter.preview"
    bl_label = "Preview"
    bl_description = (
        "Try settings on the active object, seen at once: move the mouse to the right for more"
        " Time, turn the wheel for the second setting, hold Shift for small steps. Click or Enter"
        " applies them to what is selected, right click or Esc leaves everything as it was. Of"
        " large meshes a patch is computed, around what the mouse or the view points at"
    )
    bl_options = {"BLOCKING", "GRAB_CURSOR_X"}

    mode: bpy.props.EnumProperty(
        name="Mode",
        description="What to preview",
        items=[
            ("geometry", "Geometry", "Sharpen Geometry"),
            ("colors", "Colors", "Sharpen Colors"),
            ("denoise", "Denoise", "Denoise"),
        ],
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Want an active mesh object in Object Mode, and no run."""
        obstacle = obstacles.of_meshes(context)
        if not obstacle and context.mode != "OBJECT":
            obstacle = "Switch to Object Mode to preview."
        if not obstacle and context.object not in mesh_objects(context):
            obstacle = "Make one of the selected mesh objects the active one."
        if not obstacle and (jobs.is_settling() or jobs.is_scene_read()):
            obstacle = "Wait until the render, or the last run, has ended."
        if _running:
            obstacle = "A preview is under way; click to apply it, or press Esc."
        return can_run(cls, obstacle)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Refuse: without a mouse there is nothing to try."""
        self.report({"ERROR"}, "Preview needs a window; run the filter itself instead.")
        return {"CANCELLED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Read the object and begin."""
        if bpy.app.background or context.window is None:
            return self.execute(context)
        parameters = parameters_of(context, self.mode)
        self._kind = kind_of(self.mode, parameters)
        targets, skipped = read_active(context, self._kind.read, parameters)
        if not targets:
            self.report({"ERROR"}, " ".join(skipped))
            return {"CANCELLED"}
        try:
            patch = _patch(context, event, targets[0], self._kind.patch)
        except InvalidMesh as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self._preview = Preview(self._kind, parameters, targets[0], patch)
        self._ended, self._text = False, ""
        manager = context.window_manager
        self._timer = manager.event_timer_add(_INTERVAL, window=context.window)
        manager.modal_handler_add(self)
        _running.append(self)
        self._show_text(context)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Follow the mouse; apply or drop what is tried."""
        if self._ended:
            return {"CANCELLED"}
        if not self._preview.alive():
            return self._dropped("Preview ended: the object was removed or left Object Mode.")
        if event.type in _CANCELS and event.value == "PRESS":
            return self._dropped("Preview cancelled; nothing was changed.")
        if event.type in _APPLIES and event.value == "PRESS":
            return self._apply(context)
        if event.type == "TIMER":
            return self._tick(context)
        return self._turn(context, event)

    def cancel(self, context: bpy.types.Context) -> None:
        """Bring everything back; Blender calls this when a window closes or a file is loaded."""
        self.end()

    def end(self) -> None:
        """Bring everything back and let go of the window."""
        if self._ended:
            return
        self._ended = True
        _running.remove(self)
        bpy.context.window_manager.event_timer_remove(self._timer)
        for window in bpy.context.window_manager.windows:
            window.workspace.status_text_set(None)
            for area in window.screen.areas:
                if area.type == "VIEW_3D":
                    area.header_text_set(None)
        self._preview.end()

    def _turn(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        pace = _FINE if event.shift else 1.0
        if event.type == "MOUSEMOVE":
            self._preview.drag(pace * (event.mouse_x - event.mouse_prev_x))
        elif event.type in {"WHEELUPMOUSE", "WHEELDOWNMOUSE"}:
            self._preview.roll(pace if event.type == "WHEELUPMOUSE" else -pace)
        else:
            return {"PASS_THROUGH"} if event.type in _PASSED_ON else {"RUNNING_MODAL"}
        self._show_text(context)
        return {"RUNNING_MODAL"}

    def _tick(self, context: bpy.types.Context) -> set[str]:
        sound = False
        try:
            self._preview.tick()
            sound = True
        except Skipped as reason:
            return self._dropped(f"Preview ended: {reason}.")
        finally:
            if not sound:
                self.end()
        self._show_text(context)
        return {"RUNNING_MODAL"}

    def _dropped(self, text: str) -> set[str]:
        self.end()
        self.report({"INFO"}, text)
        return {"CANCELLED"}

    def _apply(self, context: bpy.types.Context) -> set[str]:
        self.end()
        parameters = self._preview.parameters
        settings = getattr(context.scene.shock_filter, self.mode)
        for name in (self._kind.time, self._kind.second, "steady_state"):
            if hasattr(parameters, name):
                setattr(settings, name, getattr(parameters, name))
        operator = getattr(bpy.ops.shock_filter, self._kind.operator)
        chosen = {name: getattr(settings, name) for name in NAMES[self.mode]}
        try:
            operator("INVOKE_DEFAULT", **chosen)
        except RuntimeError as error:  # what the operator has reported
            self.report({"ERROR"}, str(error).strip().removeprefix("Error: "))
            return {"CANCELLED"}
        return {"FINISHED"}

    def _show_text(self, context: bpy.types.Context) -> None:
        text = self._preview.text()
        if text == self._text:  # drawing can be slow
            return
        self._text = text
        if context.area is not None:
            context.area.header_text_set(text)
        keys = iface_("Shift: small steps | Enter or Click: apply | Esc or Right Click: cancel")
        context.workspace.status_text_set(f"{text} | {keys}")


def _patch(context: bpy.types.Context, event: bpy.types.Event, target: Target, size: int) -> Patch:
    surface = target.surface
    if surface.size <= 3 * size:
        return whole_surface(surface)
    shape = surface.shape if isinstance(surface, PaintedSurface) else surface
    vertex = _pointed_at(context, event, find(target), shape.positions)
    return patch_around(surface, vertex, size)


def _pointed_at(
    context: bpy.types.Context, event: bpy.types.Event, obj: bpy.types.Object, positions: Any
) -> int:
    # The vertex under the mouse, or in the middle of the view if the mouse is on a panel.
    if context.area is None or context.area.type != "VIEW_3D":
        return 0
    view = next(region for region in context.area.regions if region.type == "WINDOW")
    mouse = view.width / 2, view.height / 2
    if context.region is not None and context.region.type == "WINDOW":
        mouse = event.mouse_x - view.x, event.mouse_y - view.y
    to_clip = context.space_data.region_3d.perspective_matrix @ obj.matrix_world
    return seen_vertex(positions, np.array(to_clip), (view.width, view.height), mouse)


@persistent
def _stop(*_: object) -> None:
    stop()


def stop() -> None:
    """End the preview, if one is under way, and bring everything back."""
    for operator in list(_running):
        operator.end()


def register() -> None:
    """End previews before anything reads or replaces what they show."""
    for handlers in _handlers():
        handlers.append(_stop)


def unregister() -> None:
    """End the preview, and do not listen any more."""
    if _running:
        jobs.settle(bpy.context.window_manager)
    stop()
    for handlers in _handlers():
        handlers.remove(_stop)


def _handlers() -> list[list]:
    handlers = bpy.app.handlers
    return [handlers.load_pre, handlers.save_pre, handlers.undo_pre, handlers.redo_pre]


CLASSES = (SHOCK_FILTER_OT_preview,)
