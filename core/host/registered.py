# SPDX-License-Identifier: GPL-3.0-or-later
"""Any filter of the registry on what a host program keeps.

The settings are those of the filter; where a sharpening may follow, they are a `Denoising`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from .. import registry
from ..base.progress import ProgressCallback, reporting
from . import textures
from .colors import ColoredSurface
from .colors import filter_colors as recolor
from .denoising import Both, Denoising, PaintedSurface, denoise_both
from .geometry import MirroredSurface, Sharpened, placed
from .images import Picture, Pixels, filter_picture
from .recolored import Recolored
from .welding import welded


def filter_shape(
    surface: MirroredSurface, name: str, settings: Any, weld: bool, progress: ProgressCallback
) -> Sharpened:
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
    progress : callable
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
    function = _with(settings, registry.find(name).function())
    with reporting(progress):
        part = welded(surface, weld, None)
        return placed(surface, part, function(part.mesh, part.mask), None)


def filter_colors(
    surface: ColoredSurface, name: str, settings: Any, weld: bool, progress: ProgressCallback
) -> Recolored:
    """Filter the colors of a surface; what has no faces keeps its color.

    Parameters are those of `filter_shape`. Vertices at the same place count as one where their
    colors agree. A corner of an n-gon that lies in several of its triangles gets the mean of what
    they say. Colors that do not change stay bit for bit.
    """
    row = registry.find(name)
    at_vertices, at_corners = (
        _with(settings, function) for function in (row.function(), row.corner_function())
    )
    with reporting(progress):
        return recolor(surface, at_vertices, at_corners, weld, None)


def filter_both(
    surface: PaintedSurface, name: str, settings: Any, weld: bool, progress: ProgressCallback
) -> Both:
    """Filter positions and colors with the same weights; only denoising can."""
    return denoise_both(surface, settings, weld, progress)


def filter_image(
    picture: Picture, name: str, settings: Any, progress: ProgressCallback
) -> Recolored:
    """Filter an image; opacity stays.

    With ``alpha="none"`` in the settings, all four channels are filtered alike, whatever the
    fourth is. Pixels that do not change stay bit for bit.
    """
    function = registry.find(name).function()
    kernel = settings.kernel if isinstance(settings, Denoising) else settings

    def run(pixels: Pixels, alpha: str) -> Pixels:
        chosen = replace(kernel, alpha=alpha) if hasattr(kernel, "alpha") else kernel
        both = replace(settings, kernel=chosen) if settings is not kernel else chosen
        return _with(both, function)(pixels, None)

    with reporting(progress):
        return filter_picture(picture, getattr(kernel, "alpha", "auto"), run, None)


def filter_texture(
    surface: textures.TexturedSurface, name: str, settings: Any, progress: ProgressCallback
) -> textures.Retextured:
    """Filter a texture; opacity stays inside the charts."""
    return getattr(textures, name)(surface, settings, progress)


def _with(settings: Any, function: Callable[..., Any]) -> Callable[..., Any]:
    """Return ``function(*data, mask)``: the filter with these settings, and what follows."""
    if isinstance(settings, Denoising):
        return settings.by(function)
    return lambda *data: function(*data[:-1], settings=settings, mask=data[-1])
