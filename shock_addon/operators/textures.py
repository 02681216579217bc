# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators Sharpen Texture and Dilate Texture."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt

from ...core import host as filters
from ...core.errors import InvalidSettings
from ...core.settings import DilateSettings, TextureSettings
from .. import data
from ..data.skipped import Skipped
from ..ui import sections
from . import poll as obstacles
from .base import Filter, can_run, counted, describe_colors
from .images import RESULT, OneImageOperator
from .properties import DILATE_NAMES, DilateProperties, TextureProperties, texture_image

_OF_ONE_RUN = {"image": texture_image({"SKIP_SAVE"}), "result": RESULT}


class _TextureOperator(OneImageOperator):
    """Mixin for operators on an image and the faces that show it.

    Attributes
    ----------
    done : str
        What was done to the texture, for the summary and, in lower case, new names.
    """

    mode = "texture"
    done: str

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Want meshes with UV maps, an image, and no other run."""
        return can_run(cls, obstacles.of_textures(context))

    def where(self) -> Any:
        """Return what masks are read from."""
        return self

    def shown(self, context: bpy.types.Context) -> bpy.types.Image:
        """Return the one that is edited, painted on, or in the active object's material."""
        try:
            return data.shown_image(context)
        except Skipped as reason:
            text = "No texture was found for {name}: {reason}."
            name = data.mesh_objects(context)[0].name
            raise InvalidSettings(text, name=name, reason=reason) from reason

    def read_one(self, context: bpy.types.Context, image: bpy.types.Image) -> tuple[Any, list[str]]:
        """Read the image, and the faces of all objects that show it."""
        return data.read_texture(context, image, self.where(), self.gutter + 1)

    def write_one(self, target: data.TextureTarget, result: filters.Retextured) -> bpy.types.Image:
        """Write the image, or a new one that the materials show."""
        source = data.find_image(target)
        self._notes = [*target.notes, *result.notes]
        self._parts = _parts(target, result.recolored)
        new = {number: part.colors for number, part in self._parts.items()}
        if self.output == "REPLACE":
            if result.recolored.changed:
                data.overwrite(source, target.parts, new)
            return source
        image = data.add_or_reuse(source, self.done.lower(), self.result, new)
        if self.assign:
            # Texture Paint Mode looks for the materials' images when it is entered.
            with data.object_mode(bpy.context):
                self._notes += data.assign(target, source, image)
        return image

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
            done=pgettext_rpt(self.done),
            old=self.image,
            objects=counted(len(target.objects), "1 object", "{:,} objects"),
            new=image.name,
            changes=self.changes(list(self._parts.values())),
            seconds=seconds,
        )

    def changes(self, parts: list[filters.Recolored]) -> str:
        """Say how much has changed."""
        return describe_colors(parts, "pixels")

    def notes(self, written: list[tuple]) -> str:
        """Say what is unusual about the UV map."""
        return " ".join(self._notes)


def _parts(target: data.TextureTarget, result: filters.Recolored) -> dict[int, filters.Recolored]:
    """Compare each tile with what it was."""
    from ...core.host.recolored import recolored

    if target.mosaic is None:
        return {data.UNTILED: result}
    levels = target.surface.picture.levels
    return {
        number: recolored(target.parts[number], new, levels)
        for number, new in target.mosaic.cut(result.colors).items()
    }


class SHOCK_FILTER_OT_sharpen_texture(_TextureOperator, TextureProperties, bpy.types.Operator):
    """Turn blurred edges in a texture into sharp ones, on the surface and across UV seams"""

    bl_idname = "shock_filter.sharpen_texture"
    bl_label = "Sharpen Texture"
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    __annotations__ = {**TextureProperties.__annotations__, **_OF_ONE_RUN}

    settings_type = TextureSettings
    done = "Sharpened"

    def filter(self, settings: TextureSettings) -> Filter:
        """Sharpen one texture."""
        return lambda surface, progress: filters.sharpen_texture(surface, settings, progress)


class SHOCK_FILTER_OT_dilate_texture(_TextureOperator, DilateProperties, bpy.types.Operator):
    """Fill the texture around its charts with what lies across the UV seams, so that none shows"""

    bl_idname = "shock_filter.dilate_texture"
    bl_label = "Dilate Texture"
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    __annotations__ = {**DilateProperties.__annotations__, **_OF_ONE_RUN}

    settings_type = DilateSettings
    done = "Dilated"

    def filter(self, settings: DilateSettings) -> Filter:
        """Dilate one texture."""
        return lambda surface, progress: filters.dilate_texture(surface, settings, progress)

    def draw(self, context: bpy.types.Context) -> None:
        """Show all parameters after the run; they are few."""
        column = sections.split(self.layout)
        for name in DILATE_NAMES:
            column.prop(self.properties, name)

    def where(self) -> Any:
        """Dilate around all faces."""
        return data.EVERYWHERE

    def changes(self, parts: list[filters.Recolored]) -> str:
        """Say how much was filled."""
        return pgettext_rpt("filled {filled:,} of {total:,} pixels").format(
            filled=sum(part.changed for part in parts),
            total=sum(part.colors[..., 0].size for part in parts),
        )


CLASSES = (SHOCK_FILTER_OT_sharpen_texture, SHOCK_FILTER_OT_dilate_texture)
