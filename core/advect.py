# SPDX-License-Identifier: GPL-3.0-or-later
"""Advection: read a signal where the flow-lines come from (paper A, Appendix A)."""

from __future__ import annotations

import numpy as np

from .calculus import average_to_vertices
from .mesh import Floats, TriangleMesh
from .parallel import Progress, kernel, run
from .trace import trace_faces

_SAMPLING = {"nearest": 0, "linear": 1, "detail": 2}


def advect_faces(
    mesh: TriangleMesh,
    normals: Floats,
    potential: Floats,
    time: float,
    sampling: str,
    progress: Progress | None = None,
) -> Floats:
    """Advect face normals: trace from each face's centre and sample there ("Face Advection").

    Parameters
    ----------
    mesh : TriangleMesh
    normals : (m, 3) float64
        Unit normals.
    potential : (n,) float64
        P at the vertices.
    time : float
        Flow time; 0 returns a copy of the normals for "nearest" and "detail" sampling.
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
    progress = progress or Progress(None)
    faces, coordinates = trace_faces(mesh, potential, time, progress=progress.part(
        0.0, 0.9, "Tracing flow-lines"))  # fmt: skip
    averages = average_to_vertices(mesh, normals)
    out = np.empty_like(normals)
    run(_sample, mesh.face_count, mesh.faces, normals, averages, faces, coordinates,
        _SAMPLING[sampling], out, progress=progress.part(0.9, 1.0, "Tracing flow-lines"))  # fmt: skip
    return out


@kernel
def _sample(start, stop, faces, normals, averages, end_faces, coordinates, sampling, out):
    n = np.empty(3)
    for f in range(start, stop):
        own = normals[f]
        g = end_faces[f]
        if sampling == 0:
            n[:] = normals[g]
        else:
            n[:] = 0.0
            for c in range(3):
                n += coordinates[f, c] * averages[faces[g, c]]
            if sampling == 2:
                for c in range(3):
                    n -= averages[faces[f, c]] / 3.0
                n += own
        length = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
        if length < 1e-12 or (own[0] == 0 and own[1] == 0 and own[2] == 0):
            out[f] = own
            continue
        n /= length
        out[f] = n
