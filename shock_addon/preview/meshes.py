# SPDX-License-Identifier: GPL-3.0-or-later
"""Previews on the active mesh object, in Object Mode."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import bpy
import numpy as np
from bpy.app.translations import pgettext_iface as iface_

from ...core import host
from ...core.errors import InvalidMesh
from ...core.host.patch import Patch, patch_around, seen_vertex, whole_surface
from ...core.settings import GeometrySettings, ShockSettings
from .. import data
from ..data.original import Original, color_attribute, show
from ..data.skipped import Skipped
from ..operators.denoise import SETTINGS, denoise_settings, steps_of
from ..operators.properties import settings_from
from .outline import Outline
from .pointing import is_over_view, pointed_at
from .previewing import Kind, Preview, parameters_of

_QUICK, _SLOW = 50_000, 8_000
"""Vertices that are sharpened, or denoised, in about a quarter of a second."""


class MeshStage:
    """An object whose mesh shows the result; see `Stage`.

    Parameters
    ----------
    target : Target
        The object as it was read.
    patch : Patch
        What of its surface is computed.
    words : str
        Say which patch it is, with a field for its size.
    """

    def __init__(
        self, target: data.Target, patch: Patch, words: str = "patch of {size:,} vertices"
    ) -> None:
        self.settings = patch.settings
        self.chosen, self.note = {}, ""
        if patch.share < 1.0:
            self.note = iface_(words).format(size=patch.surface.size)
        self._target, self._patch = target, patch
        obj = data.find(target)
        self._original = Original(obj.data, color_attribute(target))
        self._outline = Outline(obj, patch.outline)

    def part(self, settings: Any) -> tuple[Any, Callable[[Any], Any]]:
        """Take the same patch with all settings."""
        return self._patch.surface, self._patch.whole

    def show(self, seen: Any) -> None:
        """Write it into the mesh."""
        show(self._target, self._original, seen)

    def lost(self) -> str:
        """Ask for the object, in Object Mode."""
        try:
            in_object_mode = data.find(self._target).mode == "OBJECT"
        except Skipped:
            in_object_mode = False
        return "" if in_object_mode else "the object was removed or left Object Mode"

    def end(self) -> None:
        """Bring the mesh back, and draw no outline any more."""
        self._outline.end()
        with data.object_mode(bpy.context):
            self._original.restore()


def begin(context: bpy.types.Context, event: bpy.types.Event, mode: str) -> Preview:
    """Begin on the active object.

    Raises
    ------
    core.InvalidMesh
        If it cannot be read, or has no faces where the mouse points.
    """
    parameters = parameters_of(context, mode)
    kind, read = kind_of(mode, parameters)
    targets, skipped = data.read_active(context, read, parameters)
    if not targets:
        raise InvalidMesh(" ".join(skipped))
    patch = _patch(context, event, targets[0], _SLOW if mode == "denoise" else _QUICK)
    words = "patch of {size:,} vertices"
    if not is_over_view(context.area, event):
        words = "patch of {size:,} vertices in the middle of the view"
    return Preview(kind, parameters, MeshStage(targets[0], patch, words))


def kind_of(mode: str, parameters: Any) -> tuple[Kind, Callable[..., tuple]]:
    """Choose what is previewed by the panel's mode and its settings, and how it is read."""
    if mode == "geometry":
        settings = partial(settings_from, GeometrySettings)
        kind = Kind("sharpen_geometry", _welding("geometry", "sharpen"), settings, GeometrySettings,
                    "time", "feature_threshold")  # fmt: skip
        return kind, data.read_geometry
    if mode == "colors":
        settings = partial(settings_from, ShockSettings)
        kind = Kind("sharpen_colors", _welding("colors", "sharpen_colors"), settings, ShockSettings,
                    "time", "smoothing_passes")  # fmt: skip
        return kind, data.read_colors
    steps, (about, prefix) = steps_of(parameters.target), SETTINGS[parameters.target]

    def denoise(surface: Any, settings: Any, parameters: Any, progress: Any) -> Any:
        return steps.filter(surface, settings, parameters.weld, progress)

    kind = Kind("denoise", denoise, denoise_settings, about,
                prefix + "time", prefix + "beta")  # fmt: skip
    return kind, steps.read


def _welding(module: str, name: str) -> Callable[..., Any]:
    def filter_surface(surface: Any, settings: Any, parameters: Any, progress: Any) -> Any:
        function = getattr(getattr(host, module), name)
        return function(surface, settings, parameters.weld, progress)

    return filter_surface


def _patch(
    context: bpy.types.Context, event: bpy.types.Event, target: data.Target, size: int
) -> Patch:
    surface = target.surface
    if surface.size <= 3 * size:
        return whole_surface(surface)
    shape = surface.shape if isinstance(surface, host.inputs.PaintedSurface) else surface
    vertex = _pointed_at(context, event, data.find(target), shape.positions)
    return patch_around(surface, vertex, size)


def _pointed_at(
    context: bpy.types.Context, event: bpy.types.Event, obj: bpy.types.Object, positions: Any
) -> int:
    # The vertex under the mouse, or in the middle of the view if the mouse is on a panel.
    if context.area is None or context.area.type != "VIEW_3D":
        return 0
    view, mouse = pointed_at(context, event)
    to_clip = context.space_data.region_3d.perspective_matrix @ obj.matrix_world
    return seen_vertex(positions, np.array(to_clip), (view.width, view.height), mouse)
