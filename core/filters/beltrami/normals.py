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


_SEEDS = 2000
"""Faces around which the noise is compared at several distances."""

_RINGS = 1, 2, 6
_MOST_AROUND = 1024
"""Most faces that are looked at around one."""

_BUMPS = 3.0
"""How many times more the noise of scans counts whose bumps are wider than a face."""

# Where it begins to count, and where it counts in full: the share of noise in what normals differ
# by over two rings; and the ratio of squared differences over one ring and over two, which is lower
# for relief, and higher for noise that differs from vertex to vertex. Where there is little relief,
# a lower ratio does.
_SHARE, _WIDER, _WHITE = (0.4, 0.6), (0.53, 0.57), (0.73, 0.85)
_LOWER = 0.8


def noise_of_normals(mesh: TriangleMesh) -> float:
    """How much the normals of neighbouring faces differ where the surface is calm.

    The lower quartile over all edges: creases and relief have little say. Noise of real scans has
    bumps wider than a face, over which neighbours differ less than by the whole of it: it counts
    more. Between bounds, so that a clean mesh is not all noise, and a right angle never is.
    """
    steps = np.empty(3 * mesh.face_count)
    run(_normal_steps, mesh.face_count, mesh.twins, mesh.areas, mesh.normals, steps)
    steps = steps[steps >= 0]
    if not len(steps):
        return MOST_NOISE
    quartile = float(np.quantile(steps, 0.25, overwrite_input=True))
    return min(max(quartile * _bump_factor(mesh), LEAST_NOISE), MOST_NOISE)


def _bump_factor(mesh: TriangleMesh) -> float:
    # Squared differences of normals over k rings are those of the noise, which are all there from
    # the bumps' width on, plus k^2 times those of the bending surface.
    count = min(_SEEDS, mesh.face_count)
    seeds = np.linspace(0, mesh.face_count - 1, count).astype(np.int32)
    found = np.empty((count, len(_RINGS)))
    run(_differences, count, mesh.faces, *mesh.corners, mesh.areas, mesh.normals, seeds, found,
        chunk=_SEEDS // 8)  # fmt: skip
    found = found[np.isfinite(found).all(axis=1)]
    if not len(found):
        return 1.0
    one, two, _ = np.median(found, axis=0)
    bend = max(np.median(found[:, 2] - found[:, 1]) / (_RINGS[2] ** 2 - _RINGS[1] ** 2), 0.0)
    noise = two - _RINGS[1] ** 2 * bend
    if not noise > _SHARE[0] * two:
        return 1.0
    share, ratio = noise / two, (one - bend) / noise
    wider = np.interp(ratio + _LOWER * (share - 0.75), _WIDER, (0.0, 1.0))
    wider *= np.interp(ratio, _WHITE, (1.0, 0.0)) * np.interp(share, _SHARE, (0.0, 1.0))
    return 1.0 + (_BUMPS - 1.0) * float(wider)


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
def _differences(start, stop, faces, corner_start, corners, areas, normals, seeds, found):
    # Around each seed, the median squared difference of its normal to those some rings away, a ring
    # being all faces that share a vertex with the last; NaN where there are none.
    seen = np.full(faces.shape[0], -1, np.int32)
    queue = np.empty(_MOST_AROUND, np.int32)
    squares = np.empty(_MOST_AROUND)
    for s in range(start, stop):
        seed = seeds[s]
        found[s] = np.nan
        if areas[seed] == 0:
            continue
        seen[seed] = s
        queue[0] = seed
        first, last, column = 0, 1, 0
        for ring in range(1, _RINGS[2] + 1):
            end = last
            for i in range(first, end):
                for k in range(3):
                    v = faces[queue[i], k]
                    stride = 1 + (corner_start[v + 1] - corner_start[v] - 1) // HUB
                    for j in range(corner_start[v], corner_start[v + 1], stride):
                        g = corners[j] // 3
                        if seen[g] != s and last < _MOST_AROUND:
                            seen[g] = s
                            queue[last] = g
                            last += 1
            first = end
            if ring == _RINGS[column]:
                count = 0
                for i in range(first, last):
                    g = queue[i]
                    if areas[g] > 0:
                        square = 0.0
                        for x in range(3):
                            square += (normals[seed, x] - normals[g, x]) ** 2
                        squares[count] = square
                        count += 1
                if count > 0:
                    found[s, column] = np.median(squares[:count])
                column += 1


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
