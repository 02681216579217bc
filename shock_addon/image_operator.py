# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator Sharpen Image."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt

from ..core.settings import ImageSettings
from . import obstacles
from .data import image_data
from .data.image_data import edited_image
from .filters.picture import sharpen_picture
from .filters.recolored import Recolored
from .operators import Filter, SharpenOperator, can_run, describe_colors, write_results
from .properties import ImageProperties
from .skipped import Skipped, sentences


class ImageOperator(SharpenOperator):
    """Mixin for operators on one image; they have the properties `of_one_run`, too.

    Attributes
    ----------
    suffix : str
        What a new image's name ends with.
    """

    suffix: str
    of_one_run = {
        "image": bpy.props.StringProperty(
            name="Image",
            description="Image to work on. Empty takes the one in the Image Editor",
            options={"SKIP_SAVE"},
        ),
        "result": bpy.props.StringProperty(
            name="Result",
            description="Image that an earlier run has written, which redo writes again",
            options={"HIDDEN", "SKIP_SAVE"},
        ),
    }

    def done(self) -> str:
        """Say what was done, in a verb."""
        raise NotImplementedError

    def changes(self, result: Recolored) -> str:
        """Say how much has changed."""
        raise NotImplementedError

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Want an image and no other run."""
        return can_run(cls, obstacles.of_images(context))

    def read(self, context: bpy.types.Context) -> tuple[list[Any], list[str]]:
        """Read the named image, or the one in the Image Editor."""
        named = bpy.data.images.get(self.image)
        image = named if self.image else edited_image(context)
        if image is None:
            missing = f"There is no image named {self.image!r}; name one of the file's images."
            return [], [missing if self.image else "Open an image in the Image Editor."]
        if self.result == image.name:
            image_data.restore(image)
        try:
            target = image_data.read_image(image)
        except Skipped as reason:
            return [], sentences([(image.name, str(reason))])
        self.image = image.name  # redo must not take the result, which the editor shows by then
        return [target], []

    def write(self, context: bpy.types.Context, results: list[Any]) -> tuple[list, list[str]]:
        """Write the image and show it in the Image Editor."""
        written, skipped = write_results(self.targets, results, self._write)
        for image, _ in written:
            self.result = image.name
            if edited_image(context) is not None:
                context.space_data.image = image
        return written, skipped

    def _write(self, target: image_data.ImageTarget, result: Recolored) -> bpy.types.Image:
        source = image_data.find(target)
        new = {image_data.UNTILED: result.colors}
        if self.output == "REPLACE":
            if result.changed:
                image_data.overwrite(source, target.parts, new)
            return source
        return image_data.add_or_reuse(source, f"{source.name} {self.suffix}", self.result, new)

    def summary(self, written: list[tuple], seconds: float) -> str:
        """Name the image and count pixels."""
        ((image, result),) = written
        text = pgettext_rpt(
            "{done} the image {old}: {changes}, {seconds:.1f} s."
            if image.name == self.image
            else "{done} the image {old} into {new}: {changes}, {seconds:.1f} s."
        )
        return text.format(
            done=self.done(),
            old=self.image,
            new=image.name,
            changes=self.changes(result),
            seconds=seconds,
        )


class SHOCK_FILTER_OT_sharpen_image(ImageOperator, ImageProperties, bpy.types.Operator):
    """Turn blurred edges in an image into sharp ones, without halos beside them"""

    bl_idname = "shock_filter.sharpen_image"
    bl_label = "Sharpen Image"
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    __annotations__ = {**ImageProperties.__annotations__, **ImageOperator.of_one_run}

    mode = "image"
    settings_type = ImageSettings
    suffix = "sharpened"

    def filter(self, settings: ImageSettings) -> Filter:
        """Sharpen one image."""
        return lambda picture, progress: sharpen_picture(picture, settings, progress)

    def done(self) -> str:
        """Say what was done."""
        return pgettext_rpt("Sharpened")

    def changes(self, result: Recolored) -> str:
        """Say how much has changed."""
        return describe_colors([result], "pixels")


CLASSES = (SHOCK_FILTER_OT_sharpen_image,)
