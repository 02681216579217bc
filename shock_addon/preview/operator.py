# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator Preview: the mouse changes settings, and the result is shown at once."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import bpy
from bpy.app.handlers import persistent
from bpy.app.translations import pgettext_iface as iface_
from bpy.app.translations import pgettext_rpt

from ...core.errors import ShockError
from .. import data
from ..data.skipped import Refused, Skipped, explain
from ..modes import STEADY_STATE, Mode, find, job_of
from ..operators import poll as obstacles
from ..operators.base import can_run
from ..operators.choosing import mode as mode_shown
from ..running import jobs
from ..running.status import StatusText
from . import painting
from .pointing import editors_of, is_over_view, views_with_textures

if TYPE_CHECKING:
    from .previewing import Preview

_INTERVAL = 0.03
_FINE = 0.1
_REST = 0.25
"""Seconds that the mouse must rest in the view after the button, before its moves count."""
_REST_TICKS = 4
"""Timer ticks that must also pass, as a busy Blender reports moves late."""
_PASSED_ON = {"MIDDLEMOUSE", "TRACKPADPAN", "TRACKPADZOOM", "NDOF_MOTION", "WINDOW_DEACTIVATE"}
_CANCELS = {"ESC", "RIGHTMOUSE"}
_COMPARES = "B"
_APPLIES = {"RET", "NUMPAD_ENTER", "LEFTMOUSE"}


class _Session:
    """A preview under way, with its timer and texts.

    It is separate from its operator, which Blender frees when the operator raises.
    """

    def __init__(
        self, operator: bpy.types.Operator, context: bpy.types.Context, preview: Preview
    ) -> None:
        self.operator, self._preview = operator, preview
        self._status = StatusText()
        self._timer = context.window_manager.event_timer_add(_INTERVAL, window=context.window)
        jobs.previews.append(self)

    @property
    def is_under_way(self) -> bool:
        """Whether it has not ended, and its operator still runs."""
        return self in jobs.previews and not jobs.is_freed(self.operator)

    def show_text(self, context: bpy.types.Context) -> None:
        """Show the values of the dials, and the keys."""
        text = self._preview.text()
        keys = iface_("Shift: small steps | Enter or Click: apply | Esc or Right Click: cancel")
        compare = iface_("B: before / after")
        self._status.show(context, f"{text} | {compare} | {keys}", context.area)

    def end(self) -> None:
        """Restore all data, and remove timer and texts."""
        if self not in jobs.previews:
            return
        jobs.previews.remove(self)
        bpy.context.window_manager.event_timer_remove(self._timer)
        self._status.clear(bpy.context)
        self._preview.end()
        data.live.watching.doubt()


class _PreviewOperator:
    """What both operators have in common."""

    bl_label = "Preview"
    bl_description = (
        "Try settings and see the result on the active object or on the image: move the mouse to"
        " the right for more Amount or Strength, turn the wheel for the second setting, hold"
        " Shift for small steps; B switches between the original and the result. Click or Enter"
        " applies the settings to all that is selected, right click or Esc restores everything."
        " On large meshes and images only a patch is computed, around the mouse or in the middle"
        " of the view"
    )
    bl_options = {"BLOCKING", "GRAB_CURSOR_X"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether there is an active mesh object or an image, and no run."""
        in_images = data.chosen.in_image_editor(context)
        mode = cls.shown_mode(context)
        obstacle = _of_images(context, mode) if in_images else _of_meshes(context, mode)
        if not obstacle and jobs.is_settling():
            obstacle = "Wait until the render, or the last run, has ended."
        if not mode.has_preview:
            obstacle = "This has no preview; press the button above."
        return can_run(cls, obstacle)

    @staticmethod
    def shown_mode(context: bpy.types.Context) -> Mode:
        """Return the mode to try."""
        return _shown_mode(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Report that a preview needs a mouse."""
        self.report({"ERROR"}, "Preview needs a window; run the filter itself instead.")
        return {"CANCELLED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Read the object or image of this area's tab, and start."""
        if bpy.app.background or context.window is None:
            return self.execute(context)
        stop()  # what an operator left that Blender has freed
        self._mode = self.shown_mode(context)
        try:
            self._preview = _begin(context, event, self._mode)
        except (ShockError, Refused) as error:
            self.report({"ERROR"}, explain(error))
            return {"CANCELLED"}
        self._session = _Session(self, context, self._preview)
        self._arrived, self._last_move = is_over_view(context.area, event), math.inf
        self._ticks = 0
        self._session.show_text(context)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Follow the mouse; apply or discard the settings."""
        try:
            return self._step(context, event)
        except Exception:
            self._session.end()  # Blender frees the operator then
            raise

    def _step(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if not self._session.is_under_way:
            return {"CANCELLED"}
        reason = self._preview.stage.lost()
        if reason:
            return self._ended_by(reason)
        if event.type in _CANCELS and event.value == "PRESS":
            self._session.end()
            self.report({"INFO"}, "Preview cancelled; nothing was changed.")
            return {"CANCELLED"}
        if event.type in _APPLIES and event.value == "PRESS":
            return self._apply(context)
        if event.type == _COMPARES and event.value == "PRESS":
            return self._follow(context, self._preview.compare)
        if event.type == "TIMER":
            self._ticks += 1
            rested = time.perf_counter() - self._last_move > _REST
            self._arrived |= rested and self._ticks >= _REST_TICKS
            return self._follow(context, self._preview.tick)
        return self._turn(context, event)

    def cancel(self, context: bpy.types.Context) -> None:
        """Restore all data; Blender calls this when a window closes or a file is loaded."""
        self._session.end()

    def _turn(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        pace = _FINE if event.shift else 1.0
        if event.type == "MOUSEMOVE" and not self._arrived:  # on its way from the button
            over_view = is_over_view(context.area, event)
            self._last_move, self._ticks = time.perf_counter() if over_view else math.inf, 0
        elif event.type == "MOUSEMOVE":
            self._preview.drag(pace * (event.mouse_x - event.mouse_prev_x))
        elif event.type in {"WHEELUPMOUSE", "WHEELDOWNMOUSE"}:
            self._preview.roll(pace if event.type == "WHEELUPMOUSE" else -pace)
        else:
            return {"PASS_THROUGH"} if event.type in _PASSED_ON else {"RUNNING_MODAL"}
        self._session.show_text(context)
        return {"RUNNING_MODAL"}

    def _follow(self, context: bpy.types.Context, step: Callable[[], None]) -> set[str]:
        """Run an action that changes the view, and update the text."""
        try:
            step()
        except Skipped as reason:
            return self._ended_by(str(reason))
        self._session.show_text(context)
        return {"RUNNING_MODAL"}

    def _ended_by(self, reason: str) -> set[str]:
        self._session.end()
        text = pgettext_rpt("Preview ended: {reason}.").format(reason=pgettext_rpt(reason))
        self.report({"INFO"}, text)
        return {"CANCELLED"}

    def _apply(self, context: bpy.types.Context) -> set[str]:
        self._session.end()
        mode, preview = self._mode, self._preview
        settings = getattr(context.scene.shock_filter, mode.group)
        for name in (preview.dial, preview.second, STEADY_STATE):
            if hasattr(preview.parameters, name):
                setattr(settings, name, getattr(preview.parameters, name))
        operator = getattr(bpy.ops.shock_filter, mode.operator)
        chosen = {name: getattr(settings, name) for name in mode.names}
        try:
            operator("INVOKE_DEFAULT", **{**chosen, **preview.stage.chosen})
        except RuntimeError as error:  # what the operator has reported
            self.report({"ERROR"}, str(error).strip().removeprefix("Error: "))
            return {"CANCELLED"}
        return {"FINISHED"}


def _begin(context: bpy.types.Context, event: bpy.types.Event, mode: Mode) -> Preview:
    # The modules need numpy.
    if mode.data.handled_as == "meshes":
        from . import meshes

        return meshes.begin(context, event, mode)
    if mode.data.handled_as == "fields":
        from . import fields

        return fields.begin(context, event, mode)
    from . import images

    return images.begin(context, event, mode)


class SHOCK_FILTER_OT_preview(_PreviewOperator, bpy.types.Operator):
    """Try settings on the active object or the image, seen at once."""

    bl_idname = "shock_filter.preview"


class SHOCK_FILTER_OT_preview_generated(_PreviewOperator, bpy.types.Operator):
    """Try settings of what is generated, seen at once."""

    bl_idname = "shock_filter.preview_generated"

    @staticmethod
    def shown_mode(context: bpy.types.Context) -> Mode:
        """Return the mode whose panel has the button."""
        return find("generate")


def _shown_mode(context: bpy.types.Context) -> Mode:
    choice = "image_mode" if data.chosen.in_image_editor(context) else "mode"
    chosen = find(getattr(context.scene.shock_filter, choice).lower())
    is_of_tab = job_of(choice, chosen) is not None
    return mode_shown(context, choice) if is_of_tab else chosen


def _of_images(context: bpy.types.Context, mode: Mode) -> str:
    obstacle = obstacles.of_images(context)
    return obstacle or obstacles.of_mode(
        context, mode, getattr(context.scene.shock_filter, mode.group)
    )


def _of_meshes(context: bpy.types.Context, mode: Mode) -> str:
    obstacle = obstacles.of_meshes(context)
    if obstacle:
        return obstacle
    if context.object not in data.chosen.mesh_objects(context):
        return "Make one of the selected mesh objects the active one."
    if mode.data.handled_as == "fields":
        return obstacles.of_unwrapped(context)
    if not mode.data.in_images:
        return ""
    settings = getattr(context.scene.shock_filter, mode.group)
    obstacle = obstacles.of_mode(context, mode, settings)
    if obstacle:
        return obstacle
    image = data.chosen.chosen_image(context, settings.image)
    if any(editors_of(image.session_uid)):
        return ""
    if painting.is_running():
        return "A gain map is painted, and the model shows its result; press Paint Gain to end it."
    if not data.image.stand_in.is_shown(context.object, image):
        return (
            "Open the texture in an Image Editor: the model shows only previews of textures of its"
            " materials that have no UDIM tiles."
        )
    if any(views_with_textures()):
        return ""
    return "Open the texture in an Image Editor, or choose Material Preview: they show the preview."


@persistent
def stop(*_: object) -> None:
    """End the preview, if one is under way, and restore all data."""
    for session in list(jobs.previews):
        session.end()


def unregister() -> None:
    """End the preview, before its operator is unregistered."""
    if jobs.previews:
        jobs.settle(bpy.context.window_manager)
    stop()


CLASSES = (SHOCK_FILTER_OT_preview, SHOCK_FILTER_OT_preview_generated)
