# SPDX-License-Identifier: GPL-3.0-or-later
"""Filter the colors of a surface, as a host program stores them.

Colors are filtered as light, as Blender blurs them, whether they are stored as linear floats or as
sRGB bytes; unchanged colors keep their bits. Only red, green and blue are filtered.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base.checks import LARGEST
from ..base.progress import ProgressCallback, aside, reporting
from ..base.srgb import decoded, encoded
from ..color.signal_sharpening import width_to_close
from ..errors import InvalidSignal
from ..mesh.calculus import group_means
from ..registry import find
from .inputs import ColoredSurface
from .recolored import Colors, Recolored, recolored
from .welding import welded


def filter_colors(
    surface: ColoredSurface,
    name: str,
    settings: Any,
    weld: bool,
    progress: ProgressCallback | None = None,
) -> Recolored:
    """Filter the colors of a surface; loose vertices keep their color.

    Parameters
    ----------
    surface : ColoredSurface
    name, settings
        As in `geometry.filter_shape`.
    weld : bool
        Whether vertices at the same place count as one where their colors agree; the lowest of
        their masks applies.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    Recolored
        A corner of an n-gon that lies in several of its triangles gets the mean of their results.
        Colors that do not change stay bit for bit.

    Raises
    ------
    ShockError
        See `TriangleMesh` and the filter.
    """
    function = find(name).function(settings.sharpen_time, corners=surface.corners is not None)
    function = partial(function, settings=settings.kernel)
    with reporting(progress):
        check_colors(surface)
        if surface.corners is None:
            part = welded(surface, weld, surface.colors)
            light = light_of(surface)
            values = light[part.used][part.representatives]
            new = light.copy()
            new[part.used] = function(part.mesh, values, mask=part.mask)[part.index]
            return _repainted(surface, _stored(surface, new))
        part = welded(surface, weld)
        result = function(part.mesh, light_of(surface)[surface.corners], mask=part.mask)
        new = _at_corners(light_of(surface), surface.corners, result)
        return _repainted(surface, _stored(surface, new))


def width_of_borders(surface: ColoredSurface, what: str) -> float:
    """Measure the width that sharpening closes by default, in mean edge lengths.

    It is 0 if the colors are sharp already or have no borders.
    """
    check_colors(surface)
    if surface.corners is not None:
        part = welded(surface, weld=True)
        return width_to_close(part.mesh, light_of(surface)[surface.corners], what)
    part = welded(surface, True, surface.colors)
    colors = light_of(surface)[part.used][part.representatives]
    return width_to_close(part.mesh, colors, what)


def check_colors(surface: ColoredSurface) -> None:
    """Raise `InvalidSignal` if no filter can work on the colors."""
    if not np.isfinite(surface.colors).all():
        raise InvalidSignal("The colors hold NaN or infinity; paint over these first.")
    if np.abs(surface.colors).max(initial=0.0) > LARGEST:
        raise InvalidSignal(
            "The colors hold values beyond {most:g}; paint over these first.", most=LARGEST
        )


def repainted_corners(
    surface: ColoredSurface, corners: npt.NDArray[np.int32], values: Colors
) -> Recolored:
    """Write the colors of triangle corners back; `corners` has the index of the color of each."""
    return _repainted(surface, _at_corners(surface.colors, corners, values))


def light_of(surface: ColoredSurface) -> Colors:
    """Return the colors as light; bytes are decoded."""
    return decoded(surface.colors) if surface.levels else surface.colors


def _stored(surface: ColoredSurface, light: Colors) -> Colors:
    return encoded(light) if surface.levels else light


def _at_corners(old: Colors, corners: npt.NDArray[np.int32], values: Colors) -> Colors:
    new = old.copy()
    with aside("Placing colors"):
        group_means(corners.reshape(-1), values.reshape(corners.size, -1), new)
    return new


def _repainted(surface: ColoredSurface, new: Colors) -> Recolored:
    if surface.free is not None:
        new[~surface.free] = surface.colors[~surface.free]
    return recolored(surface.colors, new, surface.levels, _counted(surface))


def _counted(surface: ColoredSurface) -> npt.NDArray[np.bool_] | None:
    # Colors that were filtered; None for all.
    if surface.mask is None:
        return surface.free
    chosen = np.asarray(surface.mask) > 0.0
    if surface.corners is not None:
        at_corners = np.zeros(len(surface.colors), dtype=bool)
        at_corners[surface.corners] = chosen[surface.triangles]
        chosen = at_corners
    return chosen if surface.free is None else chosen & surface.free
