# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator Paint Gain: paint a gain map on the model, which shows the result live.

The operator is not modal, so that Blender's brushes and panels work as usual.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
from bpy.app.handlers import persistent

from ...core.errors import ShockError
from .. import data
from ..data.skipped import Refused, Skipped, explain
from ..modes import Mode, choices
from ..operators import poll as obstacles
from ..operators.base import can_run
from ..running import jobs

if TYPE_CHECKING:
    from .gain import Painting

_INTERVAL = 0.05
_STAND_IN = ".shock_filter preview"  # as in data.image.stand_in, which needs numpy

_running: list[Painting] = []


class SHOCK_FILTER_OT_paint_gain(bpy.types.Operator):
    """Paint where detail is raised and smoothed, and see the result on the model."""

    bl_idname = "shock_filter.paint_gain"
    bl_label = "Paint Gain"
    bl_description = (
        "Paint where detail is raised, with white, and where it is smoothed, with black; middle"
        " gray keeps it. The model shows the result after each stroke, and while settings are"
        " changed. Makes a gain map if none is chosen. Press again to end"
    )
    bl_options = {"UNDO"}  # else undoing the first stroke would take the map away

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether the active object has a texture, and there is no run."""
        return bool(_running) or can_run(cls, _obstacle(context))

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start painting, or end it."""
        if _running:
            stop()
            return {"FINISHED"}
        from .gain import HINT, Painting

        mode = _mode(context)
        context.scene.shock_filter.mode = mode.key.upper()
        try:
            _running.append(Painting(context, mode))
        except (ShockError, Refused) as error:
            self.report({"ERROR"}, explain(error))
            return {"CANCELLED"}
        except Skipped as reason:
            self.report({"ERROR"}, f"{reason}.")
            return {"CANCELLED"}
        self.report({"INFO"}, HINT)
        if not bpy.app.timers.is_registered(_tick):
            bpy.app.timers.register(_tick, first_interval=_INTERVAL)
        return {"FINISHED"}


def is_running() -> bool:
    """Whether a gain map is being painted."""
    return bool(_running)


@persistent
def stop(*_: object) -> None:
    """End painting, and show the original texture."""
    while _running:
        _running.pop().preview.end()


@persistent
def put_away(*_: object) -> None:
    """Show original textures instead of stand-ins that a file or an undo step holds."""
    if not any(image.name.startswith(_STAND_IN) for image in bpy.data.images):
        return
    if not _running:
        data.image.stand_in.put_away()
    data.image.stand_in.remove_left()


def _tick() -> float | None:
    if not _running:
        return None
    painting = _running[-1]
    try:
        if painting.is_lost():
            stop()
        elif not jobs.is_scene_read():
            painting.tick()
    except BaseException:
        stop()
        raise
    return _INTERVAL if _running else None


def _mode(context: bpy.types.Context) -> Mode:
    chosen = context.scene.shock_filter.mode.lower()
    modes = [mode for mode in choices() if mode.targets[0].row.takes_gain]
    return next((mode for mode in modes if mode.key == chosen), modes[0])


def _obstacle(context: bpy.types.Context) -> str:
    obj = context.object
    if obj is None or obj not in data.chosen.mesh_objects(context):
        return "Make one of the selected mesh objects the active one."
    mode = _mode(context)
    settings = getattr(context.scene.shock_filter, mode.key)
    obstacle = obstacles.of_mode(context, mode, settings)
    if obstacle:
        return obstacle
    image = data.chosen.chosen_image(context, settings.image)
    if not data.image.stand_in.is_shown(obj, image):
        return "Choose a texture of the active object's material that has no UDIM tiles."
    return ""


def unregister() -> None:
    """End painting, before the operator is unregistered."""
    stop()
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)


CLASSES = (SHOCK_FILTER_OT_paint_gain,)
