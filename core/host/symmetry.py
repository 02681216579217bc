# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep a mirror-symmetric surface symmetric."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.parallel import blocks
from ..mesh.nearest import nearest_point, point_tree
from .inputs import Floats

_TOLERANCE = 0.01
"""Largest distance of a vertex from its partner's mirror image, in edge lengths."""

_ROWS = 1 << 16
"""Rows that numpy processes at once."""


def mirror_pairs(
    points: Floats,
    triangles: npt.NDArray[np.integer],
    mask: Floats | None,
    axis: int,
) -> npt.NDArray[np.intp]:
    """Find each vertex's partner across the plane through the origin.

    Parameters
    ----------
    points : (n, 3) array of float
    triangles : (m, 3) array of int
    mask : (n,) array of float or None
        Vertices with different masks are not paired, because they may differ on purpose.
    axis : int
        0, 1 or 2: the plane's normal.

    Returns
    -------
    (n,) int
        The partner, the vertex itself if it lies on the plane, or -1 if it has none.
    """
    lengths = np.empty(len(triangles))
    for rows in blocks(len(triangles), _ROWS):
        steps = points[triangles[rows, 0]] - points[triangles[rows, 1]]
        lengths[rows] = np.linalg.norm(steps, axis=1)
    tolerance = _TOLERANCE * lengths.mean()
    mirrored = points.copy()
    mirrored[:, axis] *= -1
    _, found = nearest_point(point_tree(points), mirrored, tolerance)
    partner = np.maximum(found, 0).astype(np.intp)
    paired = (found >= 0) & (partner[partner] == np.arange(len(points)))
    if mask is not None:
        paired &= mask == mask[partner]
    return np.where(paired, partner, -1)


def symmetrise(moves: Floats, partner: npt.NDArray[np.intp], axis: int) -> Floats:
    """Average each pair's moves across the plane; vertices on it stay on it.

    Parameters
    ----------
    moves : (n, 3) array of float
    partner : (n,) array of int
        From `mirror_pairs`.
    axis : int

    Returns
    -------
    (n, 3) float64
    """
    reflected = moves[partner]
    reflected[:, axis] *= -1
    return np.where((partner >= 0)[:, None], 0.5 * (moves + reflected), moves)
