# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep a mirror-symmetric surface symmetric. Needs no bpy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

_TOLERANCE = 0.01
"""How far from its partner's mirror image a vertex may lie, in edge lengths."""


def mirror_pairs(
    points: Floats, triangles: npt.NDArray[np.integer], mask: Floats | None, axis: int
) -> npt.NDArray[np.intp]:
    """Find each vertex's partner across the plane through the origin.

    Parameters
    ----------
    points : (n, 3) array of float
    triangles : (m, 3) array of int
    mask : (n,) array of float or None
        Vertices with different masks are no pair: the person wants them to differ.
    axis : int
        0, 1 or 2: the plane's normal.

    Returns
    -------
    (n,) int
        The partner, the vertex itself if it lies on the plane, or -1 if it has none.
    """
    from scipy.spatial import cKDTree

    edges = points[triangles[:, 0]] - points[triangles[:, 1]]
    tolerance = _TOLERANCE * np.linalg.norm(edges, axis=1).mean()
    mirrored = points.copy()
    mirrored[:, axis] *= -1
    distance, partner = cKDTree(points).query(mirrored, workers=-1)
    mutual = partner[partner] == np.arange(len(points))
    paired = mutual & (distance <= tolerance)
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
