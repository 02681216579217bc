# SPDX-License-Identifier: GPL-3.0-or-later
"""Charts of a texture atlas: which faces hang together in the texture (paper B, section 3.1).

Points in the texture are (row, column) in texels; texel centres are at whole numbers, so that
u = 0 is at column -1/2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..errors import InvalidUV
from ..mesh import Floats, Ints, TriangleMesh
from ..parallel import Progress, kernel, run

MOST_REPEATS = 16.0
"""Largest area of all faces in the texture, in areas of the image."""

_SAME = 1e-3  # corners this near, in texels, are one point of the texture
_FLAT = 1e-9  # area in squared texels below which a face has no area in the texture


@dataclass(frozen=True)
class Charts:
    """The faces in the texture, cut into charts.

    Attributes
    ----------
    points : (m, 3, 2) float64
        Corners as (row, column) in texels, each chart moved by whole images to where the middle
        of its box lies in the image.
    labels : (m,) int32
        The chart of each face, numbered by first face.
    boxes : (charts, 2, 2) float64
        Lowest and highest (row, column) of each chart.
    borders : (k,) int32
        Half-edges at which charts end: seams and borders of the mesh.
    areas : (m,) float64
        Signed areas in squared texels; negative for mirrored faces.
    outside : (m,) bool
        Faces with corners outside the image, before charts were moved.
    """

    points: Floats
    labels: Ints
    boxes: Floats
    borders: Ints
    areas: Floats
    outside: npt.NDArray[np.bool_]

    @property
    def count(self) -> int:
        """Number of charts."""
        return len(self.boxes)


def find_charts(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    height: int,
    width: int,
    progress: Progress | None = None,
) -> Charts:
    """Cut the faces of a mesh into charts.

    Neighbouring faces are in one chart if their corners meet in the texture and none is folded
    over the other.

    Raises
    ------
    InvalidUV
        If the coordinates do not fit the mesh, are not finite, have no area, or repeat the
        image more than `MOST_REPEATS` times.
    """
    coordinates = mesh.own_corners(_checked_uv(uv, mesh.face_count))
    low = coordinates.min(axis=1)
    high = coordinates.max(axis=1)
    slack = 1e-6
    outside = (low < -slack).any(axis=1) | (high > 1 + slack).any(axis=1)
    phase = progress or Progress(None)
    phase.update(0.3)
    points = np.empty_like(coordinates)
    points[..., 0] = coordinates[..., 1] * height - 0.5
    points[..., 1] = coordinates[..., 0] * width - 0.5
    areas = _signed_areas(points)
    repeats = np.abs(areas).sum() / (height * width)
    if not (np.abs(areas) > _FLAT).any():
        raise InvalidUV("All faces have zero area in the texture; unwrap the mesh first.")
    if repeats > MOST_REPEATS:
        raise InvalidUV(
            f"The faces cover the image {repeats:.0f} times, at most {MOST_REPEATS:.0f} are"
            " possible; unwrap the mesh into a texture that is not tiled."
        )
    phase.update(0.5)
    labels = np.full(mesh.face_count, -1, dtype=np.int32)
    seams = np.empty(3 * mesh.face_count, dtype=np.bool_)
    run(_mark_seams, mesh.face_count, mesh.twins, points, areas, seams)
    count = _label(mesh.twins, seams, labels)
    phase.update(0.8)
    boxes = np.empty((count, 2, 2))
    boxes[:, 0] = np.inf
    boxes[:, 1] = -np.inf
    _measure_boxes(points, labels, boxes)
    tiles = np.floor((boxes.mean(axis=1) + 0.5) / (height, width)) * (height, width)
    boxes -= tiles[:, None]
    points -= tiles[labels][:, None]
    borders = np.flatnonzero(seams).astype(np.int32)
    return Charts(points, labels, boxes, borders, areas, outside)


def degenerate_faces(charts: Charts) -> npt.NDArray[np.bool_]:
    """Faces without area in the texture: (m,) bool."""
    return np.abs(charts.areas) <= _FLAT


def _checked_uv(uv: npt.ArrayLike, face_count: int) -> Floats:
    if uv is None:
        raise InvalidUV("The mesh has no texture coordinates; unwrap it first.")
    try:
        array = np.asarray(uv)
    except ValueError as error:  # rows of different lengths
        raise InvalidUV("Texture coordinates are not numbers; give an (m, 3, 2) array.") from error
    if array.dtype.kind not in "fiu":
        raise InvalidUV(f"Texture coordinates are of type {array.dtype}; give floats.")
    if array.shape != (face_count, 3, 2):
        raise InvalidUV(
            f"Texture coordinates have the shape {array.shape}; give one pair for each corner of"
            f" each face, ({face_count}, 3, 2)."
        )
    array = array.astype(np.float64, order="C")
    finite = np.isfinite(array).all(axis=(1, 2))
    if not finite.all():
        raise InvalidUV(
            f"Texture coordinates are NaN or infinite at {np.count_nonzero(~finite)} of"
            f" {face_count} faces, the first is face {int(np.argmin(finite))}; unwrap them again."
        )
    if np.abs(array).max() > 1e6:
        raise InvalidUV("Texture coordinates reach beyond 1e6; unwrap the mesh again.")
    return array


def _signed_areas(points: Floats) -> Floats:
    a = points[:, 1] - points[:, 0]
    b = points[:, 2] - points[:, 0]
    # (row, column) is left-handed: columns go along u, rows along v.
    return 0.5 * (a[:, 1] * b[:, 0] - a[:, 0] * b[:, 1])


@kernel
def _near(points, f, k, g, j):
    return (
        abs(points[f, k, 0] - points[g, j, 0]) < _SAME
        and abs(points[f, k, 1] - points[g, j, 1]) < _SAME
    )


@kernel
def _mark_seams(start, stop, twins, points, areas, seams):
    for f in range(start, stop):
        for k in range(3):
            t = twins[f, k]
            joined = False
            if t >= 0:
                g = t // 3
                j = t - 3 * g
                joined = _near(points, f, k, g, (j + 1) % 3) and _near(points, f, (k + 1) % 3, g, j)
                if min(abs(areas[f]), abs(areas[g])) > _FLAT:
                    joined = joined and areas[f] * areas[g] > 0  # not folded over
            seams[3 * f + k] = not joined


@kernel
def _label(twins, seams, labels):
    queue = np.empty(labels.shape[0], np.int32)
    count = 0
    for seed in range(labels.shape[0]):
        if labels[seed] >= 0:
            continue
        labels[seed] = count
        queue[0] = seed
        head, tail = 0, 1
        while head < tail:
            f = queue[head]
            head += 1
            for k in range(3):
                if seams[3 * f + k]:
                    continue
                g = twins[f, k] // 3
                if labels[g] < 0:
                    labels[g] = count
                    queue[tail] = g
                    tail += 1
        count += 1
    return count


@kernel
def _measure_boxes(points, labels, boxes):
    for f in range(labels.shape[0]):
        box = boxes[labels[f]]
        for k in range(3):
            for axis in range(2):
                box[0, axis] = min(box[0, axis], points[f, k, axis])
                box[1, axis] = max(box[1, axis], points[f, k, axis])
