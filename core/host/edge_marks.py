# SPDX-License-Identifier: GPL-3.0-or-later
"""Edges to mark: where faces with any number of corners meet at an angle, and those of creases."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .inputs import Floats

_ROUNDING = 1e-12

_ROWS = 1 << 16
"""Faces that numpy processes at once."""


@dataclass(frozen=True)
class CreaseEdges:
    """Edges of creases, between places at which one or several vertices lie.

    Attributes
    ----------
    places : (n,) int
        The place of each vertex of the surface; -1 for vertices without faces.
    pairs : (k, 2) int
        Edges, as pairs of places.
    """

    places: npt.NDArray[np.integer]
    pairs: npt.NDArray[np.integer]

    def among(self, ends: npt.NDArray[np.integer]) -> npt.NDArray[np.bool_]:
        """Tell which edges, given by their vertices (e, 2), they are: (e,)."""
        found = np.zeros(len(ends), dtype=bool)
        if len(self.pairs):
            # Few edges have both ends at creases; the others are excluded quickly.
            at_creases = np.zeros(self.places.max(initial=0) + 2, dtype=bool)
            at_creases[self.pairs] = True
            vertices = at_creases[self.places]
            near = np.flatnonzero(vertices[ends[:, 0]] & vertices[ends[:, 1]])
            found[near] = np.isin(_keys(self.places[ends[near]]), _keys(self.pairs))
        return found

    def owners_among(
        self, ends: npt.NDArray[np.integer], owners: npt.NDArray[np.intp]
    ) -> npt.NDArray[np.intp]:
        """Return, for each edge (e, 2), the owner (of k) of its pair; -1 for edges of no pair."""
        keys = _keys(self.pairs)
        order = np.argsort(keys, kind="stable")
        wanted = _keys(self.places[ends])
        at = np.searchsorted(keys[order], wanted)
        at[at == len(keys)] = 0
        found = np.full(len(ends), -1, dtype=np.intp)
        if len(keys):
            same = keys[order][at] == wanted
            found[same] = owners[order][at[same]]
        return found


def _keys(pairs: npt.NDArray[np.integer]) -> npt.NDArray[np.int64]:
    return pairs.min(axis=1).astype(np.int64) << 32 | pairs.max(axis=1).astype(np.int64)


def face_normals(
    positions: npt.NDArray[np.float32], corner_vertices: npt.NDArray, starts: npt.NDArray
) -> Floats:
    """Return the faces' unit normals, 0 for faces without area: (number of faces, 3)."""
    normals = np.zeros((len(starts), 3))
    ends = np.append(starts[1:], len(corner_vertices))
    for first in range(0, len(starts), _ROWS):
        rows = slice(first, first + _ROWS)
        begin, sizes = starts[rows] - starts[first], ends[rows] - starts[rows]
        corners = corner_vertices[starts[first] : ends[rows][-1]]
        following = np.arange(1, len(corners) + 1)
        following[begin + sizes - 1] = begin
        # Seen from each face's first corner, so that places far from the origin lose no digits.
        points = positions[corners].astype(np.float64)
        points -= np.repeat(points[begin], sizes, axis=0)
        sums = np.add.reduceat(np.cross(points, points[following]), begin, axis=0)
        lengths = np.linalg.norm(sums, axis=1, keepdims=True)
        np.divide(sums, lengths, out=normals[rows], where=lengths > 0.0)
    return normals


def faces_at(
    free: npt.NDArray[np.bool_], corner_vertices: npt.NDArray, starts: npt.NDArray
) -> tuple[npt.NDArray[np.bool_], npt.NDArray]:
    """Choose the faces that may have an edge between free vertices.

    Returns
    -------
    corners : (number of corners,) bool
        Corners of the chosen faces.
    starts : (number of chosen faces,) int
        Their first corners among these.
    """
    sizes = np.diff(np.append(starts, len(corner_vertices)))
    chosen = np.add.reduceat(free[corner_vertices].astype(np.int32), starts) >= 2
    own = sizes[chosen]
    return np.repeat(chosen, sizes), np.cumsum(own) - own


def sharp_edges(
    normals: Floats,
    starts: npt.NDArray,
    corner_edges: npt.NDArray,
    edges: int,
    angle: float,
) -> npt.NDArray[np.bool_]:
    """Return which edges have exactly two faces that meet at more than an angle: (edges,)."""
    sizes = np.diff(np.append(starts, len(corner_edges)))
    faces = np.repeat(np.arange(len(starts), dtype=np.int32), sizes)
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
