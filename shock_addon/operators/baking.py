# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator Bake Maps."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt

from .. import data
from ..data.skipped import Skipped, sentences
from ..kinds import Data
from ..modes import Mode, find
from . import poll as obstacles
from .base import Done, FilterOperator, Task, Written, counted, write_results

_SIZES = [(str(1 << n), f"{1 << n}", f"{1 << n} x {1 << n} pixels") for n in range(8, 14)]


class SHOCK_FILTER_OT_bake_maps(FilterOperator, bpy.types.Operator):
    """Bake several maps of the shape in one run."""

    bl_idname = "shock_filter.bake_maps"
    bl_label = "Bake Maps"
    bl_description = (
        "Bake maps of the shape in one run: curvature, occlusion, thickness; with Selected to"
        " Active those of detailed objects onto the active one, also normals and height"
    )
    bl_options = {"REGISTER", "UNDO"}

    obstacle = staticmethod(obstacles.of_unwrapped)

    from_selected: bpy.props.BoolProperty(
        name="Selected to Active",
        description="Bake the shape of the other selected objects onto the active one",
    )
    maps: bpy.props.EnumProperty(
        name="Maps",
        description="What is baked; several with Shift",
        items=[
            ("normals", "Normals", "Tangent-space normals of the detailed objects"),
            ("displacement", "Height", "How far the detailed objects are above the active one"),
            ("curvature", "Curvature", "How the surface bends; flat is middle gray"),
            ("occlusion", "Occlusion", "How much of the sky each place sees"),
            ("bent_normals", "Bent Normals", "From where each place sees the sky"),
            ("thickness", "Thickness", "How thick the body is behind each place"),
            ("colors", "Colors", "The active colors of the detailed objects"),
        ],
        options={"ENUM_FLAG"},
        default={"normals", "displacement", "curvature", "occlusion", "thickness", "colors"},
    )
    image_size: bpy.props.EnumProperty(
        name="Size", description="Width and height of the images", items=_SIZES, default="1024"
    )
    depth: bpy.props.EnumProperty(
        name="Depth",
        description="What the images hold",
        items=[
            ("FLOAT", "Floats", "Exact numbers"),
            ("BYTE", "8 Bits", "Small files, with dither against bands"),
        ],
        default="FLOAT",
    )
    cage: bpy.props.FloatProperty(
        name="Cage",
        description="How far from the active object the detailed ones are looked for. 0 takes 5"
        " percent of the size",
        subtype="DISTANCE",
        min=0.0,
    )
    rays: bpy.props.IntProperty(
        name="Rays",
        description="How many rays leave each texel. 16 is quick, 1024 exact",
        default=64,
        min=2,
        max=65536,
        soft_max=1024,
    )
    occlude: bpy.props.BoolProperty(
        name="Others Occlude",
        description="Other visible objects stand in the way of occlusion, too",
        default=True,
    )
    ground: bpy.props.BoolProperty(
        name="Ground", description="There is an endless floor below the lowest point"
    )
    add_node: bpy.props.BoolProperty(
        name="Add Nodes",
        description="Put the images into the materials; normals and colors are linked",
        default=True,
    )
    result: bpy.props.StringProperty(options={"HIDDEN", "SKIP_SAVE"})

    @property
    def row(self) -> Mode:
        """The mode in whose panel it is."""
        return find("generate")

    def read_settings(self) -> Any:
        """Read the settings of the core."""
        from ...core.settings import BakeSettings

        return BakeSettings(
            look="gray",
            cage=self.cage,
            rays=self.rays,
            ground="below" if self.ground else "none",
        )

    def read(self, context: bpy.types.Context) -> tuple[list[Any], list[str]]:
        """Read the objects."""
        try:
            target, skipped = data.image.baked.read(
                context,
                self.maps,
                int(self.image_size),
                from_selected=self.from_selected,
                occlude=self.occlude,
            )
        except Skipped as reason:
            return [], sentences([(data.chosen.mesh_objects(context)[0].name, str(reason))])
        return [target], skipped

    def task(self, settings: Any) -> Task:
        """Return the computation of all maps."""
        return Task(self.targets, Data("fields", (), _bake), "", settings, False, [])

    def write(self, context: bpy.types.Context, results: list[Any]) -> Done:
        """Write the images, and put them into materials."""
        self._made: dict[str, bpy.types.Image] = {}
        return write_results(self.targets, results, self._write_one)

    def _write_one(self, target: Any, baked: Any) -> bpy.types.Image:
        in_floats = self.depth == "FLOAT"
        made = data.image.baked.write(target, baked.images, self.result, in_floats=in_floats)
        self.result = "\n".join(f"{key}\t{image.name}" for key, image in made.items())
        if self.add_node:
            data.image.baked.show(target.objects, made)
        for image in made.values():
            data.image.linking.note(image)
        data.replaced.hold([])
        self._made = made
        return next(iter(made.values()))

    def counts(self, written: list[Written]) -> tuple[int, int]:
        """Count the texels of the images."""
        size = sum(each.target.surface.size for each in written) * len(self._made)
        return size, size

    def summary(self, written: list[Written], seconds: float) -> str:
        """Name the images."""
        target = written[0].target
        text = pgettext_rpt("Baked {names} of {objects}, {seconds:.1f} s.")
        return text.format(
            names=", ".join(image.name for image in self._made.values()),
            objects=counted(len(target.objects), "1 object", "{:,} objects"),
            seconds=seconds,
        )

    def notes(self, written: list[Written]) -> str:
        """Return remarks on the UV map."""
        return " ".join(written[0].result.notes)

    def draw(self, context: bpy.types.Context) -> None:
        """Show the settings after the run."""
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "from_selected")
        layout.column().prop(self, "maps")
        for name in ("image_size", "depth"):
            layout.prop(self, name)
        if self.from_selected:
            layout.prop(self, "cage")
        for name in ("rays", "occlude", "ground", "add_node"):
            layout.prop(self, name)


def _bake(surface: Any, _: str, settings: Any, weld: bool, progress: Any) -> Any:
    from ...core.host.baking import bake

    return bake(surface, settings, progress)


CLASSES = (SHOCK_FILTER_OT_bake_maps,)
