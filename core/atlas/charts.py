# SPDX-License-Identifier: GPL-3.0-or-later
"""Charts of a texture atlas: connected faces in the texture (paper B, section 3.1).

Points in the texture are (row, column) in texels; texel centres are at whole numbers, so that
u = 0 is at column -1/2.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..base.progress import ask, phase
from ..base.vectors import after
from ..errors import InvalidUV
from ..mesh.triangle_mesh import Floats, Ints, TriangleMesh
from ..sparse.components import connected_components

MOST_REPEATS = 16.0
"""Largest total area of the faces in the texture, in areas of the image."""

_SAME = 1e-3  # corners nearer than this, in texels, are one point of the texture
_FLAT = 1e-9  # area in squared texels below which a face has no area in the texture
_SLACK = 1e-6  # how far texture coordinates may leave the image without being reported


class Charts(NamedTuple):
    """The faces in the texture, cut into charts.

    Attributes
    ----------
    points : (m, 3, 2) float64
        Corners as (row, column) in texels; each chart is shifted by whole images so that the
        middle of its box lies in the image.
    labels : (m,) int32
        The chart of each face, numbered by first face.
    boxes : (charts, 2, 2) float64
        Lowest and highest (row, column) of each chart.
    borders : (k,) int32
        Half-edges on outlines of charts: seams and borders of the mesh.
    areas : (m,) float64
        Signed areas in squared texels; negative for mirrored faces.
    outside : (m,) bool
        Faces with corners outside the image after this shift.
    """

    points: Floats
    labels: Ints
    boxes: Floats
    borders: Ints
    areas: Floats
    outside: npt.NDArray[np.bool_]


def find_charts(mesh: TriangleMesh, uv: npt.ArrayLike, height: int, width: int) -> Charts:
    """Cut the faces of a mesh into charts.

    Neighbouring faces are in one chart if their corners coincide in the texture and neither is
    folded over the other.

    Raises
    ------
    InvalidUV
        If the coordinates do not fit the mesh, are not finite, have no area, or repeat the
        image more than `MOST_REPEATS` times.
    """
    coordinates = mesh.own_corners(_checked_uv(uv, mesh.face_count))
    points = coordinates[..., ::-1] * (height, width) - 0.5
    ask()
    (ay, ax), (by, bx) = np.moveaxis(points[:, 1:] - points[:, :1], 0, 2)
    # (row, column) is left-handed: columns go along u, rows along v.
    areas = 0.5 * (ax * by - ay * bx)
    _check_areas(areas, height * width)
    seams = np.empty(3 * mesh.face_count, dtype=np.bool_)
    with phase(0.5, 0.8, "Finding charts"):
        run(_mark_seams, mesh.face_count, mesh.twins, points, areas, seams)
    ask()
    joints = np.flatnonzero(~seams)
    beyond = mesh.twins.reshape(-1)[joints] // 3
    count, labels = connected_components(mesh.face_count, joints // 3, beyond)
    ask()
    order = np.argsort(labels, kind="stable")
    first = np.searchsorted(labels[order], np.arange(count))
    low = np.minimum.reduceat(points.min(axis=1)[order], first)
    high = np.maximum.reduceat(points.max(axis=1)[order], first)
    ask()
    boxes = np.stack([low, high], axis=1)
    tiles = np.floor((boxes.mean(axis=1) + 0.5) / (height, width)) * (height, width)
    boxes -= tiles[:, None]
    points -= tiles[labels][:, None]
    least, most = np.array([[-_SLACK], [1.0 + _SLACK]]) * (height, width) - 0.5
    outside = ((points < least) | (points > most)).any(axis=(1, 2))
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
    if np.ma.is_masked(uv):
        raise InvalidUV("Texture coordinates hold masked values; fill these first.")
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
                g, j = divmod(t, 3)
                joined = _near(points, f, k, g, after(j)) and _near(points, f, after(k), g, j)
                if min(abs(areas[f]), abs(areas[g])) > _FLAT:
                    joined = joined and areas[f] * areas[g] > 0  # not folded
            seams[3 * f + k] = not joined
