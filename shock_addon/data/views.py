# SPDX-License-Identifier: GPL-3.0-or-later
"""Helpers for drawing into the 3D views."""

from __future__ import annotations

import bpy
from mathutils import Matrix

LIFT = 0.0025
"""How much nearer to the viewer a surface is drawn, as a fraction of the distance."""


def lifted(projection: Matrix, view: bpy.types.RegionView3D, lift: float = LIFT) -> Matrix:
    """Draw nearer to the viewer by this fraction of the distance, for the depth test."""
    nearer = projection.copy()
    if view.is_perspective:
        nearer[2][3] *= 1.0 + lift
    else:
        nearer[2][3] += nearer[2][2] * lift * view.view_distance
    return nearer


def redraw() -> None:
    """Redraw all 3D views."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()
