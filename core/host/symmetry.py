# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep a mirror-symmetric surface symmetric, and its halves closed. Needs no bpy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

_TOLERANCE = 0.01
"""How far from its partner's mirror image a vertex may lie, in edge lengths."""

_ROWS = 1 << 16
"""Rows that numpy and scipy get at once."""


def mirror_pairs(
    points: Floats,
    triangles: npt.NDArray[np.integer],
    mask: Floats | None,
    axis: int,
    progress: Callable[[float, str], bool] | None = None,
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
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    (n,) int
        The partner, the vertex itself if it lies on the plane, or -1 if it has none.
    """
    from scipy.spatial import cKDTree

    from ..base.parallel import Progress, blocks

    phase = Progress.of(progress).part(1.0, 1.0, "Placing vertices")
    lengths = np.empty(len(triangles))
    for rows in blocks(len(triangles), _ROWS, phase):
        steps = points[triangles[rows, 0]] - points[triangles[rows, 1]]
        lengths[rows] = np.linalg.norm(steps, axis=1)
    tolerance = _TOLERANCE * lengths.mean()
    mirrored = points.copy()
    mirrored[:, axis] *= -1
    tree = cKDTree(points, compact_nodes=False, balanced_tree=False)
    distance = np.empty(len(points))
    partner = np.empty(len(points), dtype=np.intp)
    for rows in blocks(len(points), _ROWS, phase):
        distance[rows], partner[rows] = tree.query(
            mirrored[rows], workers=-1, distance_upper_bound=2.0 * tolerance
        )
    partner[partner == len(points)] = 0  # none is near
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


@dataclass(frozen=True)
class MirrorPlane:
    """A plane at which a modifier joins a surface with its mirror image.

    Attributes
    ----------
    normal : (3,) float64
        Points in the plane have ``points @ normal + offset == 0``.
    offset : float
    reach : float
        Points up to this value on either side belong to the plane.
    """

    normal: Floats
    offset: float
    reach: float

    def hold(self, moves: Floats, points: Floats) -> Floats:
        """Let the points that belong to the plane move along it only: (n, 3)."""
        inside = np.abs(points @ self.normal + self.offset) <= self.reach
        along = self.normal / (self.normal @ self.normal)
        held = moves[inside] - np.outer(moves[inside] @ self.normal, along)
        result = moves.copy()
        result[inside] = held
        return result
