# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators Show Flow and Hide Flow."""

from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt

from .. import data
from ..kinds import Data
from ..modes import Mode, choices, find
from ..operators import poll as obstacles
from ..operators.base import Done, Task, Written, write_results
from ..operators.meshes import MeshOperator
from ..operators.properties import settings_of
from . import showing as flow_shown


class SHOCK_FILTER_OT_show_flow(MeshOperator, bpy.types.Operator):
    """Show the flow of the filter."""

    bl_idname = "shock_filter.show_flow"
    bl_label = "Show Flow"
    bl_description = (
        "Show the flow of the filter with the panel's settings: the potential in colors over the"
        " active object, and arrows that point to where values flow. The mesh does not change"
    )

    chooses = False

    mode: bpy.props.EnumProperty(
        name="Mode",
        description="Whose flow to show",
        items=[(mode.key, mode.label, mode.flow) for mode in choices() if mode.flow],
    )
    attributes: bpy.props.BoolProperty(
        name="Attributes",
        description="Also write both into the mesh, for Geometry Nodes and scripts: into the"
        " hidden attributes .shock_potential and .shock_flow, which are kept",
    )

    @staticmethod
    def obstacle(context: bpy.types.Context) -> str:
        """Return the obstacle if there is no active mesh object."""
        obstacle = obstacles.of_meshes(context)
        if not obstacle and (context.object is None or context.object.type != "MESH"):
            return "Make a mesh object the active one."
        return obstacle

    @property
    def row(self) -> Mode:
        """The mode whose flow it is."""
        return find(self.mode)

    def read_settings(self) -> Any:
        """Read those of the panel."""
        return settings_of(self.row, self._parameters())

    def read(self, context: bpy.types.Context) -> tuple[list[Any], list[str]]:
        """Read the active object."""
        parameters = self._parameters()
        return data.mesh.meshes.read_active(
            context, self.kind.read, parameters, writes=self.attributes
        )

    def task(self, settings: Any) -> Task:
        """Compute the flow of `self.targets`, and filter nothing."""
        showing = Data(self.kind.handled_as, (), self.kind.flow)
        name, weld = self.row.targets[0].filter, self._parameters().weld
        return Task(self.targets, showing, name, settings, weld, [])

    def write(self, context: bpy.types.Context, results: list[Any]) -> Done:
        """Start to draw the flow, and write it into attributes on request."""
        with data.mesh.meshes.object_mode(context):
            return write_results(self.targets, results, self._show)

    def _show(self, target: Any, result: Any) -> bpy.types.Object:
        obj, found = data.mesh.flow.flow_of(target, result)
        if self.attributes:
            data.mesh.flow.write_flow(obj.data, found)
        flow_shown.show(obj, found)
        return obj

    def summary(self, written: list[Written], seconds: float) -> str:
        """Name the object, and the attributes if they were written."""
        (_, obj, _), *_ = written
        text = pgettext_rpt(
            "Wrote {potential} and {flow} to {name}, {seconds:.1f} s."
            if self.attributes
            else "Computed the flow of {name}, {seconds:.1f} s."
        )
        return text.format(
            potential=data.mesh.flow.POTENTIAL,
            flow=data.mesh.flow.FLOW,
            name=obj.name,
            seconds=seconds,
        )

    def notes(self, written: list[Written]) -> str:
        """Return no notes, since nothing has moved."""
        return ""

    def _parameters(self) -> bpy.types.PropertyGroup:
        return getattr(bpy.context.scene.shock_filter, self.mode)


class SHOCK_FILTER_OT_hide_flow(bpy.types.Operator):
    """Stop drawing the flow"""

    bl_idname = "shock_filter.hide_flow"
    bl_label = "Hide Flow"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether a flow of any object is shown."""
        return flow_shown.shown_object() is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Stop drawing it."""
        flow_shown.hide()
        return {"FINISHED"}


CLASSES = (SHOCK_FILTER_OT_show_flow, SHOCK_FILTER_OT_hide_flow)
