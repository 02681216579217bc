# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoise the shape and the colors of a surface with the same weights."""

from __future__ import annotations

from dataclasses import dataclass

from ..base.progress import ProgressCallback, reporting
from ..filters.beltrami.meshes import beltrami_joint_corners
from .colors import check_colors, repainted_corners
from .geometry import Sharpened, placed
from .inputs import Denoising, PaintedSurface
from .recolored import Recolored
from .welding import welded


@dataclass(frozen=True)
class Both:
    """A new shape and new colors."""

    shape: Sharpened
    paint: Recolored


def denoise_both(
    surface: PaintedSurface, denoising: Denoising, weld: bool, progress: ProgressCallback | None
) -> Both:
    """Denoise a surface and its colors with the same weights.

    Colors of vertices are taken as those of the corners around them: so vertices at the same
    place move together, even where their colors differ.
    """
    shape, paint = surface.shape, surface.paint
    check_colors(paint)
    corners = shape.triangles if paint.corners is None else paint.corners
    with reporting(progress):
        part = welded(shape, weld)
        positions, colors = denoising.by(beltrami_joint_corners)(
            part.mesh, paint.colors[corners], part.mask
        )
        moved = placed(shape, part, positions)
        return Both(moved, repainted_corners(paint, corners, colors))
