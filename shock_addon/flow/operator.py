# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators Show Flow and Hide Flow."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt

from ...core import host as filters
from ...core.settings import GeometrySettings, ShockSettings
from .. import data
from ..operators.base import Filter, MeshOperator, Steps
from ..operators.properties import settings_from
from . import overlay as flow_overlay

_SETTINGS = {"geometry": GeometrySettings, "colors": ShockSettings}


class SHOCK_FILTER_OT_show_flow(MeshOperator, bpy.types.Operator):
    """Show where the filter will pull."""

    bl_idname = "shock_filter.show_flow"
    bl_label = "Show Flow"
    bl_description = (
        "Show where the filter will pull, with the panel's settings: the potential in colors over"
        " the active object, and strokes that point where values go. Both are kept in the mesh's"
        " attributes shock_potential and shock_flow"
    )
    bl_options = {"UNDO"}

    mode: bpy.props.EnumProperty(
        name="Mode",
        description="Whose flow to show",
        items=[
            ("geometry", "Geometry", "Where normals are pulled: to the creases"),
            ("colors", "Colors", "Where colors are pulled: to the edges between them"),
        ],
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Want an active mesh object and no other run."""
        if not super().poll(context):
            return False
        if context.object is None or context.object.type != "MESH":
            cls.poll_message_set("Make a mesh object the active one.")
            return False
        return True

    def steps(self) -> Steps:
        """Compute the mode's flow."""
        from ..data.flow import write_flow

        if self.mode == "geometry":
            return Steps(data.read_geometry, filters.flow_of_shape, write_flow)
        return Steps(data.read_colors, filters.flow_of_colors, write_flow)

    def read_settings(self) -> Any:
        """Read those of the panel."""
        return settings_from(_SETTINGS[self.mode], self._parameters())

    def read(self, context: bpy.types.Context) -> tuple[list[Any], list[str]]:
        """Read the active object."""
        return data.read_active(context, self.steps().read, self._parameters())

    def filter(self, settings: Any) -> Filter:
        """Compute one object's flow."""
        function, weld = self.steps().filter, self._parameters().weld
        return lambda surface, progress: function(surface, settings, weld, progress)

    def write(self, context: bpy.types.Context, results: list[Any]) -> tuple[list, list[str]]:
        """Write the attributes, and draw them from now on."""
        written, skipped = super().write(context, results)
        for obj, _ in written:
            flow_overlay.show(obj)
        return written, skipped

    def summary(self, written: list[tuple], seconds: float) -> str:
        """Name the attributes."""
        from ..data.flow import FLOW, POTENTIAL

        (obj, _), *_ = written
        return pgettext_rpt("Wrote {potential} and {flow} to {name}, {seconds:.1f} s.").format(
            potential=POTENTIAL, flow=FLOW, name=obj.name, seconds=seconds
        )

    def _parameters(self) -> bpy.types.PropertyGroup:
        return getattr(bpy.context.scene.shock_filter, self.mode)


class SHOCK_FILTER_OT_hide_flow(bpy.types.Operator):
    """Hide the flow; the mesh keeps it in its attributes shock_potential and shock_flow"""

    bl_idname = "shock_filter.hide_flow"
    bl_label = "Hide Flow"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Want a flow that is shown, on whatever object."""
        return flow_overlay.shown_object() is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Draw it no more."""
        flow_overlay.hide()
        return {"FINISHED"}


CLASSES = (SHOCK_FILTER_OT_show_flow, SHOCK_FILTER_OT_hide_flow)
