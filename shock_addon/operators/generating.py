# SPDX-License-Identifier: GPL-3.0-or-later
"""The base of operators that generate an image from the shape of objects."""

from __future__ import annotations

import math
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt

from .. import data
from ..data.skipped import Refused, Skipped, sentences
from . import poll as obstacles
from .base import Done, FilterOperator, Written, counted, write_results


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
            swap = data.replaced.PixelsSwap(image, target.parts, digest)
            data.replaced.hold([swap])
            return image
        kind = pgettext_rpt(self.row.target(self).label)
        name = f"{target.name} {kind}"
        in_floats = self.row.target(self).data.in_floats
        return data.image.fields.add_or_reuse(name, self.result, pixels, in_floats)

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
        return " ".join(dict.fromkeys([*first.target.notes, *self._notes, *first.result.notes]))
