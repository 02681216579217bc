# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoise the shape and the colors of a surface with the same weights."""

from __future__ import annotations

from dataclasses import dataclass

from ..base.progress import ProgressCallback, reporting
from ..registry import find
from ..shape.denoising import beltrami_joint_corners
from ..then_sharpen import sharpen_both, then_sharpen
from .colors import check_colors, repainted_corners
from .geometry import Reshaped, placed
from .inputs import Denoising, PaintedSurface
from .recolored import Recolored
from .welding import welded


@dataclass(frozen=True)
class Both:
    """A new shape and new colors."""

    shape: Reshaped
    paint: Recolored


def filter_both(
    surface: PaintedSurface,
    name: str,
    settings: Denoising,
    weld: bool,
    progress: ProgressCallback | None = None,
) -> Both:
    """Denoise a surface and its colors with the same weights; `name` is the filter of the colors.

    Colors of vertices are copied to the corners around them, so that vertices at the same place
    move together even if their colors differ.
    """
    sharpening = find(name).sharpening(settings.sharpen_time)
    function = then_sharpen(beltrami_joint_corners, sharpen_both, sharpening)
    shape, paint = surface.shape, surface.paint
    check_colors(paint)
    corners = shape.triangles if paint.corners is None else paint.corners
    with reporting(progress):
        part = welded(shape, weld)
        positions, colors = function(
            part.mesh, paint.colors[corners], settings=settings.kernel, mask=part.mask
        )
        moved = placed(shape, part, positions)
        return Both(moved, repainted_corners(paint, corners, colors))
