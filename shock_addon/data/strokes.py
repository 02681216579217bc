# SPDX-License-Identifier: GPL-3.0-or-later
"""A step of undo between strokes and a run.

Blender keeps strokes in steps of their own kind, which hold only what a stroke has changed. Undo of
what comes after one reads nothing, so the result of a run would stay.
"""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

_STROKING = {"SCULPT", "PAINT_VERTEX", "PAINT_TEXTURE"}

_is_at_step = False
"""Whether undo has just led to a step that it reads as a whole, or one was added."""


def keep(context: bpy.types.Context) -> None:
    """Add a step of undo in a mode with strokes, before something else is changed there.

    Adjust Last Operation undoes a run and repeats it in one go, so the first step is enough.
    """
    if context.mode in _STROKING and not _is_at_step:
        bpy.ops.ed.undo_push(message="Keep Strokes")
        note_step()


@persistent
def note_step(*_: object) -> None:
    """Add no step until Blender handles other events; called after undo."""
    global _is_at_step
    if bpy.app.background:  # without timers and without Adjust Last Operation
        return
    _is_at_step = True
    if not bpy.app.timers.is_registered(forget_step):
        bpy.app.timers.register(forget_step, persistent=True)


def forget_step() -> None:
    """Let the next run add a step; called by a timer, which is removed."""
    global _is_at_step
    _is_at_step = False
    if bpy.app.timers.is_registered(forget_step):
        bpy.app.timers.unregister(forget_step)
