# SPDX-License-Identifier: GPL-3.0-or-later
"""The data of a drawn flow, and whether its object can be read."""

from __future__ import annotations

from typing import Any

import bpy

_MODES = {"OBJECT", "VERTEX_PAINT", "WEIGHT_PAINT", "TEXTURE_PAINT"}
"""Object modes in which the mesh data is what Blender shows."""


class Overlay:
    """The shown data; batches are made when drawn, and again when the mesh has changed.

    Those of arrows are kept by their distance, since each view may be zoomed in its own way.
    """

    def __init__(self, obj: bpy.types.Object, found: Any) -> None:
        self.name = obj.name
        self.uid = obj.session_uid
        self.found = found
        self.surface: Any = None
        self.arrows: dict[float, list[tuple]] = {}
        self.drawing: list[object] = []

    def object(self) -> bpy.types.Object | None:
        """Find the object again, also if it was renamed."""
        obj = bpy.data.objects.get(self.name)
        if obj is None or obj.session_uid != self.uid:
            obj = next((other for other in bpy.data.objects if other.session_uid == self.uid), None)
        if obj is not None:
            self.name = obj.name
        return obj

    def forget_batches(self) -> None:
        """Drop the batches, so that they are made again."""
        self.surface = None
        self.arrows.clear()


def is_seen(obj: bpy.types.Object | None, view: bpy.types.SpaceView3D) -> bool:
    """Whether a view shows an object and the overlays over it."""
    return (
        obj is not None
        and is_readable(obj)
        and view.overlay.show_overlays
        and obj.visible_get(viewport=view)
    )


def is_readable(obj: bpy.types.Object) -> bool:
    """Whether its mesh is what is seen; another object with the same mesh may be in Edit Mode."""
    return obj.type == "MESH" and obj.mode in _MODES and not obj.data.is_editmode
