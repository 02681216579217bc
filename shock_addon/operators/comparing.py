# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator Before / After, which compares the last result with the data before it."""

from __future__ import annotations

import sys

import bpy
from bpy.app.translations import pgettext_rpt

from .. import data
from ..data.skipped import Refused, Skipped
from .base import can_run

_SAID = {
    "before": "This is the original; press again for the result. The file is saved as shown.",
    "after": "After the run.",
}


class SHOCK_FILTER_OT_before_after(bpy.types.Operator):
    """Switch between the last run's result and the original, bit for bit"""

    bl_idname = "shock_filter.before_after"
    bl_label = "Before / After"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether the last run has changed data of the current selection."""
        return can_run(cls, "" if is_held(context) else "Run a filter first, on what is chosen.")

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Swap the data, and report which of them are shown now."""
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
    """Whether the last run has replaced data of the current selection."""
    return _is_loaded() and data.replaced.is_held(context)


def note(context: bpy.types.Context) -> str:
    """Return a note if the data before the run is shown; empty otherwise."""
    is_before = is_held(context) and data.replaced.is_before()
    return _SAID[data.replaced.BEFORE] if is_before else ""


def look_again(step: int) -> None:
    """Compare the data again, after undo (-1) or redo (1)."""
    if _is_loaded():
        data.replaced.look_again(step)


def _is_loaded() -> bool:
    # Panels ask before any run, which imports numpy.
    return f"{data.__name__}.replaced" in sys.modules


CLASSES = (SHOCK_FILTER_OT_before_after,)
