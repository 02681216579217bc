# SPDX-License-Identifier: GPL-3.0-or-later
"""Edges where faces with any number of corners meet at an angle."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .inputs import Floats

_ROUNDING = 1e-12


def face_normals(
    positions: npt.NDArray[np.float32], corner_vertices: npt.NDArray, starts: npt.NDArray
) -> Floats:
    """Return the faces' unit normals, 0 for faces without area: (number of faces, 3)."""
    sizes = np.diff(np.append(starts, len(corner_vertices)))
    following = np.arange(1, len(corner_vertices) + 1)
    following[starts + sizes - 1] = starts
    # Seen from each face's first corner, so that places far from the origin lose no digits.
    points = positions[corner_vertices].astype(np.float64)
    points -= np.repeat(points[starts], sizes, axis=0)
    normals = np.add.reduceat(np.cross(points, points[following]), starts, axis=0)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0.0)


def sharp_edges(
    normals: Floats,
    starts: npt.NDArray,
    corner_edges: npt.NDArray,
    edges: int,
    angle: float,
) -> npt.NDArray[np.bool_]:
    """Tell which edges have exactly two faces, which meet at more than an angle: (edges,)."""
    faces = np.repeat(np.arange(len(starts)), np.diff(np.append(starts, len(corner_edges))))
    one, other = np.zeros((2, edges), dtype=faces.dtype)
    one[corner_edges[::-1]] = faces[::-1]  # the first face of each edge
    other[corner_edges] = faces  # and the last
    paired = np.flatnonzero(np.bincount(corner_edges, minlength=edges) == 2)
    one, other = one[paired], other[paired]
    solid = normals.any(axis=1)  # faces that have an area
    cosine = np.einsum("ij,ij->i", normals[one], normals[other])
    sharp = np.zeros(edges, dtype=bool)
    sharp[paired] = solid[one] & solid[other] & (cosine < np.cos(angle) - _ROUNDING)
    return sharp
