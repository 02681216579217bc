# SPDX-License-Identifier: GPL-3.0-or-later
"""Whose potential and flow is drawn over it in the 3D views.

Drawn is what was computed once, on the mesh as it is now, until that has more or fewer vertices or
faces. While nothing is shown, nothing is registered, and what draws is not imported.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ..operators import views

if TYPE_CHECKING:
    import gpu

    from .. import data

_MODES = {"OBJECT", "VERTEX_PAINT", "WEIGHT_PAINT", "TEXTURE_PAINT"}
"""Modes in which the mesh holds what is seen."""


class Overlay:
    """What is shown; batches are made when they are drawn, anew when the mesh has changed.

    Those of arrows are kept by their distance, since each view may be zoomed in its own way.
    """

    def __init__(self, obj: bpy.types.Object, found: data.flow.FlowOfMesh) -> None:
        from . import drawing

        self.name = obj.name
        self.uid = obj.session_uid
        self.found = found
        self.surface: gpu.types.GPUBatch | None = None
        self.arrows: dict[float, list[tuple]] = {}
        add = bpy.types.SpaceView3D.draw_handler_add
        self.drawing = [
            add(drawing.draw_surface, (self,), "WINDOW", "POST_VIEW"),
            add(drawing.draw_legend, (self,), "WINDOW", "POST_PIXEL"),
        ]

    def object(self) -> bpy.types.Object | None:
        """Find the object again, whatever it is called now."""
        obj = bpy.data.objects.get(self.name)
        if obj is None or obj.session_uid != self.uid:
            obj = next((other for other in bpy.data.objects if other.session_uid == self.uid), None)
        if obj is not None:
            self.name = obj.name
        return obj

    def forget_batches(self) -> None:
        """Have them made anew."""
        self.surface = None
        self.arrows.clear()


_shown: Overlay | None = None


def shown_object() -> str | None:
    """Name the object whose flow is drawn, if any."""
    return None if _shown is None else _shown.name


def show(obj: bpy.types.Object, found: data.flow.FlowOfMesh) -> None:
    """Draw the object's flow from now on, instead of another's; without a window do nothing."""
    global _shown
    hide()
    if bpy.app.background:
        return
    _shown = Overlay(obj, found)
    for handlers, function in _handlers():
        handlers.append(function)
    views.redraw()


def hide(*_: object) -> None:
    """Draw no flow any more."""
    global _shown
    if _shown is None:
        return
    for drawing in _shown.drawing:
        bpy.types.SpaceView3D.draw_handler_remove(drawing, "WINDOW")
    _shown = None
    for handlers, function in _handlers():
        if function in handlers:  # Blender drops them when it loads a file
            handlers.remove(function)
    views.redraw()


def _handlers() -> list[tuple]:
    handlers = bpy.app.handlers
    return [
        (handlers.depsgraph_update_post, _follow),
        (handlers.undo_post, _refresh),
        (handlers.redo_post, _refresh),
        (handlers.load_pre, hide),
    ]


def _follow(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    obj = _shown.object()
    if obj is None or any(
        update.is_updated_geometry and update.id.original in {obj, obj.data}
        for update in depsgraph.updates
    ):
        _refresh()


def _refresh(*_: object) -> None:
    obj = _shown.object()
    if obj is None or obj.type != "MESH":
        hide()
    elif is_readable(obj):
        _shown.forget_batches()
        if not _shown.found.fits(obj.data):
            hide()


def is_readable(obj: bpy.types.Object) -> bool:
    """Whether its mesh is what is seen; another object with the same mesh may be in Edit Mode."""
    return obj.type == "MESH" and obj.mode in _MODES and not obj.data.is_editmode
