# SPDX-License-Identifier: GPL-3.0-or-later
"""Advects the face normals towards the creases (paper A, 4.1)."""

from __future__ import annotations

from ..base.parallel import kernel, run
from ..base.progress import phase
from ..flow.advect import advect_faces
from ..flow.potential import above_surroundings, bending, flow_potential
from ..mesh.calculus import (
    average_to_faces,
    average_to_vertices,
    make_unit_or,
    smooth_vertices,
)
from ..mesh.triangle_mesh import Floats, TriangleMesh
from ..settings import GeometrySettings


def advected_normals(mesh: TriangleMesh, settings: GeometrySettings) -> Floats:
    """Return for each face the normal at the end of its flow-line: unit vectors, (m, 3)."""
    with phase(0.0, 0.5, "Computing the flow"):
        normals, signal, potential = signal_and_potential(mesh, settings)
    with phase(0.5, 1.0, "Tracing flow-lines"):
        return advect_faces(mesh, normals, signal, potential, settings.time, settings.sampling)


def signal_and_potential(
    mesh: TriangleMesh, settings: GeometrySettings
) -> tuple[Floats, Floats, Floats]:
    """Return face normals, mollified if set; their averages, and the potential, at the vertices."""
    normals = mesh.normals
    if settings.mollify_passes == 0:
        with phase(0.2, 0.8, "Computing the flow"):
            signal, potential = bending(mesh, settings.smoothing_passes)
    else:
        with phase(0.0, 0.2, "Mollifying"):
            normals = _mollified(mesh, normals, settings.mollify_passes)
        with phase(0.2, 0.3, "Computing the flow"):
            signal = average_to_vertices(mesh, normals)
        with phase(0.3, 0.8, "Computing the flow"):
            potential = flow_potential(mesh, signal, settings.smoothing_passes)
    if settings.feature_threshold > 0:
        with phase(0.8, 1.0, "Finding features"):
            potential = above_surroundings(
                mesh, potential, settings.feature_threshold, settings.time
            )
    return normals, signal, potential


def _mollified(mesh: TriangleMesh, normals: Floats, passes: int) -> Floats:
    with phase(0.0, 0.1, "Mollifying"):
        averages = average_to_vertices(mesh, normals)
    with phase(0.1, 0.9, "Mollifying"):
        smooth = smooth_vertices(mesh, averages, passes)
    with phase(0.9, 1.0, "Mollifying"):
        mollified = average_to_faces(mesh, smooth)
        run(_make_unit_or, mesh.face_count, mollified, normals)
    return mollified


@kernel
def _make_unit_or(start, stop, vectors, old):
    for f in range(start, stop):
        make_unit_or(vectors[f], old[f])
