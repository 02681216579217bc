# SPDX-License-Identifier: GPL-3.0-or-later
"""Charts of a texture atlas: which faces hang together in the texture (paper B, section 3.1).

Points in the texture are (row, column) in texels; texel centres are at whole numbers, so that
u = 0 is at column -1/2.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..base.progress import phase
from ..errors import InvalidUV
from ..mesh.triangle_mesh import Floats, Ints, TriangleMesh

MOST_REPEATS = 16.0
"""Largest area of all faces in the texture, in areas of the image."""

_SAME = 1e-3  # corners this near, in texels, are one point of the texture
_FLAT = 1e-9  # area in squared texels below which a face has no area in the texture
_SLACK = 1e-6  # how far texture coordinates may leave the image unnoticed


class Charts(NamedTuple):
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
        Faces with corners outside the image, wherever whole tiles have moved their charts.
    """

    points: Floats
    labels: Ints
    boxes: Floats
    borders: Ints
    areas: Floats
    outside: npt.NDArray[np.bool_]


def find_charts(mesh: TriangleMesh, uv: npt.ArrayLike, height: int, width: int) -> Charts:
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
    points = np.empty_like(coordinates)
    areas = np.empty(mesh.face_count)
    with phase(0.2, 0.5, "Finding charts"):
        run(_place_faces, mesh.face_count, coordinates, height, width, points, areas)
    _check_areas(areas, height * width)
    seams = np.empty(3 * mesh.face_count, dtype=np.bool_)
    with phase(0.5, 0.8, "Finding charts"):
        run(_mark_seams, mesh.face_count, mesh.twins, points, areas, seams)
    labels = np.full(mesh.face_count, -1, dtype=np.int32)
    boxes = np.empty((_label(mesh.twins, seams, labels), 2, 2))
    with phase(0.9, 1.0, "Finding charts"):
        _measure_boxes(points, labels, boxes)
        tiles = np.floor((boxes.mean(axis=1) + 0.5) / (height, width)) * (height, width)
        boxes -= tiles[:, None]
        run(shift_charts, mesh.face_count, points, labels, -tiles, points)
    low, high = np.array([[-_SLACK], [1.0 + _SLACK]]) * (height, width) - 0.5
    outside = ((points < low) | (points > high)).any(axis=(1, 2))
    return Charts(points, labels, boxes, np.flatnonzero(seams).astype(np.int32), areas, outside)


def _check_areas(areas: Floats, texels: int) -> None:
    if not (np.abs(areas) > _FLAT).any():
        raise InvalidUV("All faces have zero area in the texture; unwrap the mesh first.")
    repeats = np.abs(areas).sum() / texels
    if repeats > MOST_REPEATS:
        raise InvalidUV(
            "The faces cover the image {repeats:.0f} times, at most {most:.0f} are possible; unwrap"
            " the mesh into a texture that is not tiled.",
            repeats=repeats,
            most=MOST_REPEATS,
        )


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
    if not np.isfinite(array).all():
        finite = np.isfinite(array).all(axis=(1, 2))
        raise InvalidUV(
            "Texture coordinates are NaN or infinite at {bad} of {count} faces, the first is face"
            " {first}; unwrap them again.",
            bad=np.count_nonzero(~finite),
            count=face_count,
            first=int(np.argmin(finite)),
        )
    if max(array.max(), -array.min()) > 1e6:
        raise InvalidUV("Texture coordinates reach beyond 1e6; unwrap the mesh again.")
    return array


@kernel
def _place_faces(start, stop, coordinates, height, width, points, areas):
    for f in range(start, stop):
        for k in range(3):
            u, v = coordinates[f, k, 0], coordinates[f, k, 1]
            points[f, k, 0] = v * height - 0.5
            points[f, k, 1] = u * width - 0.5
        ay, ax = points[f, 1, 0] - points[f, 0, 0], points[f, 1, 1] - points[f, 0, 1]
        by, bx = points[f, 2, 0] - points[f, 0, 0], points[f, 2, 1] - points[f, 0, 1]
        # (row, column) is left-handed: columns go along u, rows along v.
        areas[f] = 0.5 * (ax * by - ay * bx)


@kernel
def shift_charts(start, stop, points, labels, shifts, out):
    """Move the corners of faces by the shifts (charts, 2) of their charts."""
    for f in range(start, stop):
        for k in range(3):
            for axis in range(2):
                out[f, k, axis] = points[f, k, axis] + shifts[labels[f], axis]


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
    boxes[:, 0] = np.inf
    boxes[:, 1] = -np.inf
    for f in range(labels.shape[0]):
        box = boxes[labels[f]]
        for k in range(3):
            for axis in range(2):
                box[0, axis] = min(box[0, axis], points[f, k, axis])
                box[1, axis] = max(box[1, axis], points[f, k, axis])
