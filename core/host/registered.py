# SPDX-License-Identifier: GPL-3.0-or-later
"""Any filter of the registry on what a host program keeps.

The settings are those of the filter; where a sharpening may follow, they are a `Denoising`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from .. import registry
from ..atlas import TextureAtlas
from ..base.progress import ProgressCallback
from . import colors, denoising, geometry, images, textures
from .inputs import (
    ColoredSurface,
    Denoising,
    Floats,
    HostImage,
    MirroredSurface,
    PaintedSurface,
    Pixels,
    TexturedSurface,
)
from .recolored import Recolored


def filter_shape(
    surface: MirroredSurface,
    name: str,
    settings: Any,
    weld: bool,
    progress: ProgressCallback | None,
) -> geometry.Sharpened:
    """Filter the positions of a surface; vertices without faces stay in place.

    Parameters
    ----------
    surface : MirroredSurface
    name : str
        Of the filter.
    settings : object
        Of the filter's settings class, or a `Denoising`.
    weld : bool
        Vertices at exactly the same place move together, as the most protected of them.
    progress : callable or None
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    Sharpened
        Vertices that do not move keep their coordinates bit for bit.

    Raises
    ------
    core.ShockError
        See `core.TriangleMesh` and the filter.
    """
    row = registry.find(name)
    function = _with(settings, row.function(), row)
    return geometry.filter_geometry(surface, function, weld, progress)


def filter_colors(
    surface: ColoredSurface, name: str, settings: Any, weld: bool, progress: ProgressCallback | None
) -> Recolored:
    """Filter the colors of a surface; what has no faces keeps its color.

    Parameters are those of `filter_shape`. Vertices at the same place count as one where their
    colors agree. A corner of an n-gon that lies in several of its triangles gets the mean of what
    they say. Colors that do not change stay bit for bit.
    """
    row = registry.find(name)
    at_vertices, at_corners = (
        _with(settings, function, row) for function in (row.function(), row.corner_function())
    )
    return colors.filter_colors(surface, at_vertices, at_corners, weld, progress)


def filter_both(
    surface: PaintedSurface, name: str, settings: Any, weld: bool, progress: ProgressCallback | None
) -> denoising.Both:
    """Filter positions and colors with the same weights; only denoising can."""
    return denoising.denoise_both(surface, settings, weld, progress)


def filter_image(
    image: HostImage, name: str, settings: Any, progress: ProgressCallback | None
) -> Recolored:
    """Filter an image; opacity stays.

    With ``alpha="none"`` in the settings, all four channels are filtered alike, whatever the
    fourth is. Pixels that do not change stay bit for bit.
    """
    row = registry.find(name)
    kernel = settings.kernel if isinstance(settings, Denoising) else settings

    def run(pixels: Pixels, alpha: str) -> Pixels:
        chosen = _with_alpha(kernel, alpha)
        both = replace(settings, kernel=chosen) if settings is not kernel else chosen
        return _with(both, row.function(), row)(pixels, None)

    return images.filter_image(image, getattr(kernel, "alpha", "auto"), run, progress)


def filter_texture(
    surface: TexturedSurface, name: str, settings: Any, progress: ProgressCallback | None
) -> textures.Retextured:
    """Filter a texture; opacity stays inside the charts, see `filter_image`."""
    row = registry.find(name)
    function = row.function()

    def run(atlas: TextureAtlas, pixels: Pixels, mask: Floats | None, alpha: str) -> Pixels:
        chosen = _with_alpha(settings, alpha)
        masked = {"mask": mask} if row.takes_mask else {}
        return function(
            atlas.mesh, surface.faces.uv, pixels, settings=chosen, atlas=atlas, **masked
        )

    return textures.filter_texture(surface, getattr(settings, "alpha", "auto"), run, progress)


def _with_alpha(settings: Any, alpha: str) -> Any:
    return replace(settings, alpha=alpha) if hasattr(settings, "alpha") else settings


def _with(settings: Any, function: Callable[..., Any], row: registry.Filter) -> Callable[..., Any]:
    """Return ``function(*data, mask)``: a function of the row with settings, and what follows."""
    if isinstance(settings, Denoising):
        return settings.by(function)
    if not row.takes_mask:
        return lambda *data: function(*data[:-1], settings=settings)
    return lambda *data: function(*data[:-1], settings=settings, mask=data[-1])
