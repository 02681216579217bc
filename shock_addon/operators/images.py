# SPDX-License-Identifier: GPL-3.0-or-later
"""What operators on images do; those on textures are of the same kind."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt

from .. import data
from ..data.skipped import Refused, Skipped, sentences
from . import poll as obstacles
from .base import Done, FilterOperator, Written, describe_colors, write_results


class OneImageOperator(FilterOperator):
    """Mixin for operators that write one image; they have the properties `image` and `result`."""

    def shown(self, context: bpy.types.Context) -> bpy.types.Image:
        """Return the image that is meant where none is named, or raise `Refused`."""
        raise NotImplementedError

    def read_one(self, context: bpy.types.Context, image: bpy.types.Image) -> tuple[Any, list[str]]:
        """Return the target, and reasons for what does not take part; or raise `Skipped`."""
        raise NotImplementedError

    def parts(self, target: Any, result: Any) -> dict[int, Any]:
        """Return the new colors of each part of the image; see `data.images.read_parts`."""
        raise NotImplementedError

    def show(self, target: Any, source: bpy.types.Image, image: bpy.types.Image) -> None:
        """Show a new image where `source` was seen."""

    def read(self, context: bpy.types.Context) -> tuple[list[Any], list[str]]:
        """Read the named image, or the one that is shown."""
        if self.image and self.image not in bpy.data.images:
            text = "There is no image named {name!r}; name one of the file's images."
            raise Refused(text, name=self.image)
        image = bpy.data.images[self.image] if self.image else self.shown(context)
        try:
            if self.result == image.name and not self.options.is_repeat_last:
                data.images.restore(image)  # F9 undoes the run, Shift R adds one
            target, skipped = self.read_one(context, image)
        except Skipped as reason:
            return [], sentences([(image.name, str(reason))])
        self.image = image.name  # redo must not take the result, which is shown by then
        return [target], skipped

    def write(self, context: bpy.types.Context, results: list[Any]) -> Done:
        """Write the image and show it in the Image Editor."""
        written, skipped = write_results(self.targets, results, self._write_one)
        for target, image, _ in written:
            source = data.images.find_image(target)
            data.shown.show(context.space_data, source, image, again=bool(self.result))
            self.result = image.name
            self._hold(target, source, image)
        return written, skipped

    def _write_one(self, target: Any, result: Any) -> bpy.types.Image:
        source = data.images.find_image(target)
        self._parts = self.parts(target, result)
        new = {number: part.colors for number, part in self._parts.items()}
        if self.output == "NEW":
            image = data.images.add_or_reuse(source, self.row.done.lower(), self.result, new)
            self.show(target, source, image)
            for each in (source, image):
                data.images.keep(each)
            return image
        self._digest = b""
        if any(part.changed for part in self._parts.values()):
            self._digest = data.images.overwrite(source, target.parts, new)
        return source

    def _hold(self, target: Any, source: bpy.types.Image, image: bpy.types.Image) -> None:
        if image != source:
            objects = target.objects if getattr(self, "assign", False) else []
            data.replaced.hold([data.replaced.ImageSwap(source, image, objects)])
        elif self._digest:
            data.replaced.hold([data.replaced.PixelsSwap(image, target.parts, self._digest)])
        else:
            data.replaced.forget()

    def counts(self, written: list[Written]) -> tuple[int, int]:
        """Count pixels, of all parts."""
        parts = self._parts.values()
        changed = sum(part.changed for part in parts)
        return changed, sum(part.colors[..., 0].size for part in parts)

    def facts(self, written: list[Written], seconds: float) -> dict[str, Any]:
        """Return what `summary` names."""
        ((_, image, _),) = written
        changes = describe_colors(list(self._parts.values()), "pixels", self.row.advice)
        if self.row.changes:
            changed, total = self.counts(written)
            changes = pgettext_rpt(self.row.changes).format(changed=changed, total=total)
        names = {"old": self.image, "new": image.name}
        return {"done": self.done(), "changes": changes, "seconds": seconds, **names}


class ImageOperator(OneImageOperator):
    """Mixin for operators on one image."""

    obstacle = staticmethod(obstacles.of_images)

    def shown(self, context: bpy.types.Context) -> bpy.types.Image:
        """Return the one in the Image Editor."""
        image = data.chosen.edited_image(context)
        if image is None:
            raise Refused("Open an image in the Image Editor, or name one.")
        return image

    def read_one(self, context: bpy.types.Context, image: bpy.types.Image) -> tuple[Any, list[str]]:
        """Read the image."""
        return data.images.read_image(image), []

    def parts(self, target: Any, result: Any) -> dict[int, Any]:
        """Take all of it."""
        return {data.images.UNTILED: result}

    def summary(self, written: list[Written], seconds: float) -> str:
        """Name the image and count pixels."""
        facts = self.facts(written, seconds)
        text = pgettext_rpt(
            "{done} the image {old}: {changes}, {seconds:.1f} s."
            if facts["new"] == facts["old"]
            else "{done} the image {old} into {new}: {changes}, {seconds:.1f} s."
        )
        return text.format(**facts)
