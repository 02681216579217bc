# SPDX-License-Identifier: GPL-3.0-or-later
"""Further steps of the refit, in which vertices slide along flat sides onto the creases.

The refit of paper A, 4.1, replaces each face's coordinate gradients by their projections and solves
once. That is one step of majorise-minimise for the energy eps |c - c0|^2 + sum of A |grad(N c)|^2,
whose minimum lies farther: a face may slide in its plane at no cost. All steps share the matrix;
only the right-hand side, minus half the energy's gradient, changes. Not in the paper.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..base.progress import phase
from ..base.vectors import after, cross, dot
from ..linear.cg import roughly
from ..linear.system import LinearSystem
from ..mesh.calculus import cotangents
from ..mesh.triangle_mesh import Floats, TriangleMesh

LOOSE = 0.05
"""Residual of the first step's solve where others follow: they make up for it."""

_INNER = 8
"""Iterations of a further step's solve."""

_EVENED = 6
"""After so many steps faces are evened out, and at the end."""

_SETTLED = 1e-2
"""A step that moves no vertex by more than this, in mean edge lengths, is the last."""

_STIFF = 1000.0
"""How much less vertices slide across the planes of their faces than along."""

_KEPT_SHAPE = 0.1, 0.5
"""Shapes, relative to the input's, below which vertices slide fully, and above which not at all."""

_SLIDE = 0.5
"""How much of the way to the mean of its neighbours a vertex slides in a step."""

_HEIGHT = 0.05
"""Height that turned faces are given, relative to their longest edge."""

_SLIDES, _RETREATS = 20, 8
"""Rounds in which turned faces get a height; in which their vertices go back half of their way."""


def further_steps(
    mesh: TriangleMesh,
    system: LinearSystem,
    normals: Floats,
    moved: Floats,
    steps: int,
) -> Floats:
    """Go on from the first step of a refit, by preconditioned conjugate gradients.

    The matrix of the first step is the preconditioner, solved roughly (so the flexible variant, of
    Polak and Ribiere). Now and then faces that become thin or turn over are evened out: their
    vertices slide along the planes of their faces, so along the crease at a crease, and stay at
    corners.

    Parameters
    ----------
    mesh : TriangleMesh
    system : LinearSystem
        The refit's matrix.
    normals : (m, 3) float64
        Target normals.
    moved : (n, 3) float64
        The displacement of the first step, in mean edge lengths.
    steps : int
        Steps in all.
    multigrid : bool
        What the first step was solved with.

    Returns
    -------
    (n, 3) float64
        The displacement, in mean edge lengths.

    Raises
    ------
    SolverError
        If a step's linear system cannot be solved.
    """
    if not moved.any():
        return moved
    message = "Fitting the surface"
    halves = cotangents(mesh)
    flux, now = np.empty((mesh.face_count, 3)), np.empty(mesh.face_count)
    still = np.zeros_like(moved)
    before = np.empty(mesh.face_count)
    run(_shapes, mesh.face_count, mesh.scaled_vertices, still, mesh.faces, mesh.normals, before)

    def downhill(positions: Floats, ahead: Floats) -> Floats:
        # Minus half the energy's gradient, where positions move ahead.
        out = np.empty_like(ahead)
        run(_flux, mesh.face_count, positions, ahead, mesh.faces, halves, normals, flux)
        run(_pull, mesh.vertex_count, *mesh.corners, system.fixed, system.screen, ahead, normals,
            flux, out)  # fmt: skip
        return out

    def evened(ahead: Floats) -> Floats:
        out = ahead.copy()
        run(_shapes, mesh.face_count, mesh.scaled_vertices, ahead, mesh.faces, normals, now)
        run(_even_out, mesh.vertex_count, mesh.scaled_vertices, ahead, mesh.faces, *mesh.corners,
            mesh.areas, normals, before, now, system.fixed, out)  # fmt: skip
        return out

    residual = change = downhill(mesh.scaled_vertices, moved)
    way, product = still.copy(), np.inf
    for turn in range(1, steps):
        with phase((turn - 1) / (steps - 1), turn / (steps - 1), message):
            step = roughly(system, residual, _INNER, message)
            way *= max(_dot(step, change) / product, 0.0)
            way += step
            product = _dot(step, residual)
            change = downhill(still, way)
            curvature = -_dot(change, way)
            if not (product > 0 and curvature > 0):
                break
            length = _dot(residual, way) / curvature
            change *= length
            residual += change
            moved = moved + length * way
            if length * abs(way).max() < _SETTLED:
                break
            if turn % _EVENED == 0:
                moved = evened(moved)
                residual = downhill(mesh.scaled_vertices, moved)
                product = np.inf
    return _without_turned(mesh, normals, before, system.fixed, evened(moved))


def _dot(a: Floats, b: Floats) -> float:
    # Not numpy's dot, whose threads get into the way of ours.
    return float(np.einsum("ij,ij->", a, b))


def _without_turned(
    mesh: TriangleMesh, normals: Floats, before: Floats, fixed: npt.NDArray[np.bool_], moved: Floats
) -> Floats:
    # Vertices around faces that have turned over slide on; those that stay so go back, half of
    # their way each time, until there are none.
    now = np.empty(mesh.face_count)
    run(_shapes, mesh.face_count, mesh.scaled_vertices, moved, mesh.faces, normals, now)
    turned = np.flatnonzero((now <= 0) & (before > 0))
    for turn in range(_SLIDES + _RETREATS):
        if len(turned) == 0:
            break
        faces, n = mesh.faces[turned], normals[turned]
        if turn < _SLIDES:
            # The corner opposite the longest edge goes to the right side of it, in the plane.
            x = mesh.scaled_vertices[faces] + moved[faces]
            edges = np.roll(x, 1, axis=1) - np.roll(x, -1, axis=1)
            rows = np.arange(len(x)), np.einsum("fkx,fkx->fk", edges, edges).argmax(axis=1)
            length = np.linalg.norm(edges[rows], axis=1)
            inward = np.cross(n, edges[rows]) / np.maximum(length, 1e-12)[:, None]
            base = np.roll(x, -1, axis=1)[rows]
            height = np.einsum("fx,fx->f", x[rows] - base, inward)
            way = np.where(fixed[faces[rows]], 0.0, _HEIGHT * length - height)
            moved[faces[rows]] += way[:, None] * inward
        else:
            moved[np.unique(faces)] *= 0.5
        near = _around(mesh, np.unique(faces))
        shapes = np.empty(len(near))
        _shapes(0, len(near), mesh.scaled_vertices, moved, mesh.faces[near], normals[near], shapes)
        turned = near[(shapes <= 0) & (before[near] > 0)]
    return moved


def _around(mesh: TriangleMesh, vertices: npt.NDArray[np.integer]) -> npt.NDArray[np.integer]:
    # The faces around some vertices.
    start, corners = mesh.corners
    return np.unique(np.concatenate([corners[start[v] : start[v + 1]] // 3 for v in vertices]))


@kernel
def _flux(start, stop, vertices, moved, faces, halves, normals, flux):
    # Half the cotangent times the difference of N . x along each half-edge.
    for f in range(start, stop):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        n = normals[f]
        p = dot(n, vertices[a]) + dot(n, moved[a])
        q = dot(n, vertices[b]) + dot(n, moved[b])
        r = dot(n, vertices[c]) + dot(n, moved[c])
        flux[f, 0] = halves[f, 0] * (p - q)
        flux[f, 1] = halves[f, 1] * (q - r)
        flux[f, 2] = halves[f, 2] * (r - p)


@kernel
def _pull(start, stop, corner_start, corners, fixed, screen, moved, normals, flux, rhs):
    # Minus half the gradient of the energy at the vertices.
    for v in range(start, stop):
        if fixed[v]:
            rhs[v] = 0.0
            continue
        x, y, z = -screen[v] * moved[v, 0], -screen[v] * moved[v, 1], -screen[v] * moved[v, 2]
        for i in range(corner_start[v], corner_start[v + 1]):
            f = corners[i] // 3
            k = corners[i] - 3 * f
            along = flux[f, k] - flux[f, after(after(k))]
            x -= along * normals[f, 0]
            y -= along * normals[f, 1]
            z -= along * normals[f, 2]
        rhs[v, 0], rhs[v, 1], rhs[v, 2] = x, y, z


@kernel
def _corner(vertices, moved, v):
    return (
        vertices[v, 0] + moved[v, 0],
        vertices[v, 1] + moved[v, 1],
        vertices[v, 2] + moved[v, 2],
    )


@kernel
def _shapes(start, stop, vertices, moved, faces, normals, shapes):
    # Twice the area, with the sign of N, over the sum of squared edges: at most 0.29.
    for f in range(start, stop):
        a = _corner(vertices, moved, faces[f, 0])
        b = _corner(vertices, moved, faces[f, 1])
        c = _corner(vertices, moved, faces[f, 2])
        u = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        v = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        w = c[0] - b[0], c[1] - b[1], c[2] - b[2]
        squares = dot(u, u) + dot(v, v) + dot(w, w)
        shapes[f] = dot(cross(u, v), normals[f]) / squares if squares > 0 else 0.0


@kernel
def _even_out(
    start,
    stop,
    vertices,
    moved,
    faces,
    corner_start,
    corners,
    areas,
    normals,
    before,
    now,
    fixed,
    out,
):
    # Slides v towards the mean of its neighbours, where a face around it has lost its shape.
    for v in range(start, stop):
        if fixed[v]:
            continue
        worst = 1.0
        for i in range(corner_start[v], corner_start[v + 1]):
            f = corners[i] // 3
            if before[f] > 0:
                worst = min(worst, now[f] / before[f])
        need = min(max((_KEPT_SHAPE[1] - worst) / (_KEPT_SHAPE[1] - _KEPT_SHAPE[0]), 0.0), 1.0)
        if need == 0:
            continue
        x = y = z = count = total = 0.0
        xx = xy = xz = yy = yz = zz = 0.0
        for i in range(corner_start[v], corner_start[v + 1]):
            f = corners[i] // 3
            k = corners[i] - 3 * f
            for other in (faces[f, after(k)], faces[f, after(after(k))]):
                c = _corner(vertices, moved, other)
                x += c[0]
                y += c[1]
                z += c[2]
                count += 1.0
            n = normals[f]
            a = areas[f]
            total += a
            xx += a * n[0] * n[0]
            xy += a * n[0] * n[1]
            xz += a * n[0] * n[2]
            yy += a * n[1] * n[1]
            yz += a * n[1] * n[2]
            zz += a * n[2] * n[2]
        c = _corner(vertices, moved, v)
        x, y, z = x / count - c[0], y / count - c[1], z / count - c[2]
        # (1 + stiff * mean of N N^T) slide = way: along all planes, or not at all.
        s = _STIFF / total
        xx, yy, zz = 1.0 + s * xx, 1.0 + s * yy, 1.0 + s * zz
        xy, xz, yz = s * xy, s * xz, s * yz
        p, q, r = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
        t = _SLIDE * need / (xx * p + xy * q + xz * r)
        out[v, 0] += t * (p * x + q * y + r * z)
        out[v, 1] += t * (q * x + (xx * zz - xz * xz) * y + (xy * xz - xx * yz) * z)
        out[v, 2] += t * (r * x + (xy * xz - xx * yz) * y + (xx * yy - xy * xy) * z)
