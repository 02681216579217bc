# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator Sharpen Image."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt

from ...core import host as filters
from ...core.errors import InvalidSettings
from ...core.settings import ImageSettings
from .. import data
from ..data.skipped import Skipped, sentences
from . import poll as obstacles
from .base import Filter, SharpenOperator, can_run, describe_colors, write_results
from .properties import ImageProperties

RESULT = bpy.props.StringProperty(
    name="Result",
    description="Image that an earlier run has written, which redo writes again",
    options={"HIDDEN", "SKIP_SAVE"},
)


class OneImageOperator(SharpenOperator):
    """Mixin for operators that write one image; they have the properties `image` and `result`."""

    def shown(self, context: bpy.types.Context) -> bpy.types.Image:
        """Return the image that is meant where none is named, or raise `InvalidSettings`."""
        raise NotImplementedError

    def read_one(self, context: bpy.types.Context, image: bpy.types.Image) -> tuple[Any, list[str]]:
        """Return the target, and reasons for what does not take part; or raise `Skipped`."""
        raise NotImplementedError

    def write_one(self, target: Any, result: Any) -> bpy.types.Image:
        """Return the image that was written, or raise `Skipped`."""
        raise NotImplementedError

    def read(self, context: bpy.types.Context) -> tuple[list[Any], list[str]]:
        """Read the named image, or the one that is shown."""
        if self.image and self.image not in bpy.data.images:
            text = "There is no image named {name!r}; name one of the file's images."
            raise InvalidSettings(text, name=self.image)
        image = bpy.data.images[self.image] if self.image else self.shown(context)
        try:
            if self.result == image.name and not self.options.is_repeat_last:
                data.restore(image)  # F9 undoes the run, Shift R adds one
            target, skipped = self.read_one(context, image)
        except Skipped as reason:
            return [], sentences([(image.name, str(reason))])
        self.image = image.name  # redo must not take the result, which is shown by then
        return [target], skipped

    def write(self, context: bpy.types.Context, results: list[Any]) -> tuple[list, list[str]]:
        """Write the image and show it in the Image Editor."""
        written, skipped = write_results(self.targets, results, self.write_one)
        for image, _ in written:
            self.result = image.name
            if data.edited_image(context) is not None:
                context.space_data.image = image
        return written, skipped


class ImageOperator(OneImageOperator):
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
        "result": RESULT,
    }

    def done(self) -> str:
        """Say what was done, in a verb."""
        raise NotImplementedError

    def changes(self, result: filters.Recolored) -> str:
        """Say how much has changed."""
        raise NotImplementedError

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Want an image and no other run."""
        return can_run(cls, obstacles.of_images(context))

    def shown(self, context: bpy.types.Context) -> bpy.types.Image:
        """Return the one in the Image Editor."""
        image = data.edited_image(context)
        if image is None:
            raise InvalidSettings("Open an image in the Image Editor, or name one.")
        return image

    def read_one(self, context: bpy.types.Context, image: bpy.types.Image) -> tuple[Any, list[str]]:
        """Read the image."""
        return data.read_image(image), []

    def write_one(self, target: data.ImageTarget, result: filters.Recolored) -> bpy.types.Image:
        """Write the image, or a new one beside it."""
        source = data.find_image(target)
        new = {data.UNTILED: result.colors}
        if self.output == "REPLACE":
            if result.changed:
                data.overwrite(source, target.parts, new)
            return source
        return data.add_or_reuse(source, self.suffix, self.result, new)

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
        return lambda picture, progress: filters.sharpen_picture(picture, settings, progress)

    def done(self) -> str:
        """Say what was done."""
        return pgettext_rpt("Sharpened")

    def changes(self, result: filters.Recolored) -> str:
        """Say how much has changed."""
        return describe_colors([result], "pixels")


CLASSES = (SHOCK_FILTER_OT_sharpen_image,)
