# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoise what a host program keeps, then sharpen it if asked for."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ... import core
from ..base.progress import ProgressCallback, reporting
from .colors import check_colors, filter_colors, repainted_corners
from .geometry import Sharpened, placed
from .images import filter_image
from .inputs import ColoredSurface, Denoising, HostImage, MirroredSurface, PaintedSurface, Pixels
from .recolored import Recolored
from .welding import welded


@dataclass(frozen=True)
class Both:
    """A new shape and new colors."""

    shape: Sharpened
    paint: Recolored


def denoise_shape(
    surface: MirroredSurface, denoising: Denoising, weld: bool, progress: ProgressCallback | None
) -> Sharpened:
    """Denoise a surface; parameters are those of `sharpen`."""
    with reporting(progress):
        part = welded(surface, weld)
        positions = denoising.by(core.beltrami_mesh)(part.mesh, part.mask)
        return placed(surface, part, positions, None)


def denoise_colors(
    surface: ColoredSurface, denoising: Denoising, weld: bool, progress: ProgressCallback | None
) -> Recolored:
    """Denoise the colors of a surface; parameters are those of `sharpen_colors`."""
    at_vertices = denoising.by(core.beltrami_vertex_signal)
    at_corners = denoising.by(core.beltrami_corner_signal)
    with reporting(progress):
        return filter_colors(surface, at_vertices, at_corners, weld, None)


def denoise_both(
    surface: PaintedSurface, denoising: Denoising, weld: bool, progress: ProgressCallback | None
) -> Both:
    """Denoise a surface and its colors with the same weights.

    Colors of vertices are taken as those of the corners around them: so vertices at the same
    place move together, even where their colors differ.
    """
    from ..filters.beltrami.meshes import beltrami_joint_corners

    shape, paint = surface.shape, surface.paint
    check_colors(paint)
    corners = shape.triangles if paint.corners is None else paint.corners
    with reporting(progress):
        part = welded(shape, weld)
        positions, colors = denoising.by(beltrami_joint_corners)(
            part.mesh, paint.colors[corners], part.mask
        )
        moved = placed(shape, part, positions, None)
        return Both(moved, repainted_corners(paint, corners, colors, None))


def denoise_picture(
    picture: HostImage, denoising: Denoising, progress: ProgressCallback | None
) -> Recolored:
    """Denoise an image; opacity stays, see `filter_image`."""

    def denoise(pixels: Pixels, alpha: str) -> Pixels:
        kernel = replace(denoising.kernel, alpha=alpha)
        return Denoising(kernel, denoising.sharpen_time).by(core.beltrami_image)(pixels, None)

    with reporting(progress):
        return filter_image(picture, denoising.kernel.alpha, denoise, None)
