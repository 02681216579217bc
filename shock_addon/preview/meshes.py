# SPDX-License-Identifier: GPL-3.0-or-later
"""Previews on the active mesh object."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext, suppress
from typing import Any

import bpy
import numpy as np
from bpy.app.translations import pgettext_iface as iface_

from ...core.host.inputs import PaintedSurface
from ...core.preview.patch import Patch, patch_around, seen_vertex, whole_surface
from .. import data
from ..data.mesh.original import Original, color_attribute, show
from ..data.skipped import Refused, Skipped
from ..modes import Mode
from ..operators.poll import makes_object
from .outline import Outline
from .pointing import is_over_view, pointed_at
from .previewing import Preview, parameters_of

_IN_PLACE = {"OBJECT", "SCULPT", "VERTEX_PAINT", "WEIGHT_PAINT", "TEXTURE_PAINT"}
"""Object modes that show the mesh itself; previews leave other modes for Object Mode."""

_QUICK, _SLOW = 50_000, 8_000
"""Most vertices to sharpen, or to denoise, for an update, which then takes about 0.25 s."""


class MeshStage:
    """The stage of a `Preview` that writes the result into a mesh.

    Parameters
    ----------
    target : Target
        The object as it was read.
    patch : Patch
        The part of its surface to compute.
    words : str
        A note on the patch, with a field for its size.
    """

    def __init__(self, target: data.mesh.targets.MeshTarget, patch: Patch, words: str) -> None:
        self.settings = patch.settings
        self.chosen, self.note = {}, ""
        if patch.share < 1.0:
            self.note = iface_(words).format(size=patch.surface.size)
        self._target, self._patch = target, patch
        obj, self._left = bpy.context.object, None
        if obj.mode not in _IN_PLACE:
            self._pinned = obj.show_only_shape_key
            self._left = data.mesh.meshes.leave_mode(bpy.context)
            obj.show_only_shape_key = True  # as Edit Mode shows the active key
        self._mode = obj.mode
        self._original = Original(obj.data, color_attribute(target))
        self._outline = Outline(obj, patch.outline)

    def part(self, settings: Any) -> tuple[Any, Callable[[Any], Any]]:
        """Return the same patch for all settings."""
        return self._patch.surface, self._patch.whole

    def show(self, seen: Any) -> None:
        """Write the result into the mesh."""
        show(self._target, self._original, seen)

    def show_before(self) -> None:
        """Restore the mesh until the next `show`."""
        self._original.check_shown()
        self._original.restore()

    def lost(self) -> str:
        """Return an error if the object is gone or in another mode."""
        try:
            is_same = data.mesh.targets.find(self._target).mode == self._mode
        except Skipped:
            is_same = False
        return "" if is_same else "the object was removed, or its mode was changed"

    def end(self) -> None:
        """Restore the mesh and the object mode, and remove the outline."""
        self._outline.end()
        with data.mesh.meshes.object_mode(bpy.context) if self.lost() else nullcontext():
            self._original.restore()
        if self._left is None:
            return
        with suppress(Skipped):
            data.mesh.targets.find(self._target).show_only_shape_key = self._pinned
        obj = bpy.context.object
        if obj is not None and obj.session_uid == self._target.object_uid:
            self._left.enter_again(bpy.context)


def begin(context: bpy.types.Context, event: bpy.types.Event, mode: Mode) -> Preview:
    """Start a preview on the active object.

    Raises
    ------
    Refused
        If it cannot be read, or has no faces under the mouse.
    """
    parameters = parameters_of(context.scene, mode)
    if makes_object(mode, parameters, context.object):
        if context.object.modifiers or context.object.data.shape_keys is not None:
            raise Refused(
                "Preview shows the mesh without its modifiers and shape keys; choose another"
                " output, or press the filter's own button."
            )
        parameters.output = "MESH"  # what a new object would show
    chosen = mode.target(parameters)
    targets, skipped = data.mesh.meshes.read_active(context, chosen.data.read, parameters)
    if not targets:
        raise Refused(" ".join(skipped))
    patch = _patch(context, event, targets[0], _SLOW if chosen.row.is_slow else _QUICK)
    words = "patch of {size:,} vertices"
    if not is_over_view(context.area, event):
        words = "patch of {size:,} vertices in the middle of the view"
    return Preview(mode, parameters, MeshStage(targets[0], patch, words))


def _patch(
    context: bpy.types.Context,
    event: bpy.types.Event,
    target: data.mesh.targets.MeshTarget,
    size: int,
) -> Patch:
    surface = target.surface
    if surface.size <= 3 * size:
        return whole_surface(surface)
    shape = surface.shape if isinstance(surface, PaintedSurface) else surface
    vertex = _pointed_at(context, event, data.mesh.targets.find(target), shape.positions)
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
