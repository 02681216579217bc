# SPDX-License-Identifier: GPL-3.0-or-later
"""Tracing points along flow-lines on triangle meshes; a point is a face and coordinates in it."""

from __future__ import annotations

import numpy as np

from ..base.parallel import kernel, run
from ..base.progress import aside, phase
from ..base.unfinished import MOST_STEPS, warn_of_unfinished
from ..mesh.triangle_mesh import Floats, Ints, TriangleMesh
from .walk import (
    Field,
    Triangles,
    find_given_rates,
    find_shock_rates,
    walk_exactly,
    walk_literally,
)

PAPER_STEP = 0.1
"""The paper's delta: length of a literal step, in mean edge lengths."""


OFFSET = 0.001
"""The paper's epsilon: how far towards the face's centre the trace of a vertex begins."""


def face_centres(mesh: TriangleMesh) -> tuple[Ints, Floats]:
    """The centre of each face, to trace from: faces (m,), barycentric coordinates (m, 3)."""
    faces = np.empty(mesh.face_count, dtype=np.int32)
    coordinates = np.empty((mesh.face_count, 3))
    run(_place_at_centres, mesh.face_count, faces, coordinates)
    return faces, coordinates


def corner_offsets(mesh: TriangleMesh) -> tuple[Ints, Floats]:
    """A point in each face beside each of its corners: faces (3 m,), coordinates (3 m, 3)."""
    faces = np.empty(3 * mesh.face_count, dtype=np.int32)
    coordinates = np.empty((3 * mesh.face_count, 3))
    run(_place_at_corners, mesh.face_count, faces, coordinates)
    return faces, coordinates


def trace(
    mesh: TriangleMesh,
    potential: Floats,
    time: float,
    faces: Ints,
    coordinates: Floats,
    *,
    step: float | None = None,
) -> None:
    """Move points for `time` against the shock flow of `potential`, in place.

    Parameters
    ----------
    mesh : TriangleMesh
    potential : (n,) float64
        P at the vertices; lengths are in mean edge lengths.
    time : float
        Flow time; infinity walks until the flow ends.
    faces : (k,) int32
        The face of each point; overwritten.
    coordinates : (k, 3) float64
        Its barycentric coordinates; overwritten.
    step : float, optional
        Walk literally, in steps of this length in mean edge lengths; the paper's is
        `PAPER_STEP`. None walks exactly.
    """
    triangles = _triangles(mesh)
    rates = np.empty((mesh.face_count, 3))
    with phase(0.0, 0.1, "Tracing flow-lines"):
        run(find_shock_rates, mesh.face_count, triangles, potential, rates)
    _walk(triangles, Field(rates, potential), time, faces, coordinates, step)


def follow(
    mesh: TriangleMesh,
    vectors: Floats,
    time: float,
    faces: Ints,
    coordinates: Floats,
    *,
    step: float | None = None,
) -> None:
    """Move points for `time` along given vectors, or up to a border, in place.

    Parameters
    ----------
    mesh : TriangleMesh
    vectors : (m, 3) float64
        A velocity in each face, in mean edge lengths per unit of time; its tangential part counts.
    time : float
        Finite.
    faces, coordinates, step
        As in `trace`.
    """
    if not np.isfinite(time):
        raise ValueError(f"time is {time}; give a finite one, as flow-lines may be closed.")
    triangles = _triangles(mesh)
    rates = np.empty((mesh.face_count, 3))
    with phase(0.0, 0.1, "Tracing flow-lines"):
        run(find_given_rates, mesh.face_count, triangles, vectors, rates)
    _walk(triangles, Field(rates), time, faces, coordinates, step)


def trace_faces(
    mesh: TriangleMesh, potential: Floats, time: float, *, step: float | None = None
) -> tuple[Ints, Floats]:
    """Trace from the centre of each face; see `trace`. Returns faces (m,), coordinates (m, 3)."""
    with aside("Tracing flow-lines"):
        faces, coordinates = face_centres(mesh)
    trace(mesh, potential, time, faces, coordinates, step=step)
    return faces, coordinates


def _triangles(mesh: TriangleMesh) -> Triangles:
    return Triangles(mesh.scaled_vertices, mesh.faces, mesh.twins, mesh.areas, mesh.normals)


def _walk(
    triangles: Triangles,
    field: Field,
    time: float,
    faces: Ints,
    coordinates: Floats,
    step: float | None,
) -> None:
    unfinished = np.zeros(len(faces), dtype=np.bool_)
    with phase(0.1, 1.0, "Tracing flow-lines"):
        if step is None:
            run(walk_exactly, len(faces), triangles, field, float(time), MOST_STEPS, faces,
                coordinates, unfinished)  # fmt: skip
        else:
            run(walk_literally, len(faces), triangles, field, float(time), float(step), MOST_STEPS,
                faces, coordinates, unfinished)  # fmt: skip
    warn_of_unfinished(unfinished)


@kernel
def _place_at_centres(start, stop, faces, coordinates):
    for f in range(start, stop):
        faces[f] = f
        for k in range(3):
            coordinates[f, k] = 1.0 / 3.0


@kernel
def _place_at_corners(start, stop, faces, coordinates):
    for point in range(3 * start, 3 * stop):
        faces[point] = point // 3
        for k in range(3):
            at_corner = 1.0 - OFFSET if k == point % 3 else 0.0
            coordinates[point, k] = at_corner + OFFSET / 3.0
