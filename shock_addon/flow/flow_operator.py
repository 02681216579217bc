# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator Show Flow."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt

from ...core.settings import GeometrySettings, ShockSettings
from ..data.active_object import read_active
from ..data.color_data import read_colors
from ..data.geometry_data import read_geometry
from ..filters.flowing import flow_of_colors, flow_of_shape
from ..operators import Filter, MeshOperator
from ..properties import settings_from
from . import flow_overlay
from .flow_data import FLOW, POTENTIAL, write_flow

_WORK = {
    "geometry": (GeometrySettings, read_geometry, flow_of_shape),
    "colors": (ShockSettings, read_colors, flow_of_colors),
}


class SHOCK_FILTER_OT_show_flow(MeshOperator, bpy.types.Operator):
    """Show where the filter will pull, or hide it again."""

    bl_idname = "shock_filter.show_flow"
    bl_label = "Show Flow"
    bl_description = (
        "Show where the filter will pull, with the panel's settings: the potential in colors over"
        " the active object, and strokes that point where values go. Both are kept in the mesh's"
        " attributes shock_potential and shock_flow. Press again to hide them; the attributes stay"
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

    write_object = staticmethod(write_flow)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Want an active mesh object and no other run."""
        if not super().poll(context):
            return False
        if context.object is None or context.object.type != "MESH":
            cls.poll_message_set("Make a mesh object the active one.")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Hide the flow if it is shown, else compute and show it."""
        return {"CANCELLED"} if _hidden(context) else super().execute(context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Do the same, computing on a thread."""
        return {"CANCELLED"} if _hidden(context) else super().invoke(context, event)

    def read_settings(self) -> Any:
        """Read those of the panel."""
        return settings_from(_WORK[self.mode][0], self._parameters())

    def read(self, context: bpy.types.Context) -> tuple[list[Any], list[str]]:
        """Read the active object."""
        return read_active(context, _WORK[self.mode][1], self._parameters())

    def filter(self, settings: Any) -> Filter:
        """Compute one object's flow."""
        function, weld = _WORK[self.mode][2], self._parameters().weld
        return lambda surface, progress: function(surface, settings, weld, progress)

    def write(self, context: bpy.types.Context, results: list[Any]) -> tuple[list, list[str]]:
        """Write the attributes, and draw them from now on."""
        written, skipped = super().write(context, results)
        for obj, _ in written:
            flow_overlay.show(obj)
        return written, skipped

    def summary(self, written: list[tuple], seconds: float) -> str:
        """Name the attributes."""
        (obj, _), *_ = written
        return pgettext_rpt("Wrote {potential} and {flow} to {name}, {seconds:.1f} s.").format(
            potential=POTENTIAL, flow=FLOW, name=obj.name, seconds=seconds
        )

    def _parameters(self) -> bpy.types.PropertyGroup:
        return getattr(bpy.context.scene.shock_filter, self.mode)


def _hidden(context: bpy.types.Context) -> bool:
    if flow_overlay.shown_object() != context.object.name:
        return False
    flow_overlay.hide()
    return True


CLASSES = (SHOCK_FILTER_OT_show_flow,)
