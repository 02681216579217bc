# SPDX-License-Identifier: GPL-3.0-or-later
"""Live results of all kinds: of the shape, of colors, of both."""

from __future__ import annotations

from typing import Any

import bpy

from ....core.host.inputs import ColoredSurface, PaintedSurface
from ..mesh import colors, painted
from ..mesh.targets import MeshTarget, find
from . import coloring, movement


def write(target: MeshTarget, result: Any) -> bpy.types.Object:
    """Write a result, as `movement.write` and `coloring.write` do.

    Raises
    ------
    Skipped
        As they do, and nothing is written then.
    """
    if isinstance(target.surface, ColoredSurface):
        return coloring.write(target, result)
    if not isinstance(target.surface, PaintedSurface):
        return movement.write(target, result)
    shape, paint = painted.split(target)
    colors.check_unchanged(find(target), paint)
    movement.write(shape, result.shape)
    return coloring.write(paint, result.paint)
