# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that shows flows as moving textures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt

from .. import data
from ..data.skipped import Refused, Skipped, sentences
from ..modes import find
from . import poll as obstacles
from .base import Done, FilterOperator, Written, write_results
from .properties import settings_of

_SHOCK = {"shape": "geometry", "colors": "colors"}
"""The modes of the shown flows, by target."""


class FlowOperator(FilterOperator):
    """Mixin for the operator; its property `result` is the folder that was written."""

    obstacle = staticmethod(obstacles.of_flows)

    def read(self, context: bpy.types.Context) -> tuple[list[Any], list[str]]:
        """Read the objects or the flow map, and choose the folder for the frames."""
        image = self._flow_map(context) if self.target == "map" else None
        try:
            if image is not None:
                target, skipped = data.image.flows.read_map(image, self.y_axis.lower()), []
                self.image = image.name  # redo must not read the result, which is shown by then
            else:
                target, skipped = self._read_surface(context)
        except Skipped as reason:
            name = image.name if image else data.chosen.mesh_objects(context)[0].name
            return [], sentences([(name, str(reason))])
        used = "" if self.options.is_repeat_last else self.result
        self._folder = data.image.sequences.find_folder(self.folder, target.name, used)
        film = data.image.flows.Film(
            target.surface, self.frames, self.in_colors, self._folder.parent
        )
        return [replace(target, surface=film)], skipped

    def _flow_map(self, context: bpy.types.Context) -> bpy.types.Image:
        if not self.image:
            image = data.chosen.edited_image(context)
            if image is None:
                raise Refused("Choose a flow map, or open one in the Image Editor.")
            return data.chosen.flow_map_of(image)
        image = bpy.data.images.get(self.image)
        if image is None:
            text = "There is no image named {name!r}; choose one of the file's images."
            raise Refused(text, name=self.image)
        return data.chosen.flow_map_of(image)

    def _read_surface(self, context: bpy.types.Context) -> tuple[Any, list[str]]:
        settings, colors = None, ""
        if self.target in _SHOCK:
            key = _SHOCK[self.target]
            parameters = getattr(context.scene.shock_filter, key)
            settings = settings_of(find(key), parameters)
            colors = getattr(parameters, "attribute", "")
        return data.image.flows.read_surface(context, self.target, self, settings, colors)

    def write(self, context: bpy.types.Context, results: list[Any]) -> Done:
        """Move the frames to their place, and show the sequence."""
        self._notes: list[str] = []
        data.replaced.hold([])
        return write_results(self.targets, results, lambda *both: self._write_one(context, *both))

    def _write_one(self, context: bpy.types.Context, target: Any, staged: Any) -> bpy.types.Image:
        folder: Path = self._folder
        data.image.sequences.move(staged, folder)
        self.result = str(folder)
        label = pgettext_rpt("Flow")
        image = data.image.sequences.load(folder, f"{target.name} {label}", staged.count)
        repeats = self.loop > 0
        if target.objects and self.add_node:
            self._notes += data.image.fields.add_nodes(target.objects, image, activate=True)
            data.image.sequences.play_in_materials(target.objects, image, staged.count, repeats)
        self._show(context, target, image, staged.count, repeats)
        data.image.images.keep(image)
        return image

    def _show(
        self, context: bpy.types.Context, target: Any, image: bpy.types.Image, *how: Any
    ) -> None:
        """Show the sequence in the Image Editor instead of its flow map, or of an earlier one."""
        source = next((i for i in bpy.data.images if i.session_uid == target.image_uid), None)
        if source is None:
            return
        image[data.chosen.FLOW_MAP] = source
        shown = data.chosen.edited_image(context)
        if shown is None or data.chosen.flow_map_of(shown) != source:
            return
        space = context.space_data
        data.shown.show(space, source, image, again=False)
        data.image.sequences.play(space.image_user, *how)

    def counts(self, written: list[Written]) -> tuple[int, int]:
        """Count frames."""
        return self.frames, self.frames

    def summary(self, written: list[Written], seconds: float) -> str:
        """Name the image and its folder."""
        target, image, staged = written[0]
        height, width = target.surface.flow.shape
        text = pgettext_rpt(
            "Showed the flow in {name}: {count:,} frames of {width} x {height} pixels in {folder},"
            " {seconds:.1f} s."
        )
        return text.format(
            name=image.name,
            count=staged.count,
            width=width,
            height=height,
            folder=self.result,
            seconds=seconds,
        )

    def notes(self, written: list[Written]) -> str:
        """Return how it is played, and remarks on where the image could not be shown."""
        play = pgettext_rpt("Press Space to play it.")
        return " ".join([play, *dict.fromkeys(self._notes)])
