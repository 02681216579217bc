# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator Paint Gain: a gain map is painted on the model, which shows the result meanwhile.

Nothing is modal, so that Blender's brushes and the panel work as they always do.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import bpy
from bpy.app.handlers import persistent

from ...core.errors import ShockError
from .. import data
from ..data.skipped import Refused, Skipped, explain
from ..modes import Mode, choices
from ..operators import jobs
from ..operators import poll as obstacles
from ..operators.base import can_run
from .previewing import Preview, parameters_of

_INTERVAL = 0.05
_SHARE = 5
"""How many times as long as a look at the map takes, until the next one."""

_BRUSH = "PAINT_OT_image_paint"
_MIDDLE = 128 / 255
_STAND_IN = ".shock_filter preview"  # as in data.stand_in, which needs numpy

_running: list[_Painting] = []


class _Stage:
    """A texture and its gain map; a stage of a `Preview`."""

    note = ""

    def __init__(self, image: bpy.types.Image, gain_map: bpy.types.Image, surface: Any) -> None:
        self._map = gain_map.session_uid
        self._surface = replace(surface, is_tried=True)
        self._stand_in = data.stand_in.StandIn(image)
        self._stand_in.show(surface.picture.pixels)
        self._painted = data.arrays.read_pixels(gain_map)

    def settings(self, settings: Any) -> Any:
        return settings

    def look(self) -> bool:
        """Whether something was painted since."""
        gain_map = _find(self._map)
        if gain_map is None or gain_map.size[:] != self._painted.shape[1::-1]:
            return False
        painted = data.arrays.read_pixels(gain_map)
        if (painted == self._painted).all():
            return False
        self._painted = painted
        return True

    def part(self, settings: Any) -> tuple[Any, Callable[[Any], Any]]:
        """Take what is painted now."""
        surface = replace(self._surface, grays=data.textures.grays_of(self._painted))
        return surface, lambda result: result.recolored.colors

    def show(self, pixels: Any) -> None:
        """Show the result on the model."""
        self._stand_in.show(pixels)

    def lost(self) -> bool:
        """Whether the image, its map or what stands for it is gone."""
        return not self._stand_in.is_there or _find(self._map) is None

    def end(self) -> None:
        """Show the texture itself."""
        self._stand_in.end()


class _Painting:
    """A gain map while it is painted."""

    def __init__(self, context: bpy.types.Context, mode: Mode) -> None:
        self._mode, self._scene = mode, context.scene.name
        settings = getattr(context.scene.shock_filter, mode.key)
        image = data.chosen.chosen_image(context, settings.image)
        gain_map = bpy.data.images.get(settings.gain_map) or _new_map(image)
        parameters = parameters_of(context.scene, mode)
        parameters.gain_map = gain_map.name
        target, _ = data.textures.read_texture(context, image, parameters, True)
        # What is painted on would count as the texture, and what is shown would be the stand-in.
        settings.image, settings.gain_map = image.name, gain_map.name
        _paint_on(context, gain_map)
        self.stage = _Stage(image, gain_map, target.surface)
        self.preview = Preview(mode, parameters, self.stage)
        self._strokes, self._next_look = 0, 0.0

    def tick(self) -> None:
        """Show what is ready, and begin anew if something was painted or set."""
        preview = self.preview
        parameters = parameters_of(bpy.data.scenes[self._scene], self._mode)
        if not preview.is_computing and not _is_brush_down() and self._look():
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
        """Whether there is nothing to show any more."""
        scene = bpy.data.scenes.get(self._scene)
        is_chosen = scene is not None and scene.shock_filter.mode.lower() == self._mode.key
        return not is_chosen or self.stage.lost()


class SHOCK_FILTER_OT_paint_gain(bpy.types.Operator):
    """Paint where detail is raised and smoothed, and see the result on the model."""

    bl_idname = "shock_filter.paint_gain"
    bl_label = "Paint Gain"
    bl_description = (
        "Paint where detail is raised, with white, and where it is smoothed, with black; middle"
        " gray keeps it. The model shows the result in Material Preview after each stroke, and"
        " while settings are changed. Makes a gain map if none is chosen. Press again to end"
    )
    bl_options = {"UNDO"}  # else undoing the first stroke would take the map away

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Want a texture on the active object, and no run."""
        return bool(_running) or can_run(cls, _obstacle(context))

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Begin, or end what was begun."""
        if _running:
            stop()
            return {"FINISHED"}
        mode = _mode(context)
        try:
            _running.append(_Painting(context, mode))
        except (ShockError, Refused) as error:
            self.report({"ERROR"}, explain(error))
            return {"CANCELLED"}
        except Skipped as reason:
            self.report({"ERROR"}, f"{reason}.")
            return {"CANCELLED"}
        if not bpy.app.timers.is_registered(_tick):
            bpy.app.timers.register(_tick, first_interval=_INTERVAL)
        return {"FINISHED"}


def is_running() -> bool:
    """Whether a gain map is being painted."""
    return bool(_running)


@persistent
def stop(*_: object) -> None:
    """Show the texture itself again."""
    while _running:
        _running.pop().preview.end()


@persistent
def put_away(*_: object) -> None:
    """Show textures instead of what stands for them in a file, or in a step of undo."""
    if not any(image.name.startswith(_STAND_IN) for image in bpy.data.images):
        return
    if not _running:
        data.stand_in.put_away()
    data.stand_in.remove_left()


def _tick() -> float | None:
    if not _running:
        return None
    painting = _running[-1]
    try:
        if painting.is_lost():
            stop()
        elif not jobs.is_scene_read():
            painting.tick()
    except BaseException:
        stop()
        raise
    return _INTERVAL if _running else None


def _mode(context: bpy.types.Context) -> Mode:
    chosen = context.scene.shock_filter.mode.lower()
    modes = [mode for mode in choices() if "gain_map" in mode.names]
    return next((mode for mode in modes if mode.key == chosen), modes[0])


def _obstacle(context: bpy.types.Context) -> str:
    obj = context.object
    if obj is None or obj not in data.chosen.mesh_objects(context):
        return "Make one of the selected mesh objects the active one."
    mode = _mode(context)
    settings = getattr(context.scene.shock_filter, mode.key)
    obstacle = obstacles.of_mode(context, mode, settings)
    if obstacle:
        return obstacle
    image = data.chosen.chosen_image(context, settings.image)
    if not data.stand_in.is_shown(obj, image):
        return "Choose a texture of the active object's material that has no UDIM tiles."
    return ""


def _new_map(image: bpy.types.Image) -> bpy.types.Image:
    import numpy as np

    width, height = image.size
    gain_map = bpy.data.images.new(f"{image.name} gain", width, height, is_data=True)
    pixels = np.full((height, width, 4), _MIDDLE, dtype=np.float32)
    pixels[..., 3] = 1.0
    data.arrays.write_pixels(gain_map, pixels)
    gain_map.update()
    gain_map.pack()
    gain_map.use_fake_user = True
    return gain_map


def _paint_on(context: bpy.types.Context, gain_map: bpy.types.Image) -> None:
    paint = context.tool_settings.image_paint
    paint.mode, paint.canvas = "IMAGE", gain_map
    if context.mode != "PAINT_TEXTURE":
        bpy.ops.object.mode_set(mode="TEXTURE_PAINT")
    shading = getattr(context.space_data, "shading", None)
    if shading is not None and shading.type in {"SOLID", "WIREFRAME"}:
        shading.type = "MATERIAL"


def _is_brush_down() -> bool:
    # What is computed in the middle of a stroke would be in the way at its end.
    windows = bpy.context.window_manager.windows
    return any(each.bl_idname == _BRUSH for window in windows for each in window.modal_operators)


def _find(uid: int) -> bpy.types.Image | None:
    return next((image for image in bpy.data.images if image.session_uid == uid), None)


def unregister() -> None:
    """Let go of everything, before the operator is unregistered."""
    stop()
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)


CLASSES = (SHOCK_FILTER_OT_paint_gain,)
