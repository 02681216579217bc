# SPDX-License-Identifier: GPL-3.0-or-later
"""The base of operators on textures: an image and the faces of all objects that show it."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt

from .. import data
from ..data.skipped import Refused, Skipped, explain, sentences
from . import poll as obstacles
from .base import Done, Written, counted, textures
from .images import OneImageOperator


class TextureOperator(OneImageOperator):
    """Mixin for operators on an image and the faces that show it."""

    obstacle = staticmethod(obstacles.of_textures)

    def shown(self, context: bpy.types.Context) -> bpy.types.Image:
        """Return the image that is edited, painted on, or in the active object's material."""
        try:
            return data.chosen.shown_image(context)
        except Skipped as reason:
            text = "No texture was found for {name}: {reason}."
            name = data.chosen.mesh_objects(context)[0].name
            raise Refused(text, name=name, reason=reason) from reason

    def read(self, context: bpy.types.Context) -> tuple[list[Any], list[str]]:
        """Read the named texture, or the shown one; repeated on other objects, that of these."""
        names = [self.image, *self.result.split("\n")]
        is_again = self.options.is_repeat or self.options.is_repeat_last
        if is_again and data.image.textures.are_of_others(context, names):
            self.image = self.result = ""
        return super().read(context)

    def read_one(self, context: bpy.types.Context, image: bpy.types.Image) -> tuple[Any, list[str]]:
        """Read the image, and the faces of all objects that show it."""
        row = self.row.targets[0].row
        return data.image.textures.read_texture(context, image, self, row.takes_normals)

    def read_all(
        self, context: bpy.types.Context, image: bpy.types.Image
    ) -> tuple[list[Any], list[str]]:
        """Read the image and, with All of Material, the other maps of its materials."""
        self._notes: list[str] = []
        if getattr(self, "maps", "ONE") == "ONE":
            return super().read_all(context, image)
        maps = data.image.maps.maps_of(context, image)
        lead, skipped = self.read_one(context, self.restored(maps.lead))
        if not maps.followers:  # it may hold normals, as the settings say
            return [lead], [*skipped, *maps.left]
        targets, left = [data.image.textures.holding(lead, "values")], []
        has_content = "content" in self.row.targets[0].fields
        for follower, kind in maps.followers.items():
            content = data.image.maps.as_held(kind, self.content) if has_content else kind
            if content != "values" and not has_content:
                reason = pgettext_rpt("it holds normals, whose length this filter does not keep")
                left.append((follower.name, reason))
                continue
            try:
                target, _ = self.read_one(context, self.restored(follower))
            except Skipped as reason:
                left.append((follower.name, str(reason)))
            else:
                targets.append(data.image.textures.holding(target, content, lead))
        return targets, [*skipped, *maps.left, *sentences(left)]

    def parts(self, target: Any, result: Any) -> dict[int, Any]:
        """Return the new colors of each tile."""
        from ...core.host.textures import tiles_of

        self._notes += [*target.notes, *map(explain, result.notes)]
        if target.mosaic is None:
            return {data.image.images.UNTILED: result.recolored}
        levels = target.surface.picture.levels
        return tiles_of(target.mosaic, target.parts, result, levels)

    def show(self, target: Any, source: bpy.types.Image, image: bpy.types.Image) -> None:
        """Show it in the materials, with Assign; beside the old one with Live.

        With Replace nothing is mixed with it any more, nor with Assign; but if nothing has changed,
        what another filter has mixed with it stays.
        """
        if self.output == "LIVE":
            with data.mesh.meshes.object_mode(bpy.context):
                mask, is_inverted = self._live_mask(target.objects, source)
                data.image.mixing.show(target.objects, source, image, mask, is_inverted)
        elif self.output == "REPLACE" or self.assign:
            if self.output != "REPLACE" and image == source and self._is_mixed_by_other(target):
                return
            if data.image.mixing.remove(target.objects, source):
                text = pgettext_rpt("The live mix of {name} in the materials was removed.")
                self._notes.append(text.format(name=source.name))
            if self.output == "REPLACE" or image == source:
                return
            # Texture Paint Mode looks for the materials' images when it is entered.
            with data.mesh.meshes.object_mode(bpy.context):
                self._notes += data.image.textures.assign(target.objects, source, image)

    def _is_mixed_by_other(self, target: Any) -> bool:
        """Whether another filter made a live result of the texture."""
        found = data.mixes.mixed(target.objects, data.image.images.find_image(target))
        made = [data.live.recipes.noted(mix, data.LIVE_TEXTURE) for _, mix in found]
        return any(recipe is not None and recipe[0] != self.row.operator for recipe in made)

    def _live_mask(
        self, objects: list[str], source: bpy.types.Image
    ) -> tuple[bpy.types.Image | None, bool]:
        """Return what new nodes take as their mask, and whether it is inverted."""
        mask = bpy.data.images.get(getattr(self, "mask_image", ""))
        if mask is not None:
            return mask, self.invert_mask
        gain_map = bpy.data.images.get(getattr(self, "gain_map", ""))
        if gain_map is None:
            return None, False
        mask, is_kept = data.image.live_masks.of_gain(objects, source, gain_map)
        if is_kept:
            text = pgettext_rpt(
                "{mask} was painted on, so it stayed; where the gain map is painted elsewhere by"
                " now, paint the mask, too."
            )
            self._notes.append(text.format(mask=mask.name))
        return mask, False

    def write(self, context: bpy.types.Context, results: list[Any]) -> Done:
        """Write all images; live ones note how they can be made again."""
        done = super().write(context, results)
        textures[self.key] = {each.target.image_uid for each in done[0]}
        textures[self.key] |= {each.data.session_uid for each in done[0]}
        if self.output == "LIVE":
            values = {name: getattr(self, name) for name in self.row.names_for(self)}
            values |= {"image": self.image, "result": self.result}
            for target, image, _ in done[0]:
                if image.session_uid != target.image_uid:
                    self._note_recipe(target, values | {"objects": target.objects})
        return done

    def _note_recipe(self, target: Any, values: dict[str, Any]) -> None:
        old = data.image.images.find_image(target)
        for _, mix in data.mixes.mixed(target.objects, old):
            data.live.recipes.note(mix, self.row.operator, values, data.LIVE_TEXTURE)

    def summary(self, written: list[Written], seconds: float) -> str:
        """Name the image and count objects and pixels."""
        facts = self.facts(written, seconds)
        if not self.counts(written)[0]:
            return self.unchanged(facts)
        target = written[0].target
        text = pgettext_rpt(
            "{done} the texture {old} on {objects}: {changes}, {seconds:.1f} s."
            if facts["new"] == facts["old"]
            else "{done} the texture {old} on {objects} into {new}: {changes}, {seconds:.1f} s."
        )
        return text.format(
            objects=counted(len(target.objects), "1 object", "{:,} objects"), **facts
        )

    def notes(self, written: list[Written]) -> str:
        """Return the names of the other maps, and remarks on the UV map."""
        changed = [
            each
            for each in written[1:]
            if self.output == "REPLACE" or each.data.session_uid != each.target.image_uid
        ]
        others = ", ".join(each.data.name for each in changed)
        text = pgettext_rpt("With it: {names}.").format(names=others) if others else ""
        parts = [text, *dict.fromkeys(self._notes), super().notes(written)]
        return " ".join(filter(None, parts))
