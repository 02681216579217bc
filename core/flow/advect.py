# SPDX-License-Identifier: GPL-3.0-or-later
"""Advection: sample a signal where the flow-lines come from (paper A, Appendix A)."""

from __future__ import annotations

import numpy as np

from ..base.parallel import kernel, run
from ..base.progress import phase
from ..mesh.calculus import make_unit_or
from ..mesh.triangle_mesh import Floats, Ints, TriangleMesh
from .trace import trace_faces

_SAMPLING = {"nearest": 0, "linear": 1, "detail": 2}


def advect_faces(
    mesh: TriangleMesh,
    normals: Floats,
    averages: Floats,
    potential: Floats,
    time: float,
    sampling: str,
) -> Floats:
    """Advect face normals: trace from each face's centre and sample there ("Face Advection").

    Parameters
    ----------
    mesh : TriangleMesh
    normals : (m, 3) float64
        Unit normals.
    averages : (n, 3) float64
        Area-weighted averages of `normals` at the vertices, for interpolation.
    potential : (n,) float64
        P at the vertices.
    time : float
        Flow time; 0 returns the normals, up to rounding, with "nearest" and "detail" sampling.
    sampling : {"detail", "linear", "nearest"}
        "nearest" takes the normal of the face at the traced point, "linear" interpolates vertex
        averages there (both as in paper 4.1). "detail" is not in the paper: it adds the change
        of the interpolated normal along the flow-line, S(end) - S(start), to the face's own
        normal, so that a short time changes little and relief finer than the average is kept.

    Returns
    -------
    (m, 3) float64
        Unit normals; zero where they were zero.
    """
    with phase(0.0, 0.9, "Tracing flow-lines"):
        faces, coordinates = trace_faces(mesh, potential, time)
    out = np.empty_like(normals)
    with phase(0.9, 1.0, "Tracing flow-lines"):
        run(_sample, mesh.face_count, mesh.faces, normals, averages, faces, coordinates,
            _SAMPLING[sampling], out)  # fmt: skip
    return out


def read_points(
    mesh: TriangleMesh, values: Floats, faces: Ints, coordinates: Floats, nearest: bool
) -> Floats:
    """Sample vertex values at points in faces, linearly or from the nearest corner: (k, d)."""
    out = np.empty((len(faces), values.shape[1]))
    run(_read_points, len(faces), mesh.faces, values, faces, coordinates, nearest, out)
    return out


def average_corners(mesh: TriangleMesh, corner_values: Floats, values: Floats) -> Floats:
    """Unweighted means of the corner values of each vertex ("Vertex Advection", line 9).

    Parameters
    ----------
    mesh : TriangleMesh
    corner_values : (3 m, d) float64
    values : (n, d) float64
        Used for vertices without faces.
    """
    out = np.empty_like(values)
    run(_average_corners, mesh.vertex_count, *mesh.corners, corner_values, values, out)
    return out


@kernel
def _read_points(start, stop, mesh_faces, values, faces, coordinates, nearest, out):
    for point in range(start, stop):
        f = faces[point]
        if nearest:
            best = 0
            for c in range(1, 3):
                if coordinates[point, c] > coordinates[point, best]:
                    best = c
            v = mesh_faces[f, best]
            for j in range(values.shape[1]):
                out[point, j] = values[v, j]
        else:
            a, b, c = mesh_faces[f, 0], mesh_faces[f, 1], mesh_faces[f, 2]
            p, q, r = coordinates[point, 0], coordinates[point, 1], coordinates[point, 2]
            for j in range(values.shape[1]):
                low = min(values[a, j], values[b, j], values[c, j])
                high = max(values[a, j], values[b, j], values[c, j])
                value = p * values[a, j] + q * values[b, j] + r * values[c, j]
                out[point, j] = min(max(value, low), high)  # rounding must not leave the range


@kernel
def _average_corners(start, stop, corner_start, corners, corner_values, values, out):
    for v in range(start, stop):
        first, last = corner_start[v], corner_start[v + 1]
        for j in range(values.shape[1]):
            if first == last:
                out[v, j] = values[v, j]
                continue
            low = high = total = corner_values[corners[first], j]
            for i in range(first + 1, last):
                value = corner_values[corners[i], j]
                total += value
                low = min(low, value)
                high = max(high, value)
            out[v, j] = min(max(total / (last - first), low), high)


@kernel
def _sample(start, stop, faces, normals, averages, end_faces, coordinates, sampling, out):
    for f in range(start, stop):
        g = end_faces[f]
        for x in range(3):
            value = normals[g, x]
            if sampling != 0:
                value = 0.0
                for c in range(3):
                    value += coordinates[f, c] * averages[faces[g, c], x]
            if sampling == 2:
                value += normals[f, x]
                for c in range(3):
                    value -= averages[faces[f, c], x] / 3.0
            out[f, x] = value
        make_unit_or(out[f], normals[f])
