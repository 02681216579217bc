# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper's method of tracing flow lines: a reference for the exact walk.

It takes steps of a tenth of a mean edge length, straight on over edges by unfolding (paper A,
Appendix A, "Tracing Flow-Lines"); where both faces of an edge flow into it, it zigzags along it.
"""

from __future__ import annotations

import numpy as np
from shock_filter.core import TriangleMesh
from shock_filter.core.base.parallel import kernel, run
from shock_filter.core.base.vectors import after, cross, dot, edge
from shock_filter.core.flow.trace import face_centres
from shock_filter.core.flow.walk import Triangles, find_shock_rates

PAPER_STEP = 0.1
"""The paper's delta: length of a step, in mean edge lengths."""


def trace_faces(
    mesh: TriangleMesh, potential: np.ndarray, time: float, step: float
) -> tuple[np.ndarray, np.ndarray]:
    """Trace from the centre of each face, as `flow.trace.trace_faces` does."""
    triangles = Triangles(mesh.scaled_vertices, mesh.faces, mesh.twins, mesh.areas)
    rates = np.empty((mesh.face_count, 3))
    run(find_shock_rates, mesh.face_count, triangles, potential, rates)
    faces, coordinates = face_centres(mesh)
    run(_walk, len(faces), triangles, mesh.normals, rates, float(time), float(step), faces,
        coordinates)  # fmt: skip
    return faces, coordinates


@kernel
def _walk(start, stop, triangles, normals, rates, time, step, point_faces, coordinates):
    v = np.empty(3)
    direction = np.empty(3)
    for point in range(start, stop):
        f = point_faces[point]
        b = coordinates[point]
        left = time if triangles.areas[f] > 0 else 0.0
        _flow_vector(triangles, rates, f, v)
        direction[:] = v
        while left > 0 and dot(v, direction) > 0:
            pace = min(left, step / np.sqrt(dot(v, v)))
            left -= pace
            direction[:] = v
            f, ended = _go_straight(triangles, normals, pace, f, b, direction)
            if ended:
                break
            _flow_vector(triangles, rates, f, v)
        point_faces[point] = f
        b /= b.sum()


@kernel
def _go_straight(triangles, normals, pace, f, b, direction):
    # Go along a geodesic for some time, face by face, and turn `direction` with it. Returns the
    # face, and whether it ended at a border.
    vertices, faces, twins, areas, _ = triangles
    rates = np.empty(3)
    while True:
        exit_corner = -1
        first = pace
        for c in range(3):
            opposite = edge(vertices, faces[f, after(c)], faces[f, after(after(c))])
            rates[c] = dot(cross(normals[f], opposite), direction) / (2 * areas[f])
            if rates[c] < 0:
                reached = max(b[c], 0.0) / -rates[c]
                if reached < first:
                    first = reached
                    exit_corner = c
        for c in range(3):
            b[c] += rates[c] * first
        pace -= first
        if exit_corner < 0:
            return f, False
        b[exit_corner] = 0.0
        k = after(exit_corner)
        t = twins[f, k]
        if t < 0 or areas[t // 3] == 0:
            return f, True
        g = t // 3
        h = t - 3 * g
        e = edge(vertices, faces[f, k], faces[f, after(k)])
        length = np.sqrt(dot(e, e))
        e = e[0] / length, e[1] / length, e[2] / length
        along = dot(e, direction)
        outward = dot(cross(e, normals[f]), direction)
        inward = cross(e, normals[g])
        for x in range(3):
            direction[x] = along * e[x] + outward * inward[x]
        share = b[after(k)] / (b[k] + b[after(k)])
        b[h] = share
        b[after(h)] = 1.0 - share
        b[after(after(h))] = 0.0
        f = g


@kernel
def _flow_vector(triangles, rates, f, v):
    for x in range(3):
        v[x] = 0.0
        for c in range(3):
            v[x] += rates[f, c] * triangles.vertices[triangles.faces[f, c], x]
