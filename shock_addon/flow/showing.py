# SPDX-License-Identifier: GPL-3.0-or-later
"""Show and hide flows, or creases, over an object in the 3D views.

The flow was computed once. It is drawn on the current mesh until the number of vertices or faces
changes. While no flow is shown, no handler is registered and the drawing code is not imported.
"""

from __future__ import annotations

from typing import Any

import bpy

from ..data import views
from .overlay import Overlay, is_readable

_shown: Overlay | None = None


def shown_object(kind: str = "flow") -> str | None:
    """Name the object whose flow, or whose creases, are drawn, if any."""
    return None if _shown is None or _shown.found.kind != kind else _shown.name


def show(obj: bpy.types.Object, found: Any) -> None:
    """Draw this from now on, instead of the current drawing; without a window do nothing.

    Parameters
    ----------
    obj : bpy.types.Object
    found : FlowOfMesh or CreasesOfMesh
        Has `kind`, "flow" or "creases", and ``fits(mesh)``.
    """
    global _shown
    hide()
    if bpy.app.background:
        return
    if found.kind == "creases":
        from . import creases as drawing
    else:
        from . import drawing

    _shown = Overlay(obj, found)
    add = bpy.types.SpaceView3D.draw_handler_add
    _shown.drawing = [
        add(drawing.draw_surface, (_shown,), "WINDOW", "POST_VIEW"),
        add(drawing.draw_legend, (_shown,), "WINDOW", "POST_PIXEL"),
    ]
    for handlers, function in _handlers():
        handlers.append(function)
    views.redraw()


def say(report: str) -> None:
    """Keep a report on the shown creases up to date."""
    if _shown is not None and _shown.found.kind == "creases":
        _shown.found.say(report)


def follow_settings() -> None:
    """Find the shown creases again if the panel's settings have changed, for the report."""
    if _shown is not None and _shown.found.kind == "creases":
        _shown.found.now()


def hide(*_: object) -> None:
    """Stop drawing."""
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
