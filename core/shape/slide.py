# SPDX-License-Identifier: GPL-3.0-or-later
"""Further steps of the refit, in which vertices slide along flat sides onto the creases.

The refit of paper A, 4.1, replaces each face's coordinate gradients by their projections and solves
once. That is one step of majorise-minimise for the energy eps |c - c0|^2 + sum of A |grad(N c)|^2,
whose minimum lies farther: a face may slide in its plane at no cost. All steps share the matrix;
only the right-hand side, minus half the energy's gradient, changes. Not in the paper.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.findings import tell
from ..base.parallel import kernel, run
from ..base.progress import ask, phase
from ..base.vectors import TIE_BREAKER, after, cross, dot
from ..linear.cg import roughly
from ..linear.system import LinearSystem
from ..mesh.adjacency import count_sort, distinct, faces_around, within_rings
from ..mesh.calculus import corners_of, cosines, cotangents_of, faces_touching
from ..mesh.triangle_mesh import Floats, Ints, TriangleMesh

LOOSE = 0.05
"""Relative residual of the first step's solve if further steps follow. A smaller one would bend
flat sides near creases, as the first step's minimum does, and further steps would have to undo it.
"""

_LEAST_TURN = np.radians(1.0)
"""Further steps are taken around faces that are to turn by more than this."""

_RINGS = 6
"""Number of rings around those faces in which vertices take further steps."""

_INNER = 8
"""Iterations of the inner solve in a further step."""

_SLIDE_EVERY = 6
"""Number of steps between two rounds in which vertices of thin faces slide."""

_LAST_SLIDES = 8
"""Rounds of sliding after the last step."""

_SETTLED = 1e-2
"""Steps end once one moves no coordinate by this much, in mean edge lengths."""

_STIFF = 1000.0
"""Stiffness against slides across the planes of a vertex's faces, relative to along them."""

_SHAPE_RAMP = 0.1, 0.5
"""Ramp of a face's shape (see `_shapes`) over that of the input: below the first value its vertices
slide fully, above the second not at all."""

_SLIDE_SHARE = 0.5
"""Share of the way to the mean of its neighbours that a vertex slides in a round."""

_HEIGHT, _HEIGHT_FACTOR = 0.05, 0.8
"""Least height that a turned-over face is given, relative to its longest edge, and the factor of
that in each further round."""

_SLIDES, _RETREATS, _RETURNS = 20, 80, 8
"""Rounds in which turned-over faces are given a height, in which their vertices go back in part,
and in which they go back fully."""

_RETREAT = 0.97
"""Factor of a displacement in each round in which vertices go back in part."""

_FOLD = np.cos(np.radians(150.0))
"""Cosine of the angle between the normals at an edge below which its faces are folded."""

_EQUAL_LENGTHS = 1e-9
"""Squared lengths are equal if their relative difference is less: it may be rounding."""

_CHUNK = 8192
"""Number of rows per partial sum; fixed, so that sums are rounded alike on any number of cores."""


class _Piece(NamedTuple):
    # The part of a mesh that takes further steps, and a fixed rim around it, with own indices.
    vertices: Floats
    faces: Ints
    corners: tuple[Ints, Ints]
    halves: Floats
    areas: Floats
    normals: Floats
    shapes: Floats
    screen: Floats
    system: LinearSystem


def further_steps(
    mesh: TriangleMesh,
    system: LinearSystem,
    normals: Floats,
    near: npt.NDArray[np.bool_],
    moved: Floats,
    steps: int,
) -> Floats:
    """Continue a refit after its first step, by preconditioned conjugate gradients.

    The preconditioner is the matrix of the first step, solved inexactly, hence the flexible variant
    of Polak and Ribiere. Between steps, vertices of thin or turned-over faces slide along the
    planes of their faces: along a crease on creases, and not at all at corners. Vertices far from
    all faces that turn are final after the first step.

    Parameters
    ----------
    mesh : TriangleMesh
    system : LinearSystem
        The refit's matrix.
    normals : (m, 3) float64
        Target normals.
    near : (n,) bool
        The vertices that take further steps, from `near_turns`; at least one.
    moved : (n, 3) float64
        The displacement of the first step, in mean edge lengths.
    steps : int
        Number of steps, including the first.

    Returns
    -------
    (n, 3) float64
        The displacement, in mean edge lengths.
    """
    message = "Fitting the surface"
    with phase(0.0, 0.1, message):
        index, piece = _cut_out(mesh, system, normals, near)
    with phase(0.1, 1.0, message):
        slid = _descend(piece, moved[index], steps, message)
    with phase(1.0, 1.0, message):
        moved[index] = _without_turned(piece, slid)
    return moved


def near_turns(mesh: TriangleMesh, normals: Floats) -> npt.NDArray[np.bool_]:
    """Mark the vertices near faces that turn, which take further steps: (n,)."""
    turned = (cosines(mesh.normals, normals) < np.cos(_LEAST_TURN)) & (mesh.areas > 0)
    return within_rings(mesh.neighbours, corners_of(mesh, turned), _RINGS)


def _cut_out(
    mesh: TriangleMesh, system: LinearSystem, normals: Floats, near: npt.NDArray[np.bool_]
) -> tuple[Ints, _Piece]:
    # Returns the indices in the mesh of the piece's vertices, and the piece.
    taken = faces_touching(mesh, near)
    chosen = np.flatnonzero(taken)
    index = np.flatnonzero(corners_of(mesh, taken)).astype(np.int32)
    number = np.empty(mesh.vertex_count, dtype=np.int32)
    number[index] = np.arange(len(index), dtype=np.int32)
    faces = number[mesh.faces[chosen]]
    inner = system.part(index)
    inner.fixed |= ~near[index]
    vertices, targets = mesh.scaled_vertices[index], normals[chosen]
    shapes = np.empty(len(chosen))
    run(_shapes, len(chosen), np.arange(len(chosen)), vertices, np.zeros(vertices.shape), faces,
        mesh.normals[chosen], shapes)  # fmt: skip
    corners = count_sort(faces.reshape(-1), len(index))
    areas = mesh.areas[chosen]
    halves = cotangents_of(vertices, faces, areas)
    screen = system.screen[index]
    return index, _Piece(vertices, faces, corners, halves, areas, targets, shapes, screen, inner)


def _descend(piece: _Piece, moved: Floats, steps: int, message: str) -> Floats:
    zeros = np.zeros(moved.shape)
    residual = _downhill(piece, piece.vertices, moved)
    direction, change, product = zeros.copy(), residual, np.inf
    for iteration in range(1, steps):
        with phase((iteration - 1) / (steps - 1), iteration / (steps - 1), message):
            step = roughly(piece.system, residual, _INNER, message)
            beta = max(_sum(_dot, step, change) / product, 0.0)
            product = _sum(_next_direction, step, residual, direction, beta)
            change = _downhill(piece, zeros, direction)
            curvature = -_sum(_dot, change, direction)
            if not (product > 0 and curvature > 0):
                break
            length = _sum(_dot, residual, direction) / curvature
            farthest = _of_chunks(_go, direction, length, change, moved, residual).max()
            if farthest < _SETTLED:
                break
            if iteration % _SLIDE_EVERY == 0:
                moved = _evened(piece, moved, 1)
                residual = _downhill(piece, piece.vertices, moved)
                product = np.inf
    return _evened(piece, moved, _LAST_SLIDES)


def _downhill(piece: _Piece, vertices: Floats, moved: Floats) -> Floats:
    # Minus half the energy's gradient; with `vertices` 0, its change along `moved`.
    flux, out = np.empty_like(piece.halves), np.empty_like(moved)
    run(_flux, len(flux), vertices, moved, piece.faces, piece.halves, piece.normals, flux)
    run(_pull, len(out), *piece.corners, piece.system.fixed, piece.screen, moved,
        piece.normals, flux, out)  # fmt: skip
    return out


def _evened(piece: _Piece, moved: Floats, rounds: int) -> Floats:
    moved, now = moved.copy(), np.empty(len(piece.faces))
    faces, vertices = np.arange(len(now)), np.arange(len(moved))
    for _ in range(rounds):
        run(_shapes, len(faces), faces, piece.vertices, moved, piece.faces, piece.normals, now)
        slides, needs = np.empty((len(vertices), 3)), np.empty(len(vertices))
        run(_even_out, len(vertices), vertices, piece.vertices, moved, piece.faces, *piece.corners,
            piece.areas, piece.normals, piece.shapes, now, piece.system.fixed, slides,
            needs)  # fmt: skip
        sliding = np.flatnonzero(needs)
        moved[vertices[sliding]] += slides[sliding]
        ask()
        # Faces farther away have not changed.
        faces = faces_around(piece.corners, vertices[sliding])
        vertices = distinct(piece.faces[faces], len(moved))
    return moved


def _of_chunks(function: Callable[..., None], *arguments: Any) -> Floats:
    # Returns what a kernel computes for each chunk of rows.
    count = len(arguments[0])
    found = np.zeros(-(-count // _CHUNK))
    run(function, count, *arguments, found, chunk=_CHUNK)
    return found


def _sum(function: Callable[..., None], *arguments: Any) -> float:
    return float(_of_chunks(function, *arguments).sum())


def _without_turned(piece: _Piece, moved: Floats) -> Floats:
    # First, turned-over faces are given a height. Vertices of faces that stay turned over, and were
    # not so before, then go back, at first in part and at last fully. Faces that are folded but not
    # turned over are left to `unfold`: a height would move them too far.
    fixed, around = piece.system.fixed, np.arange(len(piece.faces))
    least = np.minimum(_row_dots(_unit_normals(piece.vertices[piece.faces]), piece.normals), 0.0)
    ask()
    rounds = _SLIDES + _RETREATS + _RETURNS
    for attempt in range(rounds + 1):
        x = piece.vertices[piece.faces[around]] + moved[piece.faces[around]]
        ask()
        upright = 0.0 if attempt < _SLIDES else least[around]
        turned = _row_dots(_unit_normals(x), piece.normals[around]) < upright
        bad = around[turned & (piece.shapes[around] > 0)]
        if len(bad) == 0:
            break
        if attempt == rounds:
            tell("Faces that stay flipped: {count}.", count=len(bad))
            break
        if attempt < _SLIDES:
            _give_height(piece, moved, bad, _HEIGHT * _HEIGHT_FACTOR**attempt)
        else:
            corners = distinct(piece.faces[bad], len(moved))
            left = _RETREAT if attempt < _SLIDES + _RETREATS else 0.0
            moved[corners[~fixed[corners]]] *= left
        around = faces_around(piece.corners, distinct(piece.faces[bad], len(moved)))
    return moved


def unfold(mesh: TriangleMesh, moved: Floats) -> None:
    """Undo a displacement, in place and in small steps, where it folds faces onto each other.

    Parameters
    ----------
    mesh : TriangleMesh
    moved : (n, 3) float64
        The displacement, in the unit of `mesh.vertices`.
    """
    around = np.arange(mesh.face_count, dtype=np.int32)
    rounds = _RETREATS + _RETURNS
    for attempt in range(rounds + 1):
        folded = np.empty(len(around), dtype=np.bool_)
        run(_find_folds, len(around), around, mesh.vertices, moved, mesh.faces, mesh.twins,
            mesh.normals, folded)  # fmt: skip
        bad = mesh.faces[around[folded]]
        if len(bad) == 0:
            break
        if attempt == rounds:
            tell("Faces that stay folded: {count}.", count=len(bad))
            break
        corners = distinct(bad, len(moved))
        moved[corners] *= _RETREAT if attempt < _RETREATS else 0.0
        around = faces_around(mesh.corners, corners)


def _give_height(piece: _Piece, moved: Floats, chosen: npt.NDArray[Any], least: float) -> None:
    """Move the corner opposite the longest edge to the right side of it, in the target's plane.

    The height of the face is then at least `least` times that edge. A corner of several faces moves
    by the mean of their moves. Among edges of equal length, the one whose opposite corner lies
    farthest along a fixed direction is taken, so that the order of corners does not matter.
    """
    faces, normals = piece.faces[chosen], piece.normals[chosen]
    x = piece.vertices[faces] + moved[faces]
    edges = np.roll(x, 1, axis=1) - np.roll(x, -1, axis=1)
    squares = np.einsum("fkx,fkx->fk", edges, edges)
    longest = squares >= (1.0 - _EQUAL_LENGTHS) * squares.max(axis=1, keepdims=True)
    along = np.where(longest, x @ np.array(TIE_BREAKER), -np.inf)
    rows = np.arange(len(x)), along.argmax(axis=1)
    length = np.linalg.norm(edges[rows], axis=1)
    inward = np.cross(normals, edges[rows]) / np.maximum(length, 1e-12)[:, None]
    base = np.roll(x, -1, axis=1)[rows]
    height = _row_dots(x[rows] - base, inward)
    corners = faces[rows]
    rise = np.maximum(np.where(piece.system.fixed[corners], 0.0, least * length - height), 0.0)
    total, count = np.zeros_like(moved), np.zeros(len(moved))
    np.add.at(total, corners, rise[:, None] * inward)
    np.add.at(count, corners, rise > 0)
    moved += total / np.maximum(count, 1.0)[:, None]


def _unit_normals(corners: Floats) -> Floats:
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)


def _row_dots(one: Floats, other: Floats) -> Floats:
    return np.einsum("fx,fx->f", one, other)


@kernel
def _dot(start, stop, one, other, sums):
    total = 0.0
    for v in range(start, stop):
        total += dot(one[v], other[v])
    sums[start // _CHUNK] = total


@kernel
def _next_direction(start, stop, step, residual, direction, beta, sums):
    # Updates the search direction, and sums up step times residual.
    total = 0.0
    for v in range(start, stop):
        total += dot(step[v], residual[v])
        for x in range(3):
            direction[v, x] = step[v, x] + beta * direction[v, x]
    sums[start // _CHUNK] = total


@kernel
def _go(start, stop, direction, length, change, moved, residual, farthest):
    # Moves along the search direction; finds the largest change of a coordinate.
    most = 0.0
    for v in range(start, stop):
        for x in range(3):
            step = length * direction[v, x]
            moved[v, x] += step
            most = max(most, abs(step))
            change[v, x] *= length
            residual[v, x] += change[v, x]
    farthest[start // _CHUNK] = most


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
    # Minus half the gradient of the energy, at the vertices.
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
def _normal(vertices, moved, faces, f):
    a = _corner(vertices, moved, faces[f, 0])
    b = _corner(vertices, moved, faces[f, 1])
    c = _corner(vertices, moved, faces[f, 2])
    return cross((b[0] - a[0], b[1] - a[1], b[2] - a[2]), (c[0] - a[0], c[1] - a[1], c[2] - a[2]))


@kernel
def _find_folds(start, stop, chosen, vertices, moved, faces, twins, before, folded):
    # Finds faces that are folded onto a neighbour, and were not before.
    for i in range(start, stop):
        f = chosen[i]
        folded[i] = False
        n = _normal(vertices, moved, faces, f)
        for k in range(3):
            if twins[f, k] < 0 or folded[i]:
                continue
            g = twins[f, k] // 3
            m = _normal(vertices, moved, faces, g)
            size = np.sqrt(dot(n, n) * dot(m, m))
            folded[i] = dot(n, m) < _FOLD * size and dot(before[f], before[g]) >= _FOLD


@kernel
def _shapes(start, stop, chosen, vertices, moved, faces, normals, shapes):
    # Twice the area, signed by the normal N, over the sum of squared edges: at most 0.29.
    for i in range(start, stop):
        f = chosen[i]
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
    chosen,
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
    slides,
    needs,
):
    # Slides vertices of faces that have lost their shape towards the mean of their neighbours.
    for j in range(start, stop):
        v, needs[j] = chosen[j], 0.0
        if fixed[v]:
            continue
        worst = 1.0
        for i in range(corner_start[v], corner_start[v + 1]):
            f = corners[i] // 3
            if before[f] > 0:
                worst = min(worst, now[f] / before[f])
        need = min(max((_SHAPE_RAMP[1] - worst) / (_SHAPE_RAMP[1] - _SHAPE_RAMP[0]), 0.0), 1.0)
        needs[j] = need
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
        t = _SLIDE_SHARE * need / (xx * p + xy * q + xz * r)
        slides[j, 0] = t * (p * x + q * y + r * z)
        slides[j, 1] = t * (q * x + (xx * zz - xz * xz) * y + (xy * xz - xx * yz) * z)
        slides[j, 2] = t * (r * x + (xy * xz - xx * yz) * y + (xx * yy - xy * xy) * z)
