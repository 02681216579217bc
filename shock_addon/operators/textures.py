# SPDX-License-Identifier: GPL-3.0-or-later
"""What operators on textures do: an image and the faces of all objects that show it."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt

from .. import data
from ..data.skipped import Refused, Skipped
from . import poll as obstacles
from .base import can_run, counted, describe_colors
from .images import OneImageOperator


class TextureOperator(OneImageOperator):
    """Mixin for operators on an image and the faces that show it."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Want meshes with UV maps, an image, and no other run."""
        return can_run(cls, obstacles.of_textures(context))

    def shown(self, context: bpy.types.Context) -> bpy.types.Image:
        """Return the one that is edited, painted on, or in the active object's material."""
        try:
            return data.chosen.shown_image(context)
        except Skipped as reason:
            text = "No texture was found for {name}: {reason}."
            name = data.chosen.mesh_objects(context)[0].name
            raise Refused(text, name=name, reason=reason) from reason

    def read_one(self, context: bpy.types.Context, image: bpy.types.Image) -> tuple[Any, list[str]]:
        """Read the image, and the faces of all objects that show it."""
        return data.textures.read_texture(context, image, self)

    def write_one(self, target: Any, result: Any) -> bpy.types.Image:
        """Write the image, or a new one that the materials show."""
        source = data.images.find_image(target)
        self._notes = [*target.notes, *result.notes]
        self._parts = _parts(target, result.recolored)
        new = {number: part.colors for number, part in self._parts.items()}
        if self.output == "REPLACE":
            if result.recolored.changed:
                data.images.overwrite(source, target.parts, new)
            return source
        image = data.images.add_or_reuse(source, self.row.done.lower(), self.result, new)
        if self.assign:
            # Texture Paint Mode looks for the materials' images when it is entered.
            with data.meshes.object_mode(bpy.context):
                self._notes += data.textures.assign(target, source, image)
        return image

    def counts(self, results: list[Any]) -> tuple[int, int]:
        """Count pixels, of all tiles."""
        parts = self._parts.values()
        changed = sum(part.changed for part in parts)
        return changed, sum(part.colors[..., 0].size for part in parts)

    def summary(self, written: list[tuple], seconds: float) -> str:
        """Name the image and count objects and pixels."""
        ((image, _),) = written
        (target,) = self.targets
        text = pgettext_rpt(
            "{done} the texture {old} on {objects}: {changes}, {seconds:.1f} s."
            if image.name == self.image
            else "{done} the texture {old} on {objects} into {new}: {changes}, {seconds:.1f} s."
        )
        return text.format(
            done=self.done(),
            old=self.image,
            objects=counted(len(target.objects), "1 object", "{:,} objects"),
            new=image.name,
            changes=self.changes(list(self._parts.values())),
            seconds=seconds,
        )

    def changes(self, parts: list[Any]) -> str:
        """Say how much has changed."""
        if not self.row.changes:
            return describe_colors(parts, "pixels", self.row.advice)
        changed, total = self.counts([])
        return pgettext_rpt(self.row.changes).format(changed=changed, total=total)

    def notes(self, written: list[tuple]) -> str:
        """Say what is unusual about the UV map."""
        return " ".join(self._notes)


def _parts(target: Any, result: Any) -> dict[int, Any]:
    """Compare each tile with what it was."""
    from ...core.host.recolored import recolored

    if target.mosaic is None:
        return {data.images.UNTILED: result}
    levels = target.surface.picture.levels
    return {
        number: recolored(target.parts[number], new, levels)
        for number, new in target.mosaic.cut(result.colors).items()
    }
