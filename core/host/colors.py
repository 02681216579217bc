# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpen the colors on a surface as Blender keeps them. Needs no bpy.

Colors are filtered as they are stored, so that reading and writing them changes nothing: byte
colors as sRGB values, float colors as linear ones. Only red, green and blue take part.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ... import core
from .recolored import Colors, Recolored, recolored
from .welding import Surface, welded

ColorFilter = Callable[[Any, Colors, "npt.NDArray | None"], Colors]


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

    def at_vertices(mesh: core.TriangleMesh, values: Colors, mask: npt.NDArray | None) -> Colors:
        return core.sharpen_vertex_signal(mesh, values, settings, mask, progress)

    def at_corners(mesh: core.TriangleMesh, values: Colors, mask: npt.NDArray | None) -> Colors:
        return core.sharpen_corner_signal(mesh, values, settings, mask, progress)

    return filter_colors(surface, at_vertices, at_corners, weld, progress)


def filter_colors(
    surface: ColoredSurface,
    at_vertices: ColorFilter,
    at_corners: ColorFilter,
    weld: bool,
    progress: Callable[[float, str], bool] | None,
) -> Recolored:
    """Filter the colors of a surface; see `sharpen_colors`.

    Parameters
    ----------
    surface, weld, progress
        As there.
    at_vertices, at_corners : callable
        ``function(mesh, colors, mask)`` for colors of vertices, and of the corners of triangles.
    """
    check_colors(surface)
    new = surface.colors.copy()
    if surface.corners is None:
        part = welded(surface, weld, progress, surface.colors)
        values = surface.colors[part.used][part.representatives]
        new[part.used] = at_vertices(part.mesh, values, part.mask)[part.index]
        return _repainted(surface, new, progress)
    part = welded(surface, weld, progress)
    result = at_corners(part.mesh, surface.colors[surface.corners], part.mask)
    return repainted_corners(surface, surface.corners, result, progress)


def check_colors(surface: ColoredSurface) -> None:
    """Refuse what no filter can work on."""
    from ..base.checks import LARGEST

    if not np.isfinite(surface.colors).all():
        raise core.InvalidSignal("The colors hold NaN or infinity; paint over these first.")
    if np.abs(surface.colors).max(initial=0.0) > LARGEST:
        raise core.InvalidSignal(
            "The colors hold values beyond {most:g}; paint over these first.", most=LARGEST
        )


def repainted_corners(
    surface: ColoredSurface,
    corners: npt.NDArray[np.int32],
    values: Colors,
    progress: Callable[[float, str], bool] | None,
) -> Recolored:
    """Bring new colors of the corners of triangles back; `corners` says which color each has."""
    from ..base.parallel import Progress
    from ..mesh.calculus import group_means

    new = surface.colors.copy()
    phase = Progress.of(progress).part(1.0, 1.0, "Placing colors")
    group_means(corners.reshape(-1), values.reshape(corners.size, -1), new, phase)
    return _repainted(surface, new, progress)


def _repainted(
    surface: ColoredSurface, new: Colors, progress: Callable[[float, str], bool] | None
) -> Recolored:
    if surface.free is not None:
        new[~surface.free] = surface.colors[~surface.free]
    return recolored(surface.colors, new, surface.levels, progress)
