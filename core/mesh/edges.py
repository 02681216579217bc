# SPDX-License-Identifier: GPL-3.0-or-later
"""Edges of a mesh that are given by their vertices."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.checks import checked_indices
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
    ends = np.stack([mesh.faces, mesh.faces[:, (1, 2, 0)]], axis=-1)
    keys, wanted = (
        each.min(axis=-1) * np.int64(mesh.vertex_count) + each.max(axis=-1)
        for each in (ends, pairs)
    )
    half = _among(keys, wanted)
    return half, np.isin(wanted, keys[half])


def _among(keys: npt.NDArray[np.int64], wanted: npt.NDArray[np.int64]) -> _Bools:
    # As `np.isin`, which sorts all keys, where few are wanted.
    known = np.unique(wanted)
    if len(known) == 0:
        return np.zeros(keys.shape, dtype=bool)
    places = np.searchsorted(known, keys)
    return known[np.minimum(places, len(known) - 1)] == keys
