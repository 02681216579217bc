# SPDX-License-Identifier: GPL-3.0-or-later
"""Edges of a mesh that are given by their vertices."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.checks import checked_indices
from ..base.parallel import kernel, run
from ..base.vectors import after
from ..errors import InvalidSignal
from .triangle_mesh import TriangleMesh

_Bools = npt.NDArray[np.bool_]


def checked_edges(mesh: TriangleMesh, edges: npt.ArrayLike) -> npt.NDArray[np.int64]:
    """Return pairs of vertices as (k, 2) int64, or raise `InvalidSignal`."""
    pairs = checked_indices(edges, mesh.vertex_count, "vertices of the edges", "vertex")
    if pairs.size == 0:
        return np.zeros((0, 2), dtype=np.int64)
    if pairs.ndim != 2 or pairs.shape[1] != 2:
        raise InvalidSignal(f"The edges have the shape {pairs.shape}; give (k, 2) vertices.")
    return pairs


def half_edges_between(mesh: TriangleMesh, pairs: npt.NDArray[np.int64]) -> tuple[_Bools, _Bools]:
    """Find the edges between pairs of vertices.

    Returns
    -------
    half : (m, 3) bool
        The half-edges of these edges, of both sides.
    joined : (k,) bool
        The pairs that an edge joins.
    """
    half = np.zeros(mesh.faces.shape, dtype=np.bool_)
    joined = np.zeros(len(pairs), dtype=np.bool_)
    run(_find, len(pairs), pairs, mesh.faces, *mesh.corners, half, joined)
    return half, joined


@kernel
def _find(start, stop, pairs, faces, corner_start, corners, half, joined):
    # Among the faces around the first vertex.
    for i in range(start, stop):
        v, w = pairs[i, 0], pairs[i, 1]
        for c in range(corner_start[v], corner_start[v + 1]):
            f = corners[c] // 3
            k = corners[c] - 3 * f
            if faces[f, after(k)] == w:
                half[f, k] = joined[i] = True
            if faces[f, after(after(k))] == w:
                half[f, after(after(k))] = joined[i] = True
