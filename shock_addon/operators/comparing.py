# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator Before / After: look at what was there before the last run, and at its result."""

from __future__ import annotations

import sys

import bpy
from bpy.app.translations import pgettext_rpt

from .. import data
from ..data.skipped import Refused, Skipped
from .base import can_run

_SAID = {
    "before": "Before the run; press again for the result. The file is saved as shown.",
    "after": "After the run.",
}


class SHOCK_FILTER_OT_before_after(bpy.types.Operator):
    """Swap the last run's result with what was there before, bit for bit; again brings it back"""

    bl_idname = "shock_filter.before_after"
    bl_label = "Before / After"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Want a run that has changed something of what is chosen."""
        return can_run(cls, "" if is_held(context) else "Run a filter first, on what is chosen.")

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Swap both, and say what is there now."""
        try:
            state = data.replaced.swap(context)
        except Refused as reason:
            self.report({"ERROR"}, str(reason))
            return {"CANCELLED"}
        except Skipped as reason:
            text = pgettext_rpt("Nothing was swapped: {reason}.")
            self.report({"ERROR"}, text.format(reason=reason))
            return {"CANCELLED"}
        self.report({"INFO"}, _SAID[state])
        return {"FINISHED"}


def is_held(context: bpy.types.Context) -> bool:
    """Whether the last run has replaced something of what is chosen now."""
    return _is_loaded() and data.replaced.is_held(context)


def note(context: bpy.types.Context) -> str:
    """Say that what is seen is not the result; empty if it is, or if it is something else."""
    is_before = is_held(context) and data.replaced.is_before()
    return _SAID[data.replaced.BEFORE] if is_before else ""


def look_again(step: int) -> None:
    """Look at the data again, after undo (-1) and redo (1)."""
    if _is_loaded():
        data.replaced.look_again(step)


def _is_loaded() -> bool:
    # Panels ask before any run, which imports numpy.
    return f"{data.__name__}.replaced" in sys.modules


CLASSES = (SHOCK_FILTER_OT_before_after,)
