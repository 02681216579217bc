# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoise what Blender keeps, then sharpen it if asked for. Needs no bpy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from .colors import ColoredSurface, check_colors, filter_colors, repainted_corners
from .geometry import MirroredSurface, Sharpened, placed
from .picture import Picture, Pixels, filter_picture
from .recolored import Recolored
from .surface import welded

Progress = Callable[[float, str], bool]


@dataclass(frozen=True)
class Denoising:
    """What is done: settings for the kernel, and the sharpening's time or None."""

    kernel: Any
    sharpen_time: float | None


@dataclass(frozen=True)
class PaintedSurface:
    """A mesh object's shape and colors; the shape's mask says what may change of both."""

    shape: MirroredSurface
    paint: ColoredSurface

    @property
    def size(self) -> int:
        """How much work it is, beside others."""
        return self.shape.size


@dataclass(frozen=True)
class Both:
    """A new shape and new colors."""

    shape: Sharpened
    paint: Recolored


def denoise_shape(
    surface: MirroredSurface, denoising: Denoising, weld: bool, progress: Progress | None
) -> Sharpened:
    """Denoise a surface; parameters are those of `sharpen`."""
    from ..filters.denoising import denoise_geometry

    part = welded(surface, weld, progress)
    positions = denoise_geometry(
        part.mesh, denoising.kernel, denoising.sharpen_time, part.mask, progress
    )
    return placed(surface, part, positions, progress)


def denoise_colors(
    surface: ColoredSurface, denoising: Denoising, weld: bool, progress: Progress | None
) -> Recolored:
    """Denoise the colors of a surface; parameters are those of `sharpen_colors`."""
    from ..filters.denoising import denoise_corner_signal, denoise_vertex_signal

    kernel, time = denoising.kernel, denoising.sharpen_time
    return filter_colors(
        surface,
        lambda mesh, values, mask: denoise_vertex_signal(
            mesh, values, kernel, time, mask, progress
        ),
        lambda mesh, values, mask: denoise_corner_signal(
            mesh, values, kernel, time, mask, progress
        ),
        weld,
        progress,
    )


def denoise_both(
    surface: PaintedSurface, denoising: Denoising, weld: bool, progress: Progress | None
) -> Both:
    """Denoise a surface and its colors with the same weights.

    Colors of vertices are taken as those of the corners around them: so vertices at the same
    place move together, even where their colors differ.
    """
    from ..filters.denoising import denoise_jointly

    shape, paint = surface.shape, surface.paint
    check_colors(paint)
    part = welded(shape, weld, progress)
    corners = shape.triangles if paint.corners is None else paint.corners
    positions, colors = denoise_jointly(
        part.mesh, paint.colors[corners], denoising.kernel, denoising.sharpen_time, part.mask,
        progress,
    )  # fmt: skip
    moved = placed(shape, part, positions, progress)
    return Both(moved, repainted_corners(paint, corners, colors, progress))


def denoise_picture(picture: Picture, denoising: Denoising, progress: Progress | None) -> Recolored:
    """Denoise an image; opacity stays, see `sharpen_picture`."""
    from ..filters.denoising import denoise_image

    def denoise(pixels: Pixels, alpha: str) -> Pixels:
        kernel = replace(denoising.kernel, alpha=alpha)
        return denoise_image(pixels, kernel, denoising.sharpen_time, progress=progress)

    return filter_picture(picture, denoising.kernel.alpha, denoise, progress)
