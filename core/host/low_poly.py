# SPDX-License-Identifier: GPL-3.0-or-later
"""Make a crisp low poly of a surface as a host program keeps it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from ..base.findings import tell
from ..base.progress import ProgressCallback, reporting
from ..settings import GeometrySettings
from ..shape.low_poly import LowPoly, crisp_low_poly
from .creases import places_of
from .inputs import CutSurface
from .welding import welded

_MOST_LOST = 0.1
"""Share of the volume; if a low poly loses more, this is reported."""


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
        Cuts are kept. A mask is ignored.
    settings, weld
        As in `geometry.filter_shape`.
    tolerance, turn : float
        In mean edge lengths and degrees.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.
    """
    with reporting(progress):
        part = welded(surface, weld)
        cuts = places_of(part)[surface.cuts]
        low = crisp_low_poly(part.mesh, settings, tolerance=tolerance, turn=turn, keep=cuts)
        _tell_lost(part.mesh.vertices, part.mesh.faces, low)
        return replace(low, vertices=surface.from_world(low.vertices))


def _tell_lost(vertices: npt.NDArray, faces: npt.NDArray, low: LowPoly) -> None:
    # A tolerance in mean edge lengths is large for small parts.
    before, after = _volume(vertices, faces), _volume(low.vertices, low.faces)
    if before > 0 and _is_closed(faces) and after < (1.0 - _MOST_LOST) * before:
        tell(
            "It has lost {percent}% of the volume: round parts were cut off. Lower Tolerance, or"
            " remesh the original first.",
            percent=round(100.0 * (1.0 - after / before)),
        )


def _volume(vertices: npt.NDArray, faces: npt.NDArray) -> float:
    a, b, c = np.moveaxis((vertices - vertices.mean(axis=0))[faces], 1, 0)
    return float((np.cross(a, b) * c).sum() / 6.0)


def _is_closed(faces: npt.NDArray) -> bool:
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    _, counts = np.unique(ends, axis=0, return_counts=True)
    return bool((counts % 2 == 0).all())
