# SPDX-License-Identifier: GPL-3.0-or-later
"""What a refit has come to, place by place: where it has not come nearer to its normals, it goes.

Not in the papers. Where walls are as thin as their faces, or sheets touch, there is no surface of
these faces with the wanted normals, and half of the way there is worse than none.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.findings import tell
from ..base.parallel import kernel, run
from ..base.vectors import cross, dot, edge
from ..flow.potential import dilation
from ..mesh.adjacency import connected_parts
from ..mesh.calculus import average_to_vertices, smooth_vertices
from ..mesh.nearest import nearest_point, point_tree, points_within
from ..mesh.triangle_mesh import Floats, TriangleMesh
from .creases import ramp

_LEFT = 0.6, 1.0
"""Share of the deviation from the wanted normals that is left around a vertex, from which it goes
back in part, and fully: where more than 0.7 is left, made solids gain nothing in the mean."""

_AROUND = 8
"""Smoothing passes that add the deviations up."""

_DEGREE = 1.0 - np.cos(np.radians(1.0))
"""Deviations of that size are none."""

_SEEN = 0.1
"""A move in mean edge lengths that is missed, when it is taken back."""

_THIN, _FAR = 2.0, 3.0
"""Mean edge lengths between two sides of a thin wall; so far they are looked for."""

_TOUCHING = 0.1
"""Edge lengths below which no finer mesh parts the two sides."""

_BESIDE = 1.5
"""The square of how far beside a vertex the other side may lie."""

_DRIFT = 0.02
"""Of what vertices around go along their normals in the mean, in edges: less is no drift."""

_APART = 3.0, 4.0
"""Mean edge lengths between two sides from which drifting matters less, and not at all."""

_NARROWED = 0.04, 0.12
"""Share of the way between two sides that drifting would take away, from which it is taken back in
part, and fully: creases that close do not move what lies between them."""


def without_worse(mesh: TriangleMesh, targets: Floats, moved: Floats) -> tuple[Floats, Floats]:
    """Take a displacement back where faces have hardly come nearer to their normals.

    Parameters
    ----------
    mesh : TriangleMesh
        Before.
    targets : (m, 3) float64
        The normals that its faces should have.
    moved : (n, 3) float64
        The displacement, in the unit of `mesh.vertices`.

    Returns
    -------
    moved : (n, 3) float64
    lost : (n,) float64
        How far each vertex went back, in mean edge lengths.
    """
    off = np.empty((mesh.face_count, 2))
    run(_measure, mesh.face_count, mesh.scaled_vertices, moved, mesh.faces, mesh.normals, targets,
        1.0 / mesh.mean_edge_length, off)  # fmt: skip
    off = smooth_vertices(mesh, average_to_vertices(mesh, off), _AROUND)
    back = ramp(off[:, 1] / (off[:, 0] + _DEGREE), _LEFT)
    if not back.any():
        return moved, back
    back = smooth_vertices(mesh, back.reshape(-1, 1), 2)
    lengths = np.linalg.norm(moved, axis=1) / mesh.mean_edge_length
    return moved * (1.0 - back), back[:, 0] * lengths


def tell_lost(mesh: TriangleMesh, lost: Floats) -> None:
    """Say how many places went back, and what helps."""
    places = np.flatnonzero(lost > _SEEN)
    if len(places) == 0:
        return
    thickness = _thickness(mesh, places)
    is_thin = (thickness > _TOUCHING) & (thickness < _THIN)
    thin = places[is_thin]
    count, others = _count(mesh, thin), _count(mesh, places) - _count(mesh, thin)
    if count:
        size = mesh.mean_edge_length * float(np.median(thickness[is_thin])) / 3.0
        tell(
            "Places that are thinner than 2 edges and stay: {count}. Remesh finer, to about"
            " {size:.2g}.",
            count=count,
            size=size,
        )
    if others > 0:
        tell("Places that stay, as no faces of this size fit them better: {count}.", count=others)


def _count(mesh: TriangleMesh, vertices: npt.NDArray[np.intp]) -> int:
    # How many places they make: those within two edges of each other are one.
    if len(vertices) == 0:
        return 0
    chosen = np.zeros(mesh.vertex_count, dtype=np.uint8)
    chosen[vertices] = 1
    chosen = dilation(mesh, chosen, 1)
    start, ring = mesh.neighbours
    inside = chosen > 0
    keep = inside[ring] & np.repeat(inside, np.diff(start))
    counts = np.add.reduceat(np.append(keep, False), start[:-1]) * (np.diff(start) > 0)
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    part, _ = connected_parts((starts, ring[keep]))
    return len(np.unique(part[inside]))


def without_drift(
    mesh: TriangleMesh, moved: Floats, fixed: npt.NDArray[np.bool_] | None = None
) -> Floats:
    """Take back how far the sides of thin walls, or of narrow gaps, have moved towards each other.

    A refit knows normals alone: they let sheets whose borders turn sink into each other, or into
    what lies between. What vertices go in the mean around is no crease that closes.

    Parameters
    ----------
    mesh : TriangleMesh
        Before.
    moved : (n, 3) float64
        The displacement, in the unit of `mesh.vertices`.
    fixed : (n,) bool, optional
        Vertices that stay.

    Returns
    -------
    (n, 3) float64
        The displacement; `moved` itself where nothing drifts.
    """
    normals = average_to_vertices(mesh, mesh.normals)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    along = np.einsum("vx,vx->v", moved, normals) / mesh.mean_edge_length
    drift = smooth_vertices(mesh, along.reshape(-1, 1), _AROUND)[:, 0]
    places = np.flatnonzero(np.abs(drift) > _DRIFT)
    if len(places) == 0:
        return moved
    toward = normals[places] * np.sign(drift[places])[:, None]
    between = _other_sides(mesh, normals, places, toward, _APART[1])
    narrowed = 2.0 * np.abs(drift[places]) / np.maximum(between, 1e-12)
    share = np.zeros(mesh.vertex_count)
    share[places] = ramp(narrowed, _NARROWED) * (1.0 - ramp(between, _APART))
    share = smooth_vertices(mesh, share.reshape(-1, 1), 2)[:, 0]
    if fixed is not None:
        share[fixed] = 0.0
    return moved - (share * drift * mesh.mean_edge_length)[:, None] * normals


def _thickness(mesh: TriangleMesh, places: npt.NDArray[np.intp]) -> Floats:
    # Distance to what faces the other way and lies behind or before a vertex, in edges; at most
    # _FAR.
    return _other_sides(mesh, average_to_vertices(mesh, mesh.normals), places, None, _FAR)


def _other_sides(
    mesh: TriangleMesh, normals: Floats, places: npt.NDArray[np.intp], toward: Floats | None,
    far: float,
) -> Floats:  # fmt: skip
    # Distances along the normals to what faces the other way, in edges; towards one side, if given.
    points = mesh.scaled_vertices
    _, nearest = nearest_point(point_tree(points[places]), points, far)
    near = np.flatnonzero(nearest >= 0).astype(np.int32)
    start, around = points_within(point_tree(points[near]), points[places], far)
    found = np.empty(len(places))
    ways = np.zeros((0, 3)) if toward is None else toward
    run(_find_other_sides, len(places), places, points, normals, near, start, around, ways, far,
        found)  # fmt: skip
    return found


@kernel
def _find_other_sides(start, stop, places, points, normals, near, begin, around, ways, far, found):
    for i in range(start, stop):
        v, least = places[i], far
        n = normals[v]
        length = max(np.sqrt(dot(n, n)), 1e-12)
        for k in range(begin[i], begin[i + 1]):
            o = near[around[k]]
            if dot(normals[o], n) >= -0.5 * length:
                continue
            way = edge(points, v, o)
            along = dot(way, n) / length
            if len(ways) > 0 and dot(way, ways[i]) <= 0:
                continue
            if dot(way, way) - along * along < _BESIDE:
                least = min(least, abs(along))
        found[i] = least


@kernel
def _measure(start, stop, vertices, moved, faces, before, targets, unit, off):
    # 1 - cos of the angle to the wanted normal, times the area in squared mean edge lengths.
    for f in range(start, stop):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        u, v = edge(vertices, a, b), edge(vertices, a, c)
        n = cross(u, v)
        off[f, 0] = np.sqrt(dot(n, n)) * (1.0 - dot(before[f], targets[f]))
        p, q = edge(moved, a, b), edge(moved, a, c)
        n = cross(
            (u[0] + unit * p[0], u[1] + unit * p[1], u[2] + unit * p[2]),
            (v[0] + unit * q[0], v[1] + unit * q[1], v[2] + unit * q[2]),
        )
        off[f, 1] = np.sqrt(dot(n, n)) - dot(n, targets[f])
