# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpen a texture on its surface, as Blender keeps both. Needs no bpy.

Colors are filtered as they are stored: bytes as values of the image's color space, floats as
linear ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ... import core
from .picture import Picture, Pixels, filter_picture
from .recolored import Recolored

Progress = Callable[[float, str], bool]


@dataclass(frozen=True)
class TexturedFaces:
    """The faces that show an image.

    Attributes
    ----------
    positions : (n, 3) float64
        Vertices in the world.
    triangles : (m, 3) int
    uv : (m, 3, 2) float64
        Texture coordinates of the triangles' corners.
    weights : (m, 3) float64 or None
        1 sharpens fully, 0 leaves the texture as it is at that corner.
    """

    positions: npt.NDArray[np.float64]
    triangles: npt.NDArray[np.int64]
    uv: npt.NDArray[np.float64]
    weights: npt.NDArray[np.float64] | None


@dataclass(frozen=True)
class TexturedSurface:
    """The faces that show an image, of all objects, and the image.

    Attributes
    ----------
    faces : TexturedFaces
    picture : Picture
    mask : (h, w) float64 or None
        1 sharpens a texel fully, 0 leaves it as it is; the faces' weights count, too.
    """

    faces: TexturedFaces
    picture: Picture
    mask: npt.NDArray[np.float64] | None

    @property
    def size(self) -> int:
        """How much work it is, beside others."""
        return self.picture.size


@dataclass(frozen=True)
class Retextured:
    """New colors of a texture, and what is unusual about its coordinates."""

    recolored: Recolored
    notes: tuple[str, ...]


def sharpen_texture(
    surface: TexturedSurface, settings: core.TextureSettings, progress: Progress
) -> Retextured:
    """Sharpen a texture; opacity stays inside the charts.

    Parameters
    ----------
    surface : TexturedSurface
    settings : core.TextureSettings
        With ``alpha="none"``, all four channels are filtered alike, whatever the fourth is.
    progress : callable
        ``progress(fraction, message) -> bool``; False cancels.

    Raises
    ------
    core.ShockError
        See `core.TriangleMesh` and `core.sharpen_texture`.
    """
    atlas = _analyse(surface, progress)
    mask = _mask(surface, atlas)

    def sharpen(pixels: Pixels, alpha: str) -> Pixels:
        chosen = replace(settings, alpha=alpha)
        rest = _rest(progress)
        return core.sharpen_texture(
            atlas.mesh, surface.faces.uv, pixels, chosen, mask, rest, atlas=atlas
        )

    changed = filter_picture(surface.picture, settings.alpha, sharpen, progress)
    return Retextured(changed, tuple(atlas.report.sentences()))


def dilate_texture(
    surface: TexturedSurface, settings: core.DilateSettings, progress: Progress
) -> Retextured:
    """Fill the gutter of a texture, all channels alike; see `sharpen_texture`."""
    atlas = _analyse(surface, progress)

    def dilate(pixels: Pixels, alpha: str) -> Pixels:
        rest = _rest(progress)
        return core.dilate_texture(
            atlas.mesh, surface.faces.uv, pixels, settings, rest, atlas=atlas
        )

    changed = filter_picture(surface.picture, "auto", dilate, progress)
    return Retextured(changed, tuple(atlas.report.sentences()))


_ANALYSIS = 0.3  # of the time that a run takes


def analyse(faces: TexturedFaces, size: tuple[int, int], progress: Progress) -> core.TextureAtlas:
    """Find charts and texels of an image of this height and width."""
    triangles = core.weld_borders(faces.positions, faces.triangles, progress)
    mesh = core.TriangleMesh(faces.positions, triangles, progress)
    return core.TextureAtlas(mesh, faces.uv, *size, progress)


def _analyse(surface: TexturedSurface, progress: Progress) -> core.TextureAtlas:
    def part(fraction: float, message: str) -> bool:
        return progress(_ANALYSIS * fraction, message)

    return analyse(surface.faces, surface.picture.pixels.shape[:2], part)


def _rest(progress: Progress) -> Progress:
    return lambda fraction, message: progress(_ANALYSIS + (1 - _ANALYSIS) * fraction, message)


def _mask(surface: TexturedSurface, atlas: core.TextureAtlas) -> npt.NDArray[np.float64] | None:
    if surface.faces.weights is None:
        return surface.mask
    mask = np.clip(atlas.bake(surface.faces.weights), 0.0, 1.0)
    return mask if surface.mask is None else mask * surface.mask
