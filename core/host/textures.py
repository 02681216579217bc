# SPDX-License-Identifier: GPL-3.0-or-later
"""Filter a texture on its surface, as a host program such as Blender keeps both.

Colors are filtered as they are stored: bytes as values of the image's color space, floats as
linear ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..atlas import TextureAtlas
from ..base.progress import ProgressCallback, phase, reporting
from ..grid.resize import resized
from ..mesh.triangle_mesh import TriangleMesh
from ..mesh.weld import weld_borders
from ..registry import find
from .images import filter_pixels
from .inputs import Denoising, Floats, HostImage, Pixels, TexturedFaces, TexturedSurface
from .recolored import Recolored

_ANALYSIS = 0.3  # of the time that a run takes


@dataclass(frozen=True)
class Retextured:
    """New colors of a texture, and what is unusual about its coordinates."""

    recolored: Recolored
    notes: tuple[str, ...]


def filter_texture(
    surface: TexturedSurface, name: str, settings: Any, progress: ProgressCallback | None = None
) -> Retextured:
    """Filter a texture; opacity stays inside the charts.

    Parameters
    ----------
    surface : TexturedSurface
    name, settings
        As in `images.filter_image`.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Raises
    ------
    ShockError
        See `TriangleMesh`, `TextureAtlas` and the filter.
    """
    height, width = surface.picture.pixels.shape[:2]
    if surface.content:
        settings = _holding(settings, surface.content)
    words: dict[str, Any] = {}
    with reporting(progress):
        with phase(0.0, _ANALYSIS, "Preparing the mesh"):
            atlas = analyse(surface.faces, (height, width))
            mask = _mask(surface, atlas)
        with phase(_ANALYSIS, 1.0, "Filtering"):
            if surface.guide is not None and find(name).takes_guide:
                words["guide"] = _guiding(surface.guide, (height, width))
            where = atlas.mesh, surface.faces.uv
            words |= {"mask": mask, "atlas": atlas}
            changed = filter_pixels(surface.picture, name, settings, *where, **words)
    return Retextured(changed, tuple(atlas.report.sentences()))


def analyse(
    faces: TexturedFaces, size: tuple[int, int], progress: ProgressCallback | None = None
) -> TextureAtlas:
    """Find charts and texels of an image of this height and width."""
    with reporting(progress):
        with phase(0.0, 0.1, "Preparing the mesh"):
            mesh = TriangleMesh(faces.positions, weld_borders(faces.positions, faces.triangles))
        with phase(0.1, 1.0, "Finding charts"):
            return TextureAtlas(mesh, faces.uv, *size)


def _holding(settings: Any, content: str) -> Any:
    if isinstance(settings, Denoising):
        return replace(settings, kernel=_holding(settings.kernel, content))
    return replace(settings, content=content) if hasattr(settings, "content") else settings


def _guiding(guide: HostImage, size: tuple[int, int]) -> Pixels:
    # Colors that are multiplied count as much as opacity says already.
    is_straight = guide.opacity == "STRAIGHT" and not guide.premultiplied
    return resized(guide.pixels if is_straight else guide.pixels[..., :3], size)


def _mask(surface: TexturedSurface, atlas: TextureAtlas) -> Floats | None:
    if surface.faces.weights is None:
        return surface.mask
    mask = np.clip(atlas.bake(surface.faces.weights), 0.0, 1.0)
    return mask if surface.mask is None else mask * surface.mask
