# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators Sharpen Texture and Dilate Texture."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt

from ..core.settings import DilateSettings, TextureSettings
from . import obstacles
from .data import image_data
from .data.image_data import edited_image
from .data.mesh_data import mesh_objects
from .data.texture_data import EVERYWHERE, TextureTarget, assign, read_texture, shown_image
from .filters.recolored import Recolored, recolored
from .filters.texturing import Retextured, dilate_texture, sharpen_texture
from .operators import (
    Filter,
    SharpenOperator,
    can_run,
    counted,
    describe_colors,
    write_results,
)
from .properties import DilateProperties, TextureProperties, texture_image
from .skipped import Skipped, sentences

_OF_ONE_RUN = {
    "image": texture_image({"SKIP_SAVE"}),
    "result": bpy.props.StringProperty(
        name="Result",
        description="Image that an earlier run has written, which redo writes again",
        options={"HIDDEN", "SKIP_SAVE"},
    ),
}


class _TextureOperator(SharpenOperator):
    """Mixin for operators on an image and the faces that show it.

    Attributes
    ----------
    filter_surface : callable
        ``filter_surface(surface, settings, progress)``, run on any thread.
    done : str
        What was done to the texture, for the summary and, in lower case, new names.
    """

    mode = "texture"
    filter_surface: Callable[..., Retextured]
    done: str

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Want meshes with UV maps, an image, and no other run."""
        return can_run(cls, obstacles.of_textures(context))

    def where(self) -> Any:
        """Return what masks are read from."""
        return self

    def read(self, context: bpy.types.Context) -> tuple[list[Any], list[str]]:
        """Read the image, and the faces of all objects that show it."""
        image = bpy.data.images.get(self.image) if self.image else None
        if self.image and image is None:
            return [], [f"There is no image named {self.image!r}; name one of the file's images."]
        if image is None:
            try:
                image = shown_image(context)
            except Skipped as reason:
                name = mesh_objects(context)[0].name
                return [], [f"No texture was found for {name}: {reason}."]
        if self.result == image.name:
            image_data.restore(image)
        try:
            target, skipped = read_texture(context, image, self.where(), self.gutter + 1)
        except Skipped as reason:
            return [], sentences([(image.name, str(reason))])
        self.image = image.name  # redo must not take the result, which is shown by then
        return [target], skipped

    def filter(self, settings: Any) -> Filter:
        """Filter one texture."""
        function = type(self).filter_surface
        return lambda surface, progress: function(surface, settings, progress)

    def write(self, context: bpy.types.Context, results: list[Any]) -> tuple[list, list[str]]:
        """Write the image, and show it in the materials and the Image Editor."""
        written, skipped = write_results(self.targets, results, self._write)
        for image, _ in written:
            self.result = image.name
            if edited_image(context) is not None:
                context.space_data.image = image
        return written, skipped

    def _write(self, target: TextureTarget, result: Retextured) -> bpy.types.Image:
        source = image_data.find(target)
        self._notes = [*target.notes, *result.notes]
        self._parts = _parts(target, result.recolored)
        new = {number: part.colors for number, part in self._parts.items()}
        if self.output == "REPLACE":
            if result.recolored.changed:
                image_data.overwrite(source, target.parts, new)
            return source
        name = f"{source.name} {self.done.lower()}"
        image = image_data.add_or_reuse(source, name, self.result, new)
        if self.assign:
            self._notes += assign(target, source, image)
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

    def changes(self, parts: list[Recolored]) -> str:
        """Say how much has changed."""
        return describe_colors(parts, "pixels")

    def notes(self, written: list[tuple]) -> str:
        """Say what is unusual about the UV map."""
        return " ".join(self._notes)


def _parts(target: TextureTarget, result: Recolored) -> dict[int, Recolored]:
    """Compare each tile with what it was."""
    if target.mosaic is None:
        return {image_data.UNTILED: result}
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
    filter_surface = staticmethod(sharpen_texture)
    done = "Sharpened"


class SHOCK_FILTER_OT_dilate_texture(_TextureOperator, DilateProperties, bpy.types.Operator):
    """Fill the texture around its charts with what lies across the UV seams, so that none shows"""

    bl_idname = "shock_filter.dilate_texture"
    bl_label = "Dilate Texture"
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    __annotations__ = {**DilateProperties.__annotations__, **_OF_ONE_RUN}

    settings_type = DilateSettings
    filter_surface = staticmethod(dilate_texture)
    done = "Dilated"

    def where(self) -> Any:
        """Dilate around all faces."""
        return EVERYWHERE

    def changes(self, parts: list[Recolored]) -> str:
        """Say how much was filled."""
        return pgettext_rpt("filled {filled:,} of {total:,} pixels").format(
            filled=sum(part.changed for part in parts),
            total=sum(part.colors[..., 0].size for part in parts),
        )


CLASSES = (SHOCK_FILTER_OT_sharpen_texture, SHOCK_FILTER_OT_dilate_texture)
