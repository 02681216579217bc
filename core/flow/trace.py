# SPDX-License-Identifier: GPL-3.0-or-later
"""Tracing flow-lines on triangle meshes (paper A, Appendix A, "Tracing Flow-Lines").

Points are a face and barycentric coordinates. They move along v = -u = -grad(P) / 2: values
flow with u, so what arrives at a point is found by walking against it. A trace ends when its
time is used up, at a border, or where the flow turns by a right angle or more.

Two ways of walking:

- *exact* (the default): v is constant in a face, so the walk goes straight from edge to edge.
  Where both faces of an edge flow into it, it slides along the edge with the combination of
  both flows that stays on the edge (Filippov); the part of v along the edge is the same on both
  sides, half the fall of P. At a vertex it leaves in the direction of steepest descent.
- *literal*: the paper's steps of a tenth of a mean edge length, continued over edges by
  unfolding; it zigzags along the edges on which the exact walk slides.

Both differ from the paper at borders only, about which it is silent: the trace ends there.
"""

from __future__ import annotations

import numpy as np

from ..base.parallel import Progress, kernel, run
from ..mesh.triangle_mesh import Floats, Ints, TriangleMesh

PAPER_STEP = 0.1
"""The paper's delta: length of a literal step, in mean edge lengths."""


OFFSET = 0.001
"""The paper's epsilon: how far towards the face's centre the trace of a vertex begins."""


def face_centres(mesh: TriangleMesh, progress: Progress = Progress(None)) -> tuple[Ints, Floats]:
    """The centre of each face, to trace from: faces (m,), barycentric coordinates (m, 3)."""
    faces = np.empty(mesh.face_count, dtype=np.int32)
    coordinates = np.empty((mesh.face_count, 3))
    run(_place_at_centres, mesh.face_count, faces, coordinates, progress=progress)
    return faces, coordinates


def corner_offsets(mesh: TriangleMesh, progress: Progress = Progress(None)) -> tuple[Ints, Floats]:
    """A point in each face beside each of its corners: faces (3 m,), coordinates (3 m, 3)."""
    faces = np.empty(3 * mesh.face_count, dtype=np.int32)
    coordinates = np.empty((3 * mesh.face_count, 3))
    run(_place_at_corners, mesh.face_count, faces, coordinates, progress=progress)
    return faces, coordinates


def trace(
    mesh: TriangleMesh,
    potential: Floats,
    time: float,
    faces: Ints,
    coordinates: Floats,
    *,
    step: float | None = None,
    progress: Progress | None = None,
) -> None:
    """Move points for `time` against the flow of `potential`, in place.

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
    progress = progress or Progress(None)
    rates = np.empty((mesh.face_count, 3))
    run(_flow_rates, mesh.face_count, mesh.scaled_vertices, mesh.faces, mesh.areas, potential,
        rates, progress=progress.part(0.0, 0.1, "Tracing flow-lines"))  # fmt: skip
    shape = mesh.scaled_vertices, mesh.faces, mesh.twins
    walk = progress.part(0.1, 1.0, "Tracing flow-lines")
    if step is None:
        run(_walk_exact, len(faces), float(time), *shape, mesh.areas, potential, rates,
            faces, coordinates, progress=walk)  # fmt: skip
    else:
        run(_walk_literal, len(faces), float(time), float(step), *shape, mesh.areas,
            mesh.normals, rates, faces, coordinates, progress=walk)  # fmt: skip


def trace_faces(
    mesh: TriangleMesh,
    potential: Floats,
    time: float,
    *,
    step: float | None = None,
    progress: Progress | None = None,
) -> tuple[Ints, Floats]:
    """Trace from the centre of each face; see `trace`. Returns faces (m,), coordinates (m, 3)."""
    progress = progress or Progress(None)
    faces, coordinates = face_centres(mesh, progress.part(0.0, 0.0, "Tracing flow-lines"))
    trace(mesh, potential, time, faces, coordinates, step=step, progress=progress)
    return faces, coordinates


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


@kernel
def _flow_rates(start, stop, vertices, faces, areas, potential, rates):
    # d(barycentric coordinates)/dt under v = -grad(P) / 2: minus half the inner products of
    # grad(P) with the gradients of the coordinates, all from edge vectors.
    for f in range(start, stop):
        if areas[f] == 0:
            rates[f] = 0.0
            continue
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        uu = 0.0
        uv = 0.0
        vv = 0.0
        for x in range(3):
            u = vertices[b, x] - vertices[a, x]
            v = vertices[c, x] - vertices[a, x]
            uu += u * u
            uv += u * v
            vv += v * v
        p = potential[b] - potential[a]
        q = potential[c] - potential[a]
        scale = -0.125 / (areas[f] * areas[f])
        rates[f, 1] = scale * (vv * p - uv * q)
        rates[f, 2] = scale * (uu * q - uv * p)
        rates[f, 0] = -rates[f, 1] - rates[f, 2]
        if max(abs(rates[f, 0]), abs(rates[f, 1]), abs(rates[f, 2])) < 1e-100:
            rates[f] = 0.0  # so that crossing times stay finite


@kernel
def _leave_vertex(f, k, vertices, faces, twins, areas, potential, rates, came):
    # Steepest descent from corner k of face f, around its vertex. `came` says along which
    # half-edge of the first face the walk arrived: 0 along the one leaving the corner, 1 along
    # the one that ends there. Returns (face, corner, kind): kind 0 nothing, 1 into the face,
    # 2 along the half-edge that leaves the corner.
    total = 0.0
    best = 0.0
    best_angle = 0.0
    best_face, best_corner, kind = -1, -1, 0
    arrival = 0.0
    g, c = f, k
    while True:  # twins pair up, so the round ends at its begin or at a border
        v, a, b = faces[g, c], faces[g, (c + 1) % 3], faces[g, (c + 2) % 3]
        if areas[g] == 0:
            return -1, -1, 0
        ux = vertices[a, 0] - vertices[v, 0]
        uy = vertices[a, 1] - vertices[v, 1]
        uz = vertices[a, 2] - vertices[v, 2]
        wx = vertices[b, 0] - vertices[v, 0]
        wy = vertices[b, 1] - vertices[v, 1]
        wz = vertices[b, 2] - vertices[v, 2]
        uu = ux * ux + uy * uy + uz * uz
        ww = wx * wx + wy * wy + wz * wz
        uw = ux * wx + uy * wy + uz * wz
        angle = np.arctan2(2 * areas[g], uw)
        if potential[a] < potential[v]:
            speed = 0.5 * (potential[v] - potential[a]) / np.sqrt(uu)
            if speed > best:
                best, best_angle = speed, total
                best_face, best_corner, kind = g, c, 2
        r, s = rates[g, (c + 1) % 3], rates[g, (c + 2) % 3]
        if r > 0 and s > 0:
            speed = np.sqrt(r * r * uu + 2 * r * s * uw + s * s * ww)
            if speed > best:
                best = speed
                x = r * np.sqrt(uu) + s * uw / np.sqrt(uu)
                y = s * 2 * areas[g] / np.sqrt(uu)
                best_angle = total + np.arctan2(y, x)
                best_face, best_corner, kind = g, c, 1
        total += angle
        if g == f and c == k and came == 1:
            arrival = angle
        t = twins[g, (c + 2) % 3]
        if t < 0:
            return -1, -1, 0  # the vertex lies on a border
        g = t // 3
        c = t - 3 * g
        if g == f and c == k:
            break
    if kind == 0:
        return -1, -1, 0
    # Straight on is half the vertex's total angle away from where the walk came from.
    turn = abs(best_angle - arrival) / total
    if 0.25 < turn < 0.75:
        return best_face, best_corner, kind
    return -1, -1, 0


@kernel
def _walk_exact(
    start, stop, time, vertices, faces, twins, areas, potential, rates, point_faces, coordinates
):
    b = np.empty(3)
    for point in range(start, stop):
        f = point_faces[point]
        b[:] = coordinates[point]
        left = time
        if areas[f] == 0 or (rates[f, 0] == 0 and rates[f, 1] == 0):
            left = 0.0
        slide = -1  # the half-edge along which the walk slides
        steps = 0
        while left > 0 and steps < 1000000:
            steps += 1
            if slide < 0:
                # Straight on to the edge that is reached first.
                exit_corner = -1
                first = left
                for c in range(3):
                    if rates[f, c] < 0:
                        reached = max(b[c], 0.0) / -rates[f, c]
                        if reached < first:
                            first = reached
                            exit_corner = c
                for c in range(3):
                    b[c] += rates[f, c] * first
                left -= first
                if exit_corner < 0:
                    break
                b[exit_corner] = 0.0
                k = (exit_corner + 1) % 3
                t = twins[f, k]
                if t < 0:
                    break
                g = t // 3
                if areas[g] == 0:
                    break
                h = t - 3 * g
                apex = (h + 2) % 3
                inward = rates[g, apex]
                along = b[(k + 1) % 3] / (b[k] + b[(k + 1) % 3])
                if inward > 0:
                    f = g
                    b[h] = along
                    b[(h + 1) % 3] = 1.0 - along
                    b[apex] = 0.0
                    continue
                # Both faces flow into the edge: the inner product of both flows, unfolded,
                # times the squared length of the edge.
                fall = potential[faces[f, k]] - potential[faces[f, (k + 1) % 3]]
                across = (rates[f, exit_corner] * areas[f]) * (inward * areas[g])
                if 0.25 * fall * fall - 4 * across <= 0:
                    b[k] = 1.0 - along
                    b[(k + 1) % 3] = along
                    break
                slide = 3 * f + k
                # fall through with `along` measured from corner k
            else:
                f = slide // 3
                k = slide - 3 * f
                along = 0.0
                fall = potential[faces[f, k]] - potential[faces[f, (k + 1) % 3]]
            a, d = faces[f, k], faces[f, (k + 1) % 3]
            x = vertices[d, 0] - vertices[a, 0]
            y = vertices[d, 1] - vertices[a, 1]
            z = vertices[d, 2] - vertices[a, 2]
            rate = 0.5 * fall / (x * x + y * y + z * z)
            reached = (1.0 - along) / rate if rate > 0 else -along / rate
            b[(k + 2) % 3] = 0.0
            if reached >= left:
                along += rate * left
                left = 0.0
                b[k] = 1.0 - along
                b[(k + 1) % 3] = along
                break
            left -= reached
            if rate > 0:
                corner, came = (k + 1) % 3, 1
            else:
                corner, came = k, 0
            b[k] = 0.0
            b[(k + 1) % 3] = 0.0
            b[corner] = 1.0
            g, c, kind = _leave_vertex(
                f, corner, vertices, faces, twins, areas, potential, rates, came
            )
            if kind == 0:
                break
            f = g
            b[0] = b[1] = b[2] = 0.0
            b[c] = 1.0
            slide = 3 * f + c if kind == 2 else -1
        point_faces[point] = f
        total = b[0] + b[1] + b[2]
        for c in range(3):
            coordinates[point, c] = b[c] / total


@kernel
def _walk_literal(
    start, stop, time, step, vertices, faces, twins, areas, normals, rates, point_faces,
    coordinates,
):  # fmt: skip
    b = np.empty(3)
    r = np.empty(3)
    v = np.empty(3)
    old = np.empty(3)
    e = np.empty(3)
    for point in range(start, stop):
        f = point_faces[point]
        b[:] = coordinates[point]
        left = time
        if areas[f] == 0:
            left = 0.0
        _flow_vector(f, vertices, faces, rates, v)
        old[:] = v
        steps = 0
        while left > 0 and steps < 1000000 and v[0] * old[0] + v[1] * old[1] + v[2] * old[2] > 0:
            steps += 1
            speed = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
            pace = min(left, step / speed)
            left -= pace
            # Walk the straight geodesic from here in direction v for `pace`, face by face.
            old[:] = v
            ended = False
            for _ in range(1000):
                _coordinate_rates(f, vertices, faces, areas, normals, old, r)
                exit_corner = -1
                first = pace
                for c in range(3):
                    if r[c] < 0:
                        reached = max(b[c], 0.0) / -r[c]
                        if reached < first:
                            first = reached
                            exit_corner = c
                for c in range(3):
                    b[c] += r[c] * first
                pace -= first
                if exit_corner < 0:
                    break
                b[exit_corner] = 0.0
                k = (exit_corner + 1) % 3
                t = twins[f, k]
                if t < 0 or areas[t // 3] == 0:
                    ended = True
                    break
                g = t // 3
                h = t - 3 * g
                p, q = faces[f, k], faces[f, (k + 1) % 3]
                length = 0.0
                for x in range(3):
                    e[x] = vertices[q, x] - vertices[p, x]
                    length += e[x] * e[x]
                length = np.sqrt(length)
                tangent = 0.0
                for x in range(3):
                    e[x] /= length
                    tangent += e[x] * old[x]
                # Outward in f is e x n(f); inward in g is e x n(g).
                outward = (
                    (e[1] * normals[f, 2] - e[2] * normals[f, 1]) * old[0]
                    + (e[2] * normals[f, 0] - e[0] * normals[f, 2]) * old[1]
                    + (e[0] * normals[f, 1] - e[1] * normals[f, 0]) * old[2]
                )
                old[0] = tangent * e[0] + outward * (e[1] * normals[g, 2] - e[2] * normals[g, 1])
                old[1] = tangent * e[1] + outward * (e[2] * normals[g, 0] - e[0] * normals[g, 2])
                old[2] = tangent * e[2] + outward * (e[0] * normals[g, 1] - e[1] * normals[g, 0])
                share = b[(k + 1) % 3] / (b[k] + b[(k + 1) % 3])
                b[h] = share
                b[(h + 1) % 3] = 1.0 - share
                b[(h + 2) % 3] = 0.0
                f = g
            if ended:
                break
            _flow_vector(f, vertices, faces, rates, v)
        point_faces[point] = f
        total = b[0] + b[1] + b[2]
        for c in range(3):
            coordinates[point, c] = b[c] / total


@kernel
def _flow_vector(f, vertices, faces, rates, v):
    for x in range(3):
        v[x] = 0.0
        for c in range(3):
            v[x] += rates[f, c] * vertices[faces[f, c], x]


@kernel
def _coordinate_rates(f, vertices, faces, areas, normals, direction, r):
    # Inner products of a tangent vector with the gradients of the barycentric coordinates.
    for c in range(3):
        p, q = faces[f, (c + 1) % 3], faces[f, (c + 2) % 3]
        ex = vertices[q, 0] - vertices[p, 0]
        ey = vertices[q, 1] - vertices[p, 1]
        ez = vertices[q, 2] - vertices[p, 2]
        r[c] = (
            (normals[f, 1] * ez - normals[f, 2] * ey) * direction[0]
            + (normals[f, 2] * ex - normals[f, 0] * ez) * direction[1]
            + (normals[f, 0] * ey - normals[f, 1] * ex) * direction[2]
        ) / (2 * areas[f])
