# SPDX-License-Identifier: GPL-3.0-or-later
"""Painting of a gain map on the model, which shows the result live."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import blf
import bpy
import numpy as np
from bpy.app.translations import pgettext_iface as iface_

from .. import data
from ..modes import Mode
from .coat import Coat
from .previewing import Preview, parameters_of

HINT = "White raises detail, black smooths it, middle gray keeps it. Paint Gain again ends."

_SHARE = 5
"""The interval between looks at the map, relative to the time that a look takes."""

_BRUSH = "PAINT_OT_image_paint"
_MIDDLE = 128 / 255


class _Stage:
    """The stage of a `Preview` for a texture and its gain map."""

    note = ""

    def __init__(
        self,
        image: bpy.types.Image,
        gain_map: bpy.types.Image,
        surface: Any,
        objects: Sequence[str],
    ) -> None:
        self._image, self._map = image.session_uid, gain_map.session_uid
        self._surface = replace(surface, is_tried=True)
        self._stand_in = data.image.stand_in.StandIn(image)
        self._stand_in.show(surface.picture.pixels)
        found = [bpy.data.objects[name] for name in objects]
        self._places = {obj.session_uid: obj.matrix_world.copy() for obj in found}
        self._coat = Coat(surface.faces, not image.is_float, self._is_seen)
        self._hint: Any = bpy.types.SpaceView3D.draw_handler_add(
            _draw_hint, (), "WINDOW", "POST_PIXEL"
        )
        self._painted = data.arrays.read_pixels(gain_map)

    def settings(self, settings: Any) -> Any:
        return settings

    def look(self) -> bool:
        """Return whether the map has changed since the last look."""
        gain_map = _find(self._map)
        if gain_map is None or gain_map.size[:] != self._painted.shape[1::-1]:
            return False
        painted = data.arrays.read_pixels(gain_map)
        if (painted == self._painted).all():
            return False
        self._painted = painted
        return True

    def part(self, settings: Any) -> tuple[Any, Callable[[Any], Any]]:
        """Return the texture with the current gain map."""
        surface = replace(self._surface, grays=data.image.textures.grays_of(self._painted))
        return surface, lambda result: result.recolored.colors

    def show(self, pixels: Any) -> None:
        """Show the result on the model."""
        self._stand_in.show(pixels)
        self._coat.show(pixels)

    def lost(self) -> bool:
        """Return whether an object, the image, its map or its stand-in is gone."""
        is_there = len(self._found()) == len(self._places) and self._stand_in.is_there
        return not is_there or _find(self._map) is None

    def is_of(self, settings: Any) -> bool:
        """Return whether settings name this image and map; a name may be one of before."""
        named = ((settings.image, self._image), (settings.gain_map, self._map))
        found = [(bpy.data.images.get(name), uid) for name, uid in named]
        return all(image is None or image.session_uid == uid for image, uid in found)

    def _is_seen(self, space: bpy.types.SpaceView3D) -> bool:
        # The coat stays where the objects were.
        return is_workbench(space) and all(
            obj.visible_get(viewport=space) and obj.matrix_world == self._places[obj.session_uid]
            for obj in self._found()
        )

    def _found(self) -> list[bpy.types.Object]:
        return [obj for obj in bpy.data.objects if obj.session_uid in self._places]

    def end(self) -> None:
        """Show the original texture."""
        self._stand_in.end()
        self._coat.end()
        if self._hint is not None:
            bpy.types.SpaceView3D.draw_handler_remove(self._hint, "WINDOW")
            self._hint = None


class Painting:
    """A session of painting a gain map; if it cannot begin, all is as it was."""

    def __init__(self, context: bpy.types.Context, mode: Mode) -> None:
        self._mode, self._scene = mode, context.scene.name
        settings = getattr(context.scene.shock_filter, mode.key)
        image = data.chosen.chosen_image(context, settings.image)
        with ExitStack() as undo:
            gain_map = bpy.data.images.get(settings.gain_map)
            if gain_map is None:
                gain_map = _new_map(image)
                undo.callback(bpy.data.images.remove, gain_map)
            parameters = parameters_of(context.scene, mode)
            parameters.gain_map = gain_map.name
            target, _ = data.image.textures.read_texture(context, image, parameters, True)
            data.image.canvas.keep(undo, settings, "image", "gain_map")
            # Else the painted image would be taken for the texture, or the stand-in for the image.
            settings.image, settings.gain_map = image.name, gain_map.name
            data.image.canvas.paint_on(context, gain_map, image, undo)
            self.stage = _Stage(image, gain_map, target.surface, target.objects)
            undo.callback(self.stage.end)
            self.preview = Preview(mode, parameters, self.stage)
            undo.pop_all()
        self._strokes, self._next_look = 0, 0.0

    def tick(self) -> None:
        """Show finished results, and start again after a stroke or a change of settings."""
        preview = self.preview
        parameters = parameters_of(bpy.data.scenes[self._scene], self._mode)
        if not preview.is_computing and not is_brush_down() and self._look():
            self._strokes += 1
        parameters.strokes = self._strokes
        preview.parameters = parameters
        preview.tick()

    def _look(self) -> bool:
        began = time.perf_counter()
        if began < self._next_look:
            return False
        is_new = self.stage.look()
        ended = time.perf_counter()
        self._next_look = ended + _SHARE * (ended - began)
        return is_new

    def is_lost(self) -> bool:
        """Return whether the image, the map or the object is gone, or others are chosen."""
        scene = bpy.data.scenes.get(self._scene)
        if scene is None or scene.shock_filter.mode.lower() != self._mode.key:
            return True
        return self.stage.lost() or not self.stage.is_of(
            getattr(scene.shock_filter, self._mode.key)
        )


def _new_map(image: bpy.types.Image) -> bpy.types.Image:
    width, height = image.size
    gain_map = bpy.data.images.new(f"{image.name} gain", width, height, is_data=True)
    pixels = np.full((height, width, 4), _MIDDLE, dtype=np.float32)
    pixels[..., 3] = 1.0
    data.arrays.write_pixels(gain_map, pixels)
    gain_map.update()
    gain_map.pack()
    gain_map.use_fake_user = True
    return gain_map


def is_workbench(space: bpy.types.SpaceView3D) -> bool:
    """Whether a 3D view is drawn by Workbench, which shows what is painted on, not the material."""
    engine = bpy.context.scene.render.engine
    kind = space.shading.type
    return kind == "SOLID" or (kind == "RENDERED" and engine == "BLENDER_WORKBENCH")


def _draw_hint() -> None:
    """Say at the lower right what black and white do."""
    context, font = bpy.context, 0
    scale = context.preferences.system.ui_scale
    sides = [region.width for region in context.area.regions if region.type == "UI"]
    text = iface_(HINT)
    blf.size(font, 12 * scale)
    blf.color(font, *context.preferences.themes[0].view_3d.space.text_hi, 1.0)
    x = context.region.width - sum(sides) - 24 * scale - blf.dimensions(font, text)[0]
    blf.position(font, max(x, 0.0), 24 * scale, 0.0)
    blf.draw(font, text)


def is_brush_down() -> bool:
    """Whether a stroke is under way; a computation would delay its end."""
    windows = bpy.context.window_manager.windows
    return any(each.bl_idname == _BRUSH for window in windows for each in window.modal_operators)


def _find(uid: int) -> bpy.types.Image | None:
    return next((image for image in bpy.data.images if image.session_uid == uid), None)
