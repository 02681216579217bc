# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpen the colors on a surface as Blender keeps them. Needs no bpy.

Colors are filtered as they are stored, so that reading and writing them changes nothing: byte
colors as sRGB values, float colors as linear ones. Only red, green and blue take part.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .. import core
from .recolored import Colors, Recolored, recolored
from .surface import Surface, welded


@dataclass(frozen=True)
class ColoredSurface(Surface):
    """A mesh object's geometry and colors.

    Attributes
    ----------
    colors : (k, 3) float32
        Of the vertices, or of the face corners if `corners` is given.
    corners : (m, 3) int32 or None
        Which face corner each corner of the triangles is.
    free : (k,) bool or None
        False protects a face corner, whatever the mask says.
    levels : int
        Byte colors have 255 steps; 0 for float colors.
    """

    colors: Colors
    corners: npt.NDArray[np.int32] | None
    free: npt.NDArray[np.bool_] | None
    levels: int


def sharpen_colors(
    surface: ColoredSurface,
    settings: core.ShockSettings,
    weld: bool,
    progress: Callable[[float, str], bool] | None,
) -> Recolored:
    """Sharpen the colors of a surface; what has no faces keeps its color.

    Parameters
    ----------
    surface : ColoredSurface
    settings : core.ShockSettings
    weld : bool
        Vertices at exactly the same place count as one where their colors agree; of their masks
        the lowest counts.
    progress : callable or None
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    Recolored
        A corner of an n-gon that lies in several of its triangles gets the mean of what they
        say. Colors that do not change stay bit for bit.

    Raises
    ------
    core.ShockError
        See `core.TriangleMesh`, `core.sharpen_vertex_signal` and `core.sharpen_corner_signal`.
    """
    if not np.isfinite(surface.colors).all():
        raise core.InvalidSignal("The colors hold NaN or infinity; paint over these first.")
    new = surface.colors.copy()
    if surface.corners is None:
        part = welded(surface, weld, surface.colors)
        values = surface.colors[part.used][part.representatives]
        result = core.sharpen_vertex_signal(part.mesh, values, settings, part.mask, progress)
        new[part.used] = result[part.index]
    else:
        part = welded(surface, weld)
        values = surface.colors[surface.corners]
        result = core.sharpen_corner_signal(part.mesh, values, settings, part.mask, progress)
        _gather(surface.corners, result, new)
    if surface.free is not None:
        new[~surface.free] = surface.colors[~surface.free]
    return recolored(surface.colors, new, surface.levels)


def _gather(corners: npt.NDArray[np.int32], values: Colors, new: Colors) -> None:
    flat = corners.reshape(-1)
    count = np.bincount(flat, minlength=len(new))
    inside = count > 0
    for channel in range(new.shape[1]):
        weights = values[..., channel].reshape(-1)
        total = np.bincount(flat, weights, minlength=len(new))
        new[inside, channel] = total[inside] / count[inside]
