# SPDX-License-Identifier: GPL-3.0-or-later
"""Filter a texture on its surface, as a host program such as Blender keeps both.

Colors are filtered as they are stored: bytes as values of the image's color space, floats as
linear ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..base.progress import ProgressCallback, phase, reporting
from ..filters import textures
from ..mesh.triangle_mesh import TriangleMesh, weld_borders
from ..settings import DilateSettings, TextureSettings
from .picture import Pixels, filter_picture
from .recolored import Recolored
from .textured import TexturedFaces, TexturedSurface

_ANALYSIS = 0.3  # of the time that a run takes


@dataclass(frozen=True)
class Retextured:
    """New colors of a texture, and what is unusual about its coordinates."""

    recolored: Recolored
    notes: tuple[str, ...]


def sharpen_texture(
    surface: TexturedSurface, settings: TextureSettings, progress: ProgressCallback | None
) -> Retextured:
    """Sharpen a texture; opacity stays inside the charts.

    Parameters
    ----------
    surface : TexturedSurface
    settings : TextureSettings
        With ``alpha="none"``, all four channels are filtered alike, whatever the fourth is.
    progress : callable or None
        ``progress(fraction, message) -> bool``; False cancels.

    Raises
    ------
    ShockError
        See `core.TriangleMesh` and `core.sharpen_texture`.
    """

    def sharpen(atlas: TextureAtlas, pixels: Pixels, alpha: str) -> Pixels:
        chosen, mask = replace(settings, alpha=alpha), _mask(surface, atlas)
        return textures.sharpen_texture(
            atlas.mesh, surface.faces.uv, pixels, chosen, mask, atlas=atlas
        )

    return _filtered(surface, settings.alpha, sharpen, progress)


def dilate_texture(
    surface: TexturedSurface, settings: DilateSettings, progress: ProgressCallback | None
) -> Retextured:
    """Fill the gutter of a texture, all channels alike; see `sharpen_texture`."""

    def dilate(atlas: TextureAtlas, pixels: Pixels, alpha: str) -> Pixels:
        return textures.dilate_texture(atlas.mesh, surface.faces.uv, pixels, settings, atlas=atlas)

    return _filtered(surface, "auto", dilate, progress)


def analyse(
    faces: TexturedFaces, size: tuple[int, int], progress: ProgressCallback | None = None
) -> TextureAtlas:
    """Find charts and texels of an image of this height and width."""
    with reporting(progress):
        with phase(0.0, 0.1, "Preparing the mesh"):
            mesh = TriangleMesh(faces.positions, weld_borders(faces.positions, faces.triangles))
        with phase(0.1, 1.0, "Finding charts"):
            return TextureAtlas(mesh, faces.uv, *size)


def _filtered(
    surface: TexturedSurface,
    alpha: str,
    function: Callable[[TextureAtlas, Pixels, str], Pixels],
    progress: ProgressCallback | None,
) -> Retextured:
    height, width = surface.picture.pixels.shape[:2]
    with reporting(progress):
        with phase(0.0, _ANALYSIS, "Preparing the mesh"):
            atlas = analyse(surface.faces, (height, width))
        with phase(_ANALYSIS, 1.0, "Sharpening"):
            changed = filter_picture(
                surface.picture, alpha, lambda pixels, kind: function(atlas, pixels, kind), None
            )
    return Retextured(changed, tuple(atlas.report.sentences()))


def _mask(surface: TexturedSurface, atlas: TextureAtlas) -> npt.NDArray[np.float64] | None:
    if surface.faces.weights is None:
        return surface.mask
    mask = np.clip(atlas.bake(surface.faces.weights), 0.0, 1.0)
    return mask if surface.mask is None else mask * surface.mask
