# SPDX-License-Identifier: GPL-3.0-or-later
"""The base classes of operators on images and textures."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt

from ...core.settings import named
from .. import data
from ..data import PICTURES
from ..data.skipped import Refused, Skipped, sentences
from . import poll as obstacles
from .base import Done, FilterOperator, Written, describe_colors, write_results

_NAMING = ("image", "mask_image", "gain_map", *PICTURES)
"""Properties that name images, which may get other names during a run."""


class OneImageOperator(FilterOperator):
    """Mixin for operators that write an image; they have the properties `image` and `result`.

    If several images are written, `result` has their names, one a line.
    """

    def shown(self, context: bpy.types.Context) -> bpy.types.Image:
        """Return the image to use if none is named, or raise `Refused`."""
        raise NotImplementedError

    def read_one(self, context: bpy.types.Context, image: bpy.types.Image) -> tuple[Any, list[str]]:
        """Return the target, and reasons for objects left out; or raise `Skipped`."""
        raise NotImplementedError

    def read_all(
        self, context: bpy.types.Context, image: bpy.types.Image
    ) -> tuple[list[Any], list[str]]:
        """Return all targets, that of the image first, and reasons as `read_one`."""
        target, skipped = self.read_one(context, self.restored(image))
        return [target], skipped

    def restored(self, image: bpy.types.Image) -> bpy.types.Image:
        """Restore the image that this run replaced before it was repeated by F9."""
        if image.name in self.result.split("\n") and not self.options.is_repeat_last:
            data.image.images.restore(image)
        return image

    def parts(self, target: Any, result: Any) -> dict[int, Any]:
        """Return the new colors of each part of the image, as `data.image.images.read_parts`."""
        raise NotImplementedError

    def show(self, target: Any, source: bpy.types.Image, image: bpy.types.Image) -> None:
        """Show an image, which is `source` if that was overwritten, where `source` was shown."""

    def read(self, context: bpy.types.Context) -> tuple[list[Any], list[str]]:
        """Read the named image, or the shown one."""
        if self.image and self.image not in bpy.data.images:
            text = "There is no image named {name!r}; name one of the file's images."
            raise Refused(text, name=self.image)
        image = bpy.data.images[self.image] if self.image else self.shown(context)
        try:
            targets, skipped = self.read_all(context, image)
        except Skipped as reason:
            return [], sentences([(image.name, str(reason))])
        self.image = image.name  # redo must not read the result, which is shown by then
        found = {name: bpy.data.images.get(getattr(self, name, "")) for name in _NAMING}
        self._uids = {name: each.session_uid for name, each in found.items() if each is not None}
        return targets, skipped

    def write(self, context: bpy.types.Context, results: list[Any]) -> Done:
        """Write all images, and show the first one in the Image Editor."""
        names = {each.session_uid: each.name for each in bpy.data.images}
        for name, uid in self._uids.items():
            if uid in names:
                setattr(self, name, names[uid])
        self._parts: list[dict[int, Any]] = []
        self._digests: dict[int, bytes] = {}
        self._known: list[str] = []
        self._is_any_new = False
        swaps: list[data.replaced.Swap] = []
        used = dict(zip([t.image_uid for t in self.targets], self.result.split("\n"), strict=False))
        if self.output == "REPLACE":
            data.image.images.forget_overwritten()
            data.image.images.keep_unsaved(self.targets)

        def write_one(target: Any, result: Any) -> bpy.types.Image:
            return self._write_one(target, result, used.get(target.image_uid, ""))

        written, skipped = write_results(self.targets, results, write_one)
        for target, image, _ in written:
            source = image if self.output == "REPLACE" else data.image.images.find_image(target)
            space = context.space_data if target is self.targets[0] else None
            data.shown.show(space, source, image, again=bool(self.result))
            # One that was there is not of this run, so that another try must not write into it.
            used[target.image_uid] = "" if image.name in self._known else image.name
            swaps += self._swaps(target, source, image)
        self.result = "\n".join(used.get(target.image_uid, "") for target in self.targets)
        self._is_settled = bool(written) and self._settle(context)
        data.replaced.hold(swaps)
        return written, skipped

    def _settle(self, context: bpy.types.Context) -> bool:
        """Reset the panel's enlargement, which is for one run only; return whether it was set."""
        name = named(self.row.targets[0].row.settings, "enlargement")
        panel = getattr(context.scene.shock_filter, self.row.group)
        if not name or panel.bl_rna.properties[name].default > 1:  # it is what the button is for
            return False
        if getattr(panel, name) == 1 or getattr(panel, name) != getattr(self, name):
            return False
        panel.property_unset(name)
        return True

    def notes(self, written: list[Written]) -> str:
        """Report the new sizes of the images, and that the panel's enlargement was reset."""
        said = []
        name = named(self.row.targets[0].row.settings, "enlargement")
        if written and name and getattr(self, name) > 1:
            sizes = dict.fromkeys(tuple(each.data.size) for each in written)
            text = pgettext_rpt("Enlarged to {sizes} pixels.")
            said.append(text.format(sizes=", ".join(f"{w} x {h}" for w, h in sizes)))
        if self._known:
            text = pgettext_rpt("The result is in {names} already, so no copy was made.")
            said.append(text.format(names=", ".join(self._known)))
        if self._is_settled:
            text = "Enlarge was set back to 1, so that the next run keeps the size."
            said.append(pgettext_rpt(text))
        return " ".join(said)

    def _write_one(self, target: Any, result: Any, used: str) -> bpy.types.Image:
        source = data.image.images.find_image(target)
        parts = self.parts(target, result)
        self._parts.append(parts)
        new = {number: part.colors for number, part in parts.items()}
        suffix = self.row.done.lower()
        is_changed = any(part.changed for part in parts.values())
        is_changed |= data.image.images.sizes_of(target.parts) != data.image.images.sizes_of(new)
        if self.output != "REPLACE" and self.row.targets[0].mends_seams:
            # What lies beside the charts is not counted.
            is_new = data.image.images.differ(source, target.parts, new)
            self._is_any_new |= is_new
            is_changed |= is_new
        is_kept = self.output == "REPLACE" or not (
            self.output == "LIVE" or data.image.images.is_reusable(source, used, new)
        )
        is_spared = not is_changed and is_kept
        if self.output == "REPLACE" or (is_spared and self.output == "NEW"):
            self.show(target, source, source)
        if is_spared:
            return source  # a copy would be of no use
        if self.output != "REPLACE":
            image, was_there = data.image.images.add_or_reuse(
                source, suffix, used, new, self._stands_for(target, source)
            )
            self._known += [image.name] * was_there
            self.show(target, source, image)
            for each in (source, image):
                data.image.images.keep(each)
            return image
        digest = data.image.images.overwrite(source, target.parts, new)
        self._digests[target.image_uid] = digest
        return source

    def _stands_for(
        self, target: Any, source: bpy.types.Image
    ) -> Callable[[bpy.types.Image], bool]:
        """Return which images may stand for an equal result.

        That of a live texture is its own, since *Update* writes into it.
        """
        if self.output == "LIVE":
            mixed = data.image.mixing.results(target.objects, source)
            return lambda image: any(node.image == image for node in mixed)
        return lambda image: not data.mixes.is_result(image)

    def _swaps(
        self, target: Any, source: bpy.types.Image, image: bpy.types.Image
    ) -> list[data.replaced.Swap]:
        if image != source and self.output == "LIVE":
            return [data.replaced.MixSwap(source, image, target.objects)]
        if image != source:
            objects = target.objects if getattr(self, "assign", False) else []
            return [data.replaced.ImageSwap(source, image, objects)]
        if digest := self._digests.get(target.image_uid):
            uids = getattr(target, "uids", ())
            return [data.replaced.PixelsSwap(image, target.parts, digest, uids)]
        return []

    def counts(self, written: list[Written]) -> tuple[int, int]:
        """Count the pixels of all parts."""
        parts = self._all_parts()
        changed = sum(part.changed for part in parts)
        return changed, sum(part.counted for part in parts)

    def count_filtered(self, written: list[Written]) -> int:
        """Count them without those beside the charts, or that a mask leaves out."""
        return self.counts(written)[1]

    def facts(self, written: list[Written], seconds: float) -> dict[str, Any]:
        """Return the values for the text of `summary`."""
        target, image, _ = written[0]
        changes = describe_colors(self._all_parts(), "pixels", self.advice)
        if self.row.changes:
            changed, total = self.counts(written)
            changes = pgettext_rpt(self.row.changes).format(changed=changed, total=total)
        names = {"old": target.name, "new": image.name}
        return {"done": self.done(), "changes": changes, "seconds": seconds, **names}

    def unchanged(self, facts: dict[str, Any]) -> str:
        """Return the report if no pixel has changed."""
        text = pgettext_rpt(
            "Nothing in {old} has changed except texels beside the charts, in {new}: {changes},"
            " {seconds:.1f} s."
            if facts["new"] != facts["old"] and self._is_any_new
            else "Nothing in {old} has changed, and {new} equals it: {changes}, {seconds:.1f} s."
            if facts["new"] != facts["old"]
            else "Nothing in {old} has changed, so no copy was made: {changes}, {seconds:.1f} s."
            if self.output != "REPLACE"
            else "Nothing in {old} has changed: {changes}, {seconds:.1f} s."
        )
        return text.format(**facts)

    def _all_parts(self) -> list[Any]:
        return [part for parts in self._parts for part in parts.values()]


class ImageOperator(OneImageOperator):
    """Mixin for operators on one image."""

    obstacle = staticmethod(obstacles.of_images)

    def shown(self, context: bpy.types.Context) -> bpy.types.Image:
        """Return the image in the Image Editor."""
        image = data.chosen.edited_image(context)
        if image is None:
            raise Refused("Open an image in the Image Editor, or name one.")
        return image

    def read_one(self, context: bpy.types.Context, image: bpy.types.Image) -> tuple[Any, list[str]]:
        """Read the image."""
        return data.image.images.read_image(image), []

    def parts(self, target: Any, result: Any) -> dict[int, Any]:
        """Return all pixels."""
        return {data.image.images.UNTILED: result}

    def summary(self, written: list[Written], seconds: float) -> str:
        """Name the image and count its pixels."""
        facts = self.facts(written, seconds)
        if not self.counts(written)[0]:
            return self.unchanged(facts)
        text = pgettext_rpt(
            "{done} the image {old}: {changes}, {seconds:.1f} s."
            if facts["new"] == facts["old"]
            else "{done} the image {old} into {new}: {changes}, {seconds:.1f} s."
        )
        return text.format(**facts)
