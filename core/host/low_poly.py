# SPDX-License-Identifier: GPL-3.0-or-later
"""Make a crisp low poly of a surface as a host program keeps it."""

from __future__ import annotations

from dataclasses import replace

from ..base.progress import ProgressCallback, reporting
from ..settings import GeometrySettings
from ..shape.low_poly import LowPoly, crisp_low_poly
from .creases import places_of
from .inputs import CutSurface
from .welding import welded


def low_poly_of(
    surface: CutSurface,
    settings: GeometrySettings,
    weld: bool,
    tolerance: float,
    turn: float,
    progress: ProgressCallback | None = None,
) -> LowPoly:
    """Make a crisp low poly of a surface, in its own space; see `crisp_low_poly`.

    Parameters
    ----------
    surface : CutSurface
        Cuts are kept. A mask does not count.
    settings, weld
        Those of `geometry.filter_shape`.
    tolerance, turn : float
        In mean edge lengths and degrees.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.
    """
    with reporting(progress):
        part = welded(surface, weld)
        cuts = places_of(part)[surface.cuts]
        low = crisp_low_poly(part.mesh, settings, tolerance=tolerance, turn=turn, keep=cuts)
        return replace(low, vertices=surface.from_world(low.vertices))
