# SPDX-License-Identifier: GPL-3.0-or-later
"""The short-time Beltrami kernel on the normals of the faces of a mesh, and their noise."""

from __future__ import annotations

import numpy as np

from ...base.parallel import kernel, run
from ...base.progress import aside, ask, phase
from ...mesh.calculus import average_to_faces, make_unit
from ...mesh.geodesics import face_stencils
from ...mesh.triangle_mesh import HUB, Floats, TriangleMesh
from ...settings import BeltramiGeometrySettings
from .mesh_smoothing import smooth_graph

LEAST_NOISE, MOST_NOISE = 6e-4, 0.45
"""Bounds of what the normals of neighbouring faces differ by for noise."""

MOLLIFIED = 10.0
"""Normals that differ by this many times the noise hardly mollify each other: creases stay."""


def noise_of_normals(mesh: TriangleMesh) -> float:
    """How much the normals of neighbouring faces differ where the surface is calm.

    The lower quartile over all edges: creases and relief have little say. Between bounds, so
    that a clean mesh is not all noise, and a right angle never is.
    """
    steps = np.empty(3 * mesh.face_count)
    run(_normal_steps, mesh.face_count, mesh.twins, mesh.areas, mesh.normals, steps)
    steps = steps[steps >= 0]
    if not len(steps):
        return MOST_NOISE
    quartile = float(np.quantile(steps, 0.25, overwrite_input=True))
    return min(max(quartile, LEAST_NOISE), MOST_NOISE)


def smoothed_normals(
    mesh: TriangleMesh, settings: BeltramiGeometrySettings, noise: float
) -> Floats:
    """Smooth the normals of the faces, `noise` being what `noise_of_normals` says: (m, 3)."""
    embedding = np.empty((mesh.face_count, 6))
    with aside("Denoising"):
        embedding[:, :3] = average_to_faces(mesh, mesh.scaled_vertices)
    normals = mesh.normals
    for turn in range(settings.iterations):
        with phase(turn / settings.iterations, (turn + 1) / settings.iterations, "Denoising"):
            with aside("Denoising"):
                guide = _mollified(mesh, normals, settings.mollify_passes, MOLLIFIED * noise)
                np.multiply(guide, settings.beta / noise, out=embedding[:, 3:])
                ask()
                graph = face_stencils(mesh, embedding)
            normals = smooth_graph(graph, embedding, mesh.areas, normals, settings, mesh.has_hubs)
            with phase(1.0, 1.0, "Denoising"):
                run(_make_unit, mesh.face_count, normals)
    return normals


def _mollified(mesh: TriangleMesh, normals: Floats, passes: int, spread: float) -> Floats:
    for _ in range(passes):
        smooth = np.empty_like(normals)
        run(_mollify, mesh.face_count, mesh.faces, *mesh.corners, mesh.areas, normals, spread,
            smooth)  # fmt: skip
        normals = smooth
    return normals


@kernel
def _normal_steps(start, stop, twins, areas, normals, steps):
    # How far the normals across each edge are apart; -1 for borders and the second half-edge.
    for f in range(start, stop):
        for k in range(3):
            g = twins[f, k] // 3
            steps[3 * f + k] = -1.0
            if f < g and areas[f] > 0 and areas[g] > 0:
                square = 0.0
                for x in range(3):
                    square += (normals[f, x] - normals[g, x]) ** 2
                steps[3 * f + k] = np.sqrt(square)


@kernel
def _make_unit(start, stop, vectors):
    for f in range(start, stop):
        make_unit(vectors[f])


@kernel
def _mollify(start, stop, faces, corner_start, corners, areas, normals, spread, out):
    # Means over the faces that share a vertex, those of similar normals; all for zero-area faces.
    # At a hub some stand for all.
    for f in range(start, stop):
        out[f] = 0.0
        for k in range(3):
            v = faces[f, k]
            count = corner_start[v + 1] - corner_start[v]
            stride = 1 if count <= HUB else 1 + count // HUB
            for i in range(corner_start[v], corner_start[v + 1], stride):
                g = corners[i] // 3
                square = 0.0
                for x in range(3):
                    square += (normals[f, x] - normals[g, x]) ** 2
                weight = stride * areas[g]
                if areas[f] > 0:
                    weight *= np.exp(-0.5 * square / (spread * spread))
                for x in range(3):
                    out[f, x] += weight * normals[g, x]
        make_unit(out[f])
