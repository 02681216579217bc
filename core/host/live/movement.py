# SPDX-License-Identifier: GPL-3.0-or-later
"""Movements of vertices that a host program adds to a mesh, and what tells whether they still fit.

A host keeps these arrays with the mesh, so that they follow its vertices and edges through edits:
new elements get other values, or none. `is_fitting` is what nodes in the host compute, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

_BITS = 23
"""Of a mark: the sum of two is exact in float32, in which nodes may calculate."""

_MASK = (1 << _BITS) - 1


@dataclass(frozen=True)
class Marks:
    """What is kept of a mesh beside its movement.

    Attributes
    ----------
    vertices : (n,) int32
        A number for each vertex, scattered, so that other pairs have other sums.
    counts : (n, 3) float32
        The numbers of vertices, edges and faces, the same for each vertex.
    edges : (e,) int32
        The sum of the numbers at the ends of each edge.
    places : (n,) int32
        Digest of the position of each vertex.
    """

    vertices: npt.NDArray[np.int32]
    counts: npt.NDArray[np.float32]
    edges: npt.NDArray[np.int32]
    places: npt.NDArray[np.int32]


def movement(old: npt.NDArray[np.float32], new: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return what is added to positions in float32 to get new ones: (n, 3).

    The sums are the new positions to the bit where coordinates change by less than a factor of two;
    elsewhere they may be off by the spacing of floats at the larger one.
    """
    moves = new - old
    for toward in (-np.inf, np.inf):
        near = np.nextafter(moves, np.float32(toward))
        better = (old + moves != new) & (old + near == new)
        moves[better] = near[better]
    return moves


def marks_of(
    positions: npt.NDArray[np.float32], ends: npt.NDArray[np.integer], faces: int
) -> Marks:
    """Return the marks of a mesh.

    Parameters
    ----------
    positions : (n, 3) float32
    ends : (e, 2) int
        Vertices of the edges.
    faces : int
        How many faces there are.
    """
    vertices = _scattered(len(positions))
    counts = np.empty((len(positions), 3), dtype=np.float32)
    counts[:] = len(positions), len(ends), faces
    return Marks(vertices, counts, vertices[ends].sum(axis=1, dtype=np.int32), places(positions))


def is_fitting(marks: Marks, ends: npt.NDArray[np.integer], faces: int) -> bool:
    """Whether a mesh has the connectivity that its marks were made for, in whatever order."""
    counts = np.array([len(marks.vertices), len(ends), faces], dtype=np.float32)
    if not (marks.counts == counts).all():
        return False
    return bool((marks.vertices[ends].sum(axis=1, dtype=np.int32) == marks.edges).all())


def places(positions: npt.NDArray[np.float32]) -> npt.NDArray[np.int32]:
    """Return a digest of each position: (n,); both zeros have the same."""
    bits = np.ascontiguousarray(positions + np.float32(0.0), dtype=np.float32).view(np.uint32)
    found = np.full(len(bits), 0x9E3779B9, dtype=np.uint32)
    for column in bits.T:
        found ^= column
        found *= np.uint32(0x85EBCA6B)
        found ^= found >> np.uint32(15)
    return found.view(np.int32)


def _scattered(count: int) -> npt.NDArray[np.int32]:
    # Different numbers from 1, for as many as there are; multiplying by odd ones and shifting
    # are one to one.
    numbers = np.arange(count, dtype=np.uint64) & np.uint64(_MASK)
    for factor, shift in ((0x2C1B3C6D, 11), (0x297A2D39, 12), (0x6F4F2A35, 11)):
        numbers = numbers * np.uint64(factor) & np.uint64(_MASK)
        numbers ^= numbers >> np.uint64(shift)
    return (numbers + np.uint64(1)).astype(np.int32)
