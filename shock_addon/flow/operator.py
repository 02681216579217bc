# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators Show Flow and Hide Flow."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt

from .. import data
from ..modes import Mode, choices, find, load
from ..operators import poll as obstacles
from ..operators.base import Done, Filter, Written
from ..operators.meshes import MeshOperator
from ..operators.properties import settings_of
from . import overlay as flow_overlay


class SHOCK_FILTER_OT_show_flow(MeshOperator, bpy.types.Operator):
    """Show where the filter will pull."""

    bl_idname = "shock_filter.show_flow"
    bl_label = "Show Flow"
    bl_description = (
        "Show where the filter will pull, with the panel's settings: the potential in colors over"
        " the active object, and strokes that point where values go. Both are kept in the mesh's"
        " hidden attributes .shock_potential and .shock_flow, until Hide Flow removes them"
    )
    bl_options = {"UNDO"}

    mode: bpy.props.EnumProperty(
        name="Mode",
        description="Whose flow to show",
        items=[(mode.key, mode.label, mode.flow) for mode in choices() if mode.flow],
    )

    @staticmethod
    def obstacle(context: bpy.types.Context) -> str:
        """Want an active mesh object."""
        obstacle = obstacles.of_meshes(context)
        if not obstacle and (context.object is None or context.object.type != "MESH"):
            return "Make a mesh object the active one."
        return obstacle

    @property
    def row(self) -> Mode:
        """The mode whose flow it is."""
        return find(self.mode)

    def writer(self) -> Callable:
        """Write the mesh's attributes."""
        return data.flow.write_flow

    def read_settings(self) -> Any:
        """Read those of the panel."""
        return settings_of(self.row, self._parameters())

    def read(self, context: bpy.types.Context) -> tuple[list[Any], list[str]]:
        """Read the active object."""
        return data.meshes.read_active(context, self.reader(), self._parameters())

    def filter(self, settings: Any) -> Filter:
        """Compute one object's flow."""
        flow, weld = self.row.data.flow, self._parameters().weld
        return lambda surface, progress: load(flow)(surface, settings, weld, progress)

    def write(self, context: bpy.types.Context, results: list[Any]) -> Done:
        """Write the attributes, and draw them from now on."""
        written, skipped = super().write(context, results)
        for _, obj, _ in written:
            _end_showing(but=obj)
            flow_overlay.show(obj)
        return written, skipped

    def summary(self, written: list[Written], seconds: float) -> str:
        """Name the attributes."""
        (_, obj, _), *_ = written
        return pgettext_rpt("Wrote {potential} and {flow} to {name}, {seconds:.1f} s.").format(
            potential=data.flow.POTENTIAL, flow=data.flow.FLOW, name=obj.name, seconds=seconds
        )

    def notes(self, written: list[Written]) -> str:
        """Leave it at that: nothing has moved."""
        return ""

    def _parameters(self) -> bpy.types.PropertyGroup:
        return getattr(bpy.context.scene.shock_filter, self.mode)


class SHOCK_FILTER_OT_hide_flow(bpy.types.Operator):
    """Hide the flow, and remove the attributes that hold it"""

    bl_idname = "shock_filter.hide_flow"
    bl_label = "Hide Flow"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Want a flow that is shown, on whatever object."""
        return flow_overlay.shown_object() is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Draw it no more."""
        _end_showing()
        return {"FINISHED"}


def _end_showing(but: bpy.types.Object | None = None) -> None:
    """Hide what is shown, and remove it from its mesh, unless it is that of the given object."""
    shown = bpy.data.objects.get(flow_overlay.shown_object() or "")
    flow_overlay.hide()
    if shown is not None and shown.type == "MESH" and (but is None or shown.data != but.data):
        data.flow.remove_flow(shown.data)


CLASSES = (SHOCK_FILTER_OT_show_flow, SHOCK_FILTER_OT_hide_flow)
