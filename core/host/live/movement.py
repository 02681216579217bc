# SPDX-License-Identifier: GPL-3.0-or-later
"""Movements of vertices that a host program adds to a mesh, and marks that tell if they still fit.

A host keeps these arrays with the mesh, so that they follow its vertices and edges through edits:
new elements get other values, or none. Nodes in the host compute the same as `is_fitting`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

_BITS = 23
"""Bits of a mark: the sum of two marks is exact in float32, which nodes may use."""

_MASK = (1 << _BITS) - 1


_SPREAD = 1023
"""Largest absolute value of the mark of a face: sums of millions are exact in float32."""


@dataclass(frozen=True)
class Connectivity:
    """The connectivity of a mesh.

    Attributes
    ----------
    ends : (e, 2) int
        Vertices of the edges.
    corners : (c,) int
        Vertices of the corners of the faces, face by face.
    starts : (f,) int
        The first corner of each face.
    """

    ends: npt.NDArray[np.integer]
    corners: npt.NDArray[np.integer]
    starts: npt.NDArray[np.integer]

    @property
    def counts(self) -> tuple[int, int]:
        """Return the numbers of edges and faces."""
        return len(self.ends), len(self.starts)


@dataclass(frozen=True)
class Marks:
    """Marks that are stored with a mesh beside its movement.

    Attributes
    ----------
    vertices : (n,) int32
        A scattered number for each vertex, so that different pairs have different sums.
    counts : (n, 3) float32
        The numbers of vertices, edges and faces, the same for each vertex.
    edges : (e,) int32
        The sum of the numbers at the ends of each edge.
    faces : (f, 3) float32
        Scattered whole numbers for each face, whose sums are 0. They are no longer 0 if a face is
        replaced by another one, without numbers or with those of a neighbor.
    places : (n,) int32
        Digest of the position of each vertex.
    """

    vertices: npt.NDArray[np.int32]
    counts: npt.NDArray[np.float32]
    edges: npt.NDArray[np.int32]
    faces: npt.NDArray[np.float32]
    places: npt.NDArray[np.int32]


def movement(old: npt.NDArray[np.float32], new: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return the float32 movement to add to positions to get new ones: (n, 3).

    The sums equal the new positions bit for bit where coordinates change by less than a factor of
    two; elsewhere the error is up to the spacing of floats at the larger one.
    """
    moves = new - old
    for toward in (-np.inf, np.inf):
        near = np.nextafter(moves, np.float32(toward))
        better = (old + moves != new) & (old + near == new)
        moves[better] = near[better]
    return moves


def marks_of(positions: npt.NDArray[np.float32], connectivity: Connectivity) -> Marks:
    """Return the marks of a mesh with these positions: (n, 3)."""
    vertices = _scattered(len(positions))
    counts = np.empty((len(positions), 3), dtype=np.float32)
    counts[:] = len(positions), *connectivity.counts
    edges = _sums(vertices, connectivity)
    faces = _balanced(len(connectivity.starts))
    return Marks(vertices, counts, edges, faces, digests(positions))


def is_fitting(marks: Marks, connectivity: Connectivity) -> bool:
    """Whether a mesh has the connectivity that its marks were made for, in whatever order."""
    counts = np.array([len(marks.vertices), *connectivity.counts], dtype=np.float32)
    if not (marks.counts == counts).all():
        return False
    edges = _sums(marks.vertices, connectivity)
    faces = marks.faces.sum(axis=0, dtype=np.float64)
    return bool((edges == marks.edges).all() and (faces == 0.0).all())


def digests(rows: npt.NDArray[np.float32]) -> npt.NDArray[np.int32]:
    """Return a digest of each row, such as a position: (n,); both zeros have the same."""
    bits = np.ascontiguousarray(rows + np.float32(0.0), dtype=np.float32).view(np.uint32)
    found = np.full(len(bits), 0x9E3779B9, dtype=np.uint32)
    for column in bits.T:
        found ^= column
        found *= np.uint32(0x85EBCA6B)
        found ^= found >> np.uint32(15)
    return found.view(np.int32)


def _sums(vertices: npt.NDArray[np.int32], connectivity: Connectivity) -> npt.NDArray[np.int32]:
    # The marks of edges.
    return vertices[connectivity.ends].sum(axis=1, dtype=np.int32)


def _balanced(count: int) -> npt.NDArray[np.float32]:
    # The marks of faces: (count, 3).
    numbers = _scattered(3 * count).reshape(count, 3).astype(np.int64)
    numbers = numbers % (2 * _SPREAD + 1) - _SPREAD
    share, rest = np.divmod(numbers.sum(axis=0), max(count, 1))
    numbers -= share + (np.arange(count)[:, None] < rest)
    return numbers.astype(np.float32)


def _scattered(count: int) -> npt.NDArray[np.int32]:
    # Distinct numbers from 1, one for each index: multiplying by odd numbers and shifting are
    # one-to-one.
    numbers = np.arange(count, dtype=np.uint64) & np.uint64(_MASK)
    for factor, shift in ((0x2C1B3C6D, 11), (0x297A2D39, 12), (0x6F4F2A35, 11)):
        numbers = numbers * np.uint64(factor) & np.uint64(_MASK)
        numbers ^= numbers >> np.uint64(shift)
    return (numbers + np.uint64(1)).astype(np.int32)
