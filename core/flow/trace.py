# SPDX-License-Identifier: GPL-3.0-or-later
"""Tracing points along flow-lines on triangle meshes; a point is a face and coordinates in it."""

from __future__ import annotations

import logging

import numpy as np

from ..base.parallel import kernel, run
from ..base.progress import aside, phase
from ..base.unfinished import MOST_STEPS, warn_of_unfinished
from ..mesh.triangle_mesh import Floats, Ints, TriangleMesh
from .walk import (
    AROUND_HUB,
    CUT_OFF,
    MOST_AROUND,
    Triangles,
    find_shock_rates,
    walk_exactly,
)

log = logging.getLogger(__name__)

OFFSET = 0.001
"""The paper's epsilon: how far from its vertex, towards the face's centre, a trace begins."""


_FEW = 128
"""Most consecutive walks in a chunk if each may cross many faces around a hub: 0.01 seconds."""


def face_centres(mesh: TriangleMesh) -> tuple[Ints, Floats]:
    """The centres of the faces as points: faces (m,), barycentric coordinates (m, 3)."""
    return _in_each_face(mesh, np.full((1, 3), 1.0 / 3.0))


def corner_offsets(mesh: TriangleMesh) -> tuple[Ints, Floats]:
    """A point in each face next to each of its corners: faces (3 m,), coordinates (3 m, 3)."""
    return _in_each_face(mesh, (1.0 - OFFSET) * np.eye(3) + OFFSET / 3.0)


def _in_each_face(mesh: TriangleMesh, places: Floats) -> tuple[Ints, Floats]:
    faces = np.empty(len(places) * mesh.face_count, dtype=np.int32)
    coordinates = np.empty((len(faces), 3))
    run(_place, mesh.face_count, places, faces, coordinates)
    return faces, coordinates


def trace(
    mesh: TriangleMesh, potential: Floats, time: float | Floats, faces: Ints, coordinates: Floats
) -> None:
    """Move points for `time` against the shock flow of `potential`, in place.

    Parameters
    ----------
    mesh : TriangleMesh
    potential : (n,) float64
        P at the vertices; lengths are in mean edge lengths.
    time : float or (k,) float64
        Flow time, of all points or of each; with infinity, walks go on until the flow ends.
    faces : (k,) int32
        The face of each point; overwritten.
    coordinates : (k, 3) float64
        Its barycentric coordinates; overwritten.
    """
    triangles, rates = _triangles(mesh), np.empty((mesh.face_count, 3))
    with phase(0.0, 0.1, "Tracing flow-lines"):
        run(find_shock_rates, mesh.face_count, triangles, potential, rates)
    times = np.atleast_1d(np.asarray(time, dtype=np.float64))
    endings = np.zeros(len(faces), dtype=np.uint8)
    with phase(0.1, 1.0, "Tracing flow-lines"):
        run(walk_exactly, len(faces), triangles, rates, potential, times, MOST_STEPS, faces,
            coordinates, endings, chunk=_FEW if mesh.has_hubs else None)  # fmt: skip
    warn_of_unfinished(endings == CUT_OFF)
    around = np.count_nonzero(endings == AROUND_HUB)
    if around:
        log.info("%d walks ended around vertices of over %d faces.", around, MOST_AROUND)


def trace_faces(mesh: TriangleMesh, potential: Floats, time: float) -> tuple[Ints, Floats]:
    """Call `trace` on the centre of each face. Returns faces (m,), coordinates (m, 3)."""
    with aside("Tracing flow-lines"):
        faces, coordinates = face_centres(mesh)
    trace(mesh, potential, time, faces, coordinates)
    return faces, coordinates


def _triangles(mesh: TriangleMesh) -> Triangles:
    triangles = Triangles(mesh.scaled_vertices, mesh.faces, mesh.twins, mesh.areas)
    crowded = np.diff(mesh.corners[0]) > MOST_AROUND
    return triangles._replace(crowded=crowded) if crowded.any() else triangles


@kernel
def _place(start, stop, places, faces, coordinates):
    # The same places, in barycentric coordinates, in each face.
    count = places.shape[0]
    for f in range(start, stop):
        for i in range(count):
            point = count * f + i
            faces[point] = f
            for c in range(3):
                coordinates[point, c] = places[i, c]
