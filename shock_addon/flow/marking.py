# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators Mark Creases, Show Creases, Hide Creases and Crisp Low Poly."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt

from .. import data
from ..data.skipped import Refused
from ..kinds import Data
from ..modes import Mode, find
from ..operators.base import Done, Task, Written, counted, write_results
from ..operators.meshes import MeshOperator, hidden_originals
from ..operators.properties import settings_of
from . import showing as shown
from .operator import SHOCK_FILTER_OT_show_flow

_ANGLE = math.radians(30.0)


class _CreaseOperator(MeshOperator):
    """Base of the operators that find creases with the panel's settings."""

    angle = _ANGLE
    chooses = False

    @property
    def row(self) -> Mode:
        """The mode whose settings count."""
        return find("geometry")

    def read_settings(self) -> Any:
        """Read those of the panel."""
        return settings_of(self.row, self._parameters())

    def reader(self) -> Callable:
        """Return what reads an object."""
        return partial(data.mesh.creases.read_creases, angle=self.angle)

    def task(self, settings: Any) -> Task:
        """Find the creases of `self.targets`, and filter nothing."""
        finding = Data("meshes", (), self.compute())
        return Task(self.targets, finding, "", settings, self._parameters().weld, [])

    def compute(self) -> Callable:
        """Return what is computed for one object; see `Data.filter`."""
        return _find_creases

    def notes(self, written: list[Written]) -> str:
        """Return no notes, since nothing has moved."""
        return ""

    def _parameters(self) -> bpy.types.PropertyGroup:
        return bpy.context.scene.shock_filter.geometry


class SHOCK_FILTER_OT_mark_creases(_CreaseOperator, bpy.types.Operator):
    """Mark creases as sharp, as seams, or make attributes or curves of them."""

    bl_idname = "shock_filter.mark_creases"
    bl_label = "Mark Creases"
    bl_description = (
        "Mark the edges of all creases, those that are sharp and those that sharpening closes,"
        " with the panel's settings. Nothing moves; existing marks stay"
    )
    bl_options = {"REGISTER", "UNDO"}

    output: bpy.props.EnumProperty(
        name="Output",
        description="What is made of the creases",
        items=[
            ("MARKS", "Marks", "Mark their edges"),
            ("ATTRIBUTE", "Attribute", "Write the angle and the number of each line into the edge"
             " attributes crease_angle and crease_line: radians, negative in grooves"),
            ("CURVES", "Curves", "Add a curve object with a spline for each line"),
        ],
        default="MARKS",
    )  # fmt: skip
    marks: bpy.props.EnumProperty(
        name="Marks",
        description="How edges are marked; hold Shift to choose several",
        items=[
            ("SHARP", "Sharp", "Smooth shading breaks there"),
            ("SEAM", "Seam", "Unwrapping cuts there"),
            ("CREASE", "Crease", "Subdivision surfaces stay sharp there: a weight of 1"),
            ("BEVEL", "Bevel Weight", "The Bevel modifier works there: a weight of 1"),
        ],
        options={"ENUM_FLAG"},
        default={"SHARP"},
    )
    angle: bpy.props.FloatProperty(
        name="Angle",
        description="Least angle between both sides of a crease after it is closed; weaker"
        " creases are left out",
        subtype="ANGLE",
        default=_ANGLE,
        min=math.radians(5.0),
        max=math.radians(170.0),
    )

    def read(self, context: bpy.types.Context) -> tuple[list[Any], list[str]]:
        """Read all selected objects."""
        if self.output == "CURVES":
            _check_mode(
                context, "New objects are made in Object Mode; go there, or choose another output."
            )
        return data.mesh.meshes.read_targets(
            context, self._read_one, self._parameters(), writes=self.output != "CURVES"
        )

    def _read_one(self, obj: bpy.types.Object, mode: str, parameters: Any) -> Any:
        if self._makes_sharp():
            data.mesh.creases.check_normals(obj, parameters.custom_normals)
        return self.reader()(obj, mode, parameters)

    def _makes_sharp(self) -> bool:
        return self.output == "MARKS" and "SHARP" in self.marks

    def write(self, context: bpy.types.Context, results: list[Any]) -> Done:
        """Mark them, and return to the current object mode."""
        self._edges = self._lines = 0
        data.replaced.hold([])
        with data.mesh.meshes.object_mode(context):
            return write_results(self.targets, results, self._write_one)

    def _write_one(self, target: Any, found: Any) -> bpy.types.Object:
        obj, mask = data.mesh.creases.find_same(target), target.surface.mask
        crisp = data.mesh.creases.crisp(found)
        self._lines += int(crisp.sum())
        if self.output == "CURVES":
            name = pgettext_rpt("{name} creases").format(name=obj.name)
            data.mesh.creases.add_curves(obj, found, crisp, name)
        elif self.output == "ATTRIBUTE":
            self._edges += data.mesh.creases.write_attributes(obj.data, found, crisp, mask)
        else:
            self._edges += data.mesh.creases.mark(obj.data, found, crisp, mask, self.marks)
            if self._makes_sharp():
                data.mesh.shading.renew_normals(obj, self._parameters().custom_normals, mask)
        return obj

    def counts(self, written: list[Written]) -> tuple[int, int]:
        """Count the edges on creases, and all."""
        return self._edges, sum(len(each.data.data.edges) for each in written)

    def summary(self, written: list[Written], seconds: float) -> str:
        """Count edges and lines."""
        meshes = counted(len(written), "1 mesh", "{:,} meshes")
        text = pgettext_rpt(
            "Made curves of {lines:,} creases of {meshes}, {seconds:.1f} s."
            if self.output == "CURVES"
            else "Marked {edges:,} edges on {lines:,} creases of {meshes}, {seconds:.1f} s."
        )
        return text.format(edges=self._edges, lines=self._lines, meshes=meshes, seconds=seconds)

    def draw(self, context: bpy.types.Context) -> None:
        """Show what is chosen after the run."""
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "output")
        if self.output == "MARKS":
            layout.prop(self, "marks")
        layout.prop(self, "angle")


class SHOCK_FILTER_OT_show_creases(_CreaseOperator, bpy.types.Operator):
    """Show which creases sharpening closes, and which stay."""

    bl_idname = "shock_filter.show_creases"
    bl_label = "Show Creases"
    bl_description = (
        "Draw the creases over the active object in colors: those that sharpening will close,"
        " that stay as fillets, that are too thin, and that are sharp already. The drawing"
        " updates while you change Widest Fillet. The mesh does not change"
    )

    obstacle = staticmethod(SHOCK_FILTER_OT_show_flow.obstacle)

    def read(self, context: bpy.types.Context) -> tuple[list[Any], list[str]]:
        """Read the active object."""
        parameters = self._parameters()
        return data.mesh.meshes.read_active(context, self.reader(), parameters, writes=False)

    def write(self, context: bpy.types.Context, results: list[Any]) -> Done:
        """Start to draw them."""
        with data.mesh.meshes.object_mode(context):
            return write_results(self.targets, results, self._show)

    def _show(self, target: Any, found: Any) -> bpy.types.Object:
        from . import creases

        obj = data.mesh.creases.find_same(target)
        parameters = self._parameters()
        shown.show(obj, creases.CreasesOfMesh(obj, target.surface, parameters, found))
        return obj

    def summary(self, written: list[Written], seconds: float) -> str:
        """Describe the number of lines in each state."""
        from . import creases

        ((_, obj, found),) = written
        return creases.said_of(obj.name, found.lines)

    def tell(self, kind: str, text: str, folded: str = "") -> None:
        """Report, and update the report with the drawing."""
        super().tell(kind, text, folded)
        shown.say(text)


class SHOCK_FILTER_OT_hide_creases(bpy.types.Operator):
    """Stop drawing the creases"""

    bl_idname = "shock_filter.hide_creases"
    bl_label = "Hide Creases"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether creases of any object are shown."""
        return shown.shown_object("creases") is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Stop drawing them."""
        shown.hide()
        return {"FINISHED"}


class SHOCK_FILTER_OT_crisp_low_poly(_CreaseOperator, bpy.types.Operator):
    """Make an object of few triangles between the creases."""

    bl_idname = "shock_filter.crisp_low_poly"
    bl_label = "Crisp Low Poly"
    bl_description = (
        "Sharpen a remeshed part with the panel's settings, and dissolve flat and simply curved"
        " areas between its creases: a clean mesh of few triangles in a new object. Materials"
        " and UVs are kept; the original is hidden"
    )
    bl_options = {"REGISTER", "UNDO"}

    tolerance: bpy.props.FloatProperty(
        name="Tolerance",
        description="How far the surface may move, in mean edge lengths",
        default=0.25,
        min=0.001,
        max=10.0,
        soft_max=1.0,
    )
    turn: bpy.props.FloatProperty(
        name="Turn",
        description="How far faces may turn from those that they replace: smaller values keep"
        " more faces on round surfaces",
        subtype="ANGLE",
        default=math.radians(8.0),
        min=math.radians(0.1),
        max=math.radians(60.0),
    )

    def reader(self) -> Callable:
        """Return what reads an object."""
        return data.mesh.low_poly.read_cut

    def read(self, context: bpy.types.Context) -> tuple[list[Any], list[str]]:
        """Read all selected objects."""
        _check_mode(context, "New objects are made in Object Mode; go there first.")
        is_seen = data.mesh.low_poly.is_seen
        parameters = self._parameters()
        return data.mesh.meshes.read_targets(context, self.reader(), parameters, is_seen=is_seen)

    def compute(self) -> Callable:
        """Return what makes the low poly of one object."""
        return partial(_make_low_poly, self.tolerance, math.degrees(self.turn))

    def write(self, context: bpy.types.Context, results: list[Any]) -> Done:
        """Add the objects."""
        self._made: list[bpy.types.Object] = []
        data.replaced.hold([])
        with data.mesh.meshes.object_mode(context):
            return write_results(self.targets, results, partial(self._add, context))

    def _add(self, context: bpy.types.Context, target: Any, low: Any) -> bpy.types.Object:
        made = data.mesh.low_poly.add_low_poly(target, low, context, self.angle)
        data.live.copies.release(made[0].data)
        self._made += made
        return made[0]

    def counts(self, written: list[Written]) -> tuple[int, int]:
        """Count triangles now and before."""
        return (
            sum(len(each.result.faces) for each in written),
            sum(len(each.target.surface.triangles) for each in written),
        )

    def summary(self, written: list[Written], seconds: float) -> str:
        """Count triangles."""
        now, before = self.counts(written)
        text = pgettext_rpt("Made {names}: {now:,} triangles of {before:,}, {seconds:.1f} s.")
        names = data.skipped.listed([each.name for each in self._made])
        made = text.format(names=names, now=now, before=before, seconds=seconds)
        return f"{made} {hidden_originals(len(self._made))}"

    def draw(self, context: bpy.types.Context) -> None:
        """Show the dials after the run."""
        self.layout.use_property_split = True
        self.layout.prop(self, "tolerance")
        self.layout.prop(self, "turn")


def _check_mode(context: bpy.types.Context, reason: str) -> None:
    # Undo of another mode would not take a new object away.
    if context.mode != "OBJECT":
        raise Refused(reason)


def _find_creases(surface: Any, _: str, settings: Any, weld: bool, progress: Any) -> Any:
    from ...core.host.creases import creases_of

    return creases_of(surface, settings, weld, progress)


def _make_low_poly(
    tolerance: float, turn: float, surface: Any, _: str, settings: Any, weld: bool, progress: Any
) -> Any:
    from ...core.host.low_poly import low_poly_of

    return low_poly_of(surface, settings, weld, tolerance, turn, progress)


CLASSES = (
    SHOCK_FILTER_OT_mark_creases,
    SHOCK_FILTER_OT_crisp_low_poly,
    SHOCK_FILTER_OT_show_creases,
    SHOCK_FILTER_OT_hide_creases,
)
