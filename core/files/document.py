# SPDX-License-Identifier: GPL-3.0-or-later
"""The common parts of mesh formats: the document that a file becomes, normals, side files."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from ..errors import InvalidMesh

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
Names = npt.NDArray[np.str_]

NO_FACES: Ints = np.empty((0, 3), dtype=np.int64)
NEW_NORMALS = "normals were computed anew from the changed surface"


class Document(Protocol):
    """A file in memory: all its vertices, its triangles, and the object that each belongs to."""

    vertices: Floats
    faces: Ints
    parts: Ints

    def own_files(self, target: Path) -> Collection[str]:
        """Names of files beside `target` that writing it may replace: none by default."""
        return ()

    def save(self, path: Path, positions: Floats, moved: Bools) -> list[str]:
        """Write the file with other positions; returns notes on what changed or was lost."""

    def read_back(self, path: Path) -> Floats | None:
        """Positions in a file that was just written; None if their order may differ.

        Raises ValueError, or whatever a reader raises, if the file cannot be read completely.
        """


class InPlaceDocument(Document, Protocol):
    """A file that keeps its format, whose vertex colors can be replaced."""

    def read_colors(self) -> Floats:
        """Red, green and blue of each vertex in [0, 1], for any type; NaN without a color."""

    def save_colors(self, path: Path, colors: Floats) -> tuple[int, list[str]]:
        """Write the file with other colors; returns how many vertices changed, and notes."""

    def read_uvs(self) -> tuple[Floats, Names]:
        """Coordinates of the triangles' corners (t, 3, 2), v up, NaN without any; materials."""

    def moved_colors(self) -> Mapping[str, str]:
        """Materials whose color these coordinates do not show where it is, and why: none here."""
        return {}


def stored(values: Floats, kind: np.dtype[Any]) -> npt.NDArray[Any]:
    """Positions after rounding to a type."""
    with np.errstate(over="ignore"):
        result = values.astype(kind)
    if not np.isfinite(result).all():
        raise InvalidMesh(
            f"Positions as large as {abs(values).max():.3g} do not fit into this format; scale the"
            " mesh down."
        )
    return result


def joined(
    vertices: list[Floats], faces: list[Ints], parts: list[int]
) -> tuple[Floats, Ints, Ints]:
    """Vertices, triangles and parts of several objects in one document; `parts` are numbers."""
    counts = [len(triangles) for triangles in faces]
    return (
        np.vstack([np.empty((0, 3)), *vertices]),
        np.vstack([NO_FACES, *faces]),
        np.repeat(np.array(parts, dtype=np.int64), counts),
    )


def to_unit(values: npt.NDArray[Any], kind: np.dtype[Any]) -> Floats:
    """Numbers of a type as floats; whole numbers are divided by the type's maximum."""
    return values / np.float64(np.iinfo(kind).max if kind.kind in "iu" else 1)


def from_unit(values: Floats, kind: np.dtype[Any]) -> Floats:
    """The inverse of :func:`to_unit`; whole numbers are rounded."""
    return np.rint(values * np.iinfo(kind).max) if kind.kind in "iu" else values


def renewed_normals(positions: Floats, triangles: Ints, keys: Ints, old: Floats) -> Floats:
    """Mean normal, weighted by area, of the triangle corners that share a key.

    `triangles` and `keys` are (t, 3); a key without area keeps its row of `old`, and no normal
    changes sides.
    """
    a, b, c = (positions[triangles[:, corner]] for corner in range(3))
    crosses = np.cross(b - a, c - a)
    sums = np.zeros_like(old)
    for corner in range(3):
        for axis in range(3):
            sums[:, axis] += np.bincount(keys[:, corner], crosses[:, axis], minlength=len(old))
    sums[np.einsum("ij,ij->i", sums, old) < 0] *= -1.0  # faces wound against their normals
    return np.where(sums.any(axis=1, keepdims=True), unit(sums), old)


def renewed_vertex_normals(before: Floats, after: Floats, triangles: Ints, old: Floats) -> Floats:
    """New vertex normals; split vertices with equal position and normal stay equal."""
    kept, key = np.unique(np.hstack([before, old]), axis=0, return_inverse=True)
    key = key.reshape(-1)
    return renewed_normals(after, triangles, key[triangles], kept[:, 3:])[key]


def decimal(values: Iterable[float]) -> bytes:
    """Write numbers as text, with more digits than float32 has, but not all of a float64."""
    return b" ".join(b"%.12g" % value for value in values)


def transformed(points: npt.NDArray[Any], matrix: Floats) -> Floats:
    """Apply a 4x4 matrix to points; the identity keeps them bit for bit."""
    if np.array_equal(matrix, np.eye(4)):
        return points.astype(np.float64)
    with np.errstate(invalid="ignore"):  # infinite points are refused by a sentence
        moved: Floats = points @ matrix[:3, :3].T + matrix[:3, 3]
    return moved


def is_invertible(matrix: Floats) -> bool:
    """Whether a matrix can be inverted for points."""
    with np.errstate(all="ignore"):
        return bool(np.isfinite(matrix).all() and np.linalg.det(matrix))


def unit(vectors: npt.NDArray[Any]) -> Floats:
    """Normalize vectors; zero stays zero."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(lengths > 0, lengths, 1.0)
