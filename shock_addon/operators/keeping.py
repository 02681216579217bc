# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that puts what a run chose into the panel's field."""

from __future__ import annotations

import bpy

from .base import found_by


class SHOCK_FILTER_OT_keep_auto(bpy.types.Operator):
    """Put what the last run chose into the field, so that the next runs have the same"""

    bl_idname = "shock_filter.keep_auto"
    bl_label = "Keep"
    bl_options = {"UNDO", "INTERNAL"}

    mode: bpy.props.StringProperty()
    name: bpy.props.StringProperty()

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Set the value."""
        found = found_by(context, self.mode, self.name)
        if found is None:
            self.report({"ERROR"}, "No run on what is selected has chosen this; run it first.")
            return {"CANCELLED"}
        setattr(getattr(context.scene.shock_filter, self.mode), self.name, found.value)
        return {"FINISHED"}


CLASSES = (SHOCK_FILTER_OT_keep_auto,)
