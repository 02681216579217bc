# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators that make images from the shape of objects: the base of Generate, and Bake Maps."""

from __future__ import annotations

import math
from typing import Any

import bpy
from bpy.app.translations import pgettext_iface, pgettext_rpt

from .. import data
from ..data.skipped import Refused, Skipped, explain, sentences
from ..kinds import Data
from ..modes import Mode, find
from . import poll as obstacles
from .base import Done, FilterOperator, Task, Written, counted, write_results

MAPS = "maps"
"""Key of the reports of Bake Maps, which has a panel of its own."""

_SIZES = [(str(1 << n), f"{1 << n}", f"{1 << n} x {1 << n} pixels") for n in range(8, 14)]


class GenerateOperator(FilterOperator):
    """Mixin for operators that make an image; they have the properties `image` and `result`."""

    obstacle = staticmethod(obstacles.of_unwrapped)

    def read(self, context: bpy.types.Context) -> tuple[list[Any], list[str]]:
        """Read the objects, and the image if one is to be replaced."""
        image = bpy.data.images.get(self.image) if self.image else None
        if self.image and image is None:
            text = "There is no image named {name!r}; name one, or leave the field empty."
            raise Refused(text, name=self.image)
        if image is not None and self.result == image.name and not self.options.is_repeat_last:
            data.image.images.restore(image)  # redo undoes the run before
        try:
            places = self.row.target(self).places
            target, skipped = data.image.fields.read_field(context, image, self, places)
        except Skipped as reason:
            name = data.chosen.mesh_objects(context)[0].name
            return [], sentences([(name, str(reason))])
        return [target], skipped

    def write(self, context: bpy.types.Context, results: list[Any]) -> Done:
        """Write the image and add it to materials, or write the attribute."""
        data.image.images.forget_overwritten()
        data.image.images.keep_unsaved(self.targets)
        written, skipped = write_results(self.targets, results, self._write_one)
        self._notes: list[str] = []
        for target, image, _ in written:
            if target.surface.at_vertices:
                continue
            self.result = image.name
            if self.add_node:
                self._notes += data.image.fields.add_nodes(target.objects, image)
            data.image.images.keep(image)
            data.image.linking.note(image)
        return written, skipped

    def _write_one(self, target: Any, result: Any) -> bpy.types.Image:
        if target.surface.at_vertices:
            data.replaced.hold([])
            return data.image.fields.write_attribute(
                target.objects, self.row.target(self).label, result.values
            )
        pixels = data.image.fields.pixels_of(result.values)
        if target.image_uid:
            image = data.image.images.find_image(target)
            digest = data.image.images.overwrite(
                image, target.parts, {data.image.images.UNTILED: pixels}
            )
            swap = data.replaced.PixelsSwap(image, target.parts, digest, target.objects)
            data.replaced.hold([swap])
            return image
        kind = pgettext_rpt(self.row.target(self).label)
        name = f"{target.name} {kind}"
        data.replaced.hold([])
        in_floats = self.row.target(self).data.in_floats
        return data.image.fields.add_or_reuse(name, self.result, pixels, in_floats)

    def scale_of(self, made: Any) -> float:
        """Return 1: the objects were read in the scene's units."""
        return 1.0

    def counts(self, written: list[Written]) -> tuple[int, int]:
        """Count the texels of the image."""
        shown = [each.result.shown for each in written]
        return sum(int(each.sum()) for each in shown), sum(each.size for each in shown)

    def summary(self, written: list[Written], seconds: float) -> str:
        """Name the image and its content."""
        target, made, result = written[0]
        inside = result.values[result.shown]
        text = pgettext_rpt(
            "Generated {name} on {objects}: {size}, values {low:.3g} to {high:.3g}, {seconds:.1f}"
            " s."
        )
        name, size = made.name, "{1} x {0} pixels".format(*target.surface.shape)
        if target.surface.at_vertices:
            name, size = (
                self.row.target(self).label,
                counted(len(inside), "1 vertex", "{:,} vertices"),
            )
        return text.format(
            name=name,
            objects=counted(len(target.objects), "1 object", "{:,} objects"),
            size=size,
            low=float(inside.min(initial=math.inf)),
            high=float(inside.max(initial=-math.inf)),
            seconds=seconds,
        )

    def notes(self, written: list[Written]) -> str:
        """Return remarks on the UV map, and on where the image is shown."""
        first = written[0]
        of_uv = map(explain, first.result.notes)
        return " ".join(dict.fromkeys([*first.target.notes, *self._notes, *of_uv]))


FROM_SELECTED = "shock_filter_selected_to_active"
"""Name of the context pointer by which the button Selected to Active is known."""


class SHOCK_FILTER_OT_bake_maps(FilterOperator, bpy.types.Operator):
    """Bake several maps of the shape in one run."""

    bl_idname = "shock_filter.bake_maps"
    bl_label = "Bake Maps"
    bl_description = (
        "Bake maps of the shape in one run: curvature, occlusion, thickness; with Selected to"
        " Active those of detailed objects onto the active one, also normals and height"
    )
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def description(
        cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties
    ) -> str:
        """Describe which maps a button bakes, and from which objects."""
        return pgettext_rpt(
            "Bake maps of the detailed objects, the others that are selected, onto the active"
            " one: normals, height, curvature, occlusion, thickness, and colors if there are any"
            if properties.from_selected
            else "Bake curvature, occlusion and thickness of all selected mesh objects, which share"
            " the three images. Adjust Last Operation offers other maps"
        )

    @staticmethod
    def obstacle(context: bpy.types.Context) -> str:
        """Return the obstacle; for the button Selected to Active, also that one is selected."""
        found = obstacles.of_unwrapped(context)
        if not found and hasattr(context, FROM_SELECTED):
            is_alone = len(data.chosen.mesh_objects(context)) < 2
            found = (
                "Select the detailed objects, and last the one to bake onto." if is_alone else ""
            )
        return found

    from_selected: bpy.props.BoolProperty(
        name="Selected to Active",
        description="Bake the shape of the other selected objects onto the active one",
    )
    maps: bpy.props.EnumProperty(
        name="Maps",
        description="Which maps are baked; hold Shift to choose several",
        items=[
            ("normals", "Normals", "Tangent-space normals of the detailed objects"),
            ("displacement", "Height", "How far the detailed objects are above the active one"),
            ("curvature", "Curvature", "Curvature of the surface; flat is middle gray"),
            ("occlusion", "Occlusion", "How much of the sky each place sees"),
            ("bent_normals", "Bent Normals", "Mean direction in which each place sees the sky"),
            ("thickness", "Thickness", "Thickness of the body behind each place"),
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
        description="How far from the active object the detailed ones are searched. 0 uses 5"
        " percent of the size",
        subtype="DISTANCE",
        min=0.0,
    )
    rays: bpy.props.IntProperty(
        name="Rays",
        description="Number of rays per texel. 16 is fast, 1024 accurate",
        default=64,
        min=2,
        max=65536,
        soft_max=1024,
    )
    occlude: bpy.props.BoolProperty(
        name="Others Occlude",
        description="Other visible objects also occlude",
        default=True,
    )
    ground: bpy.props.BoolProperty(
        name="Ground", description="There is an infinite floor below the lowest point"
    )
    add_node: bpy.props.BoolProperty(
        name="Add Nodes",
        description="Put the images into the materials; normals and colors are linked",
        default=True,
    )
    result: bpy.props.StringProperty(options={"HIDDEN", "SKIP_SAVE"})

    @property
    def row(self) -> Mode:
        """The mode whose settings it shares."""
        return find("generate")

    @property
    def key(self) -> str:
        """Return the key of its reports."""
        return MAPS

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
        self._lost: list[str] = []
        self._notes: list[str] = []
        written, skipped = write_results(self.targets, results, self._write_one)
        return written, skipped + self._lost

    def _write_one(self, target: Any, baked: Any) -> bpy.types.Image:
        in_floats = self.depth == "FLOAT"
        made = data.image.baked.write(target, baked.images, self.result, in_floats=in_floats)
        self.result = "\n".join(f"{key}\t{image.name}" for key, image in made.items())
        if self.add_node:
            self._lost, self._notes = data.image.baked.show(target, made)
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
        """Name the maps, and the object after which they are named."""
        target = written[0].target
        text = pgettext_rpt("Baked {maps} of {objects}: {names}; {seconds:.1f} s.")
        items = self.properties.bl_rna.properties["maps"].enum_items
        objects = counted(len(target.objects), "1 object", "{:,} objects")
        return text.format(
            maps=counted(len(self._made), "1 map", "{:,} maps"),
            objects=target.name if len(target.objects) == 1 else objects,
            names=", ".join(pgettext_iface(items[key].name) for key in self._made),
            seconds=seconds,
        )

    def is_detail(self, finding: Any) -> bool:
        """Fold the remark on what white means in a map."""
        return "white" in finding.values

    def scale_of(self, made: Any) -> float:
        """Return 1: the objects were read in the scene's units."""
        return 1.0

    def notes(self, written: list[Written]) -> str:
        """Return remarks on the UV map and on materials."""
        return " ".join([*map(explain, written[0].result.notes), *self._notes])

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
    from ...core.host.fields import bake

    return bake(surface, settings, progress)


CLASSES = (SHOCK_FILTER_OT_bake_maps,)
