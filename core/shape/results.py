# SPDX-License-Identifier: GPL-3.0-or-later
"""Undoes a refit where it has not brought the faces nearer to their target normals.

Not in the papers. Where walls are as thin as the edges of their faces, or sheets touch, these faces
cannot form a surface with the target normals, and a refit that fails is worse than none.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.findings import tell
from ..base.parallel import kernel, run
from ..base.vectors import cross, dot, edge
from ..mesh.adjacency import connected_parts, within_rings
from ..mesh.calculus import average_to_vertices, mean_normals, smooth_vertices, unit_vectors
from ..mesh.nearest import nearest_point, point_tree, points_within
from ..mesh.triangle_mesh import Floats, TriangleMesh
from .creases import ramp

_LEFT = 0.6, 1.0
"""Ramp of the deviation from the target normals around a vertex, over that before the refit: below
the first value the vertex stays moved, above the second it goes back fully. On synthetic solids, a
ratio above 0.7 is no gain on average."""

_PASSES = 8
"""Smoothing passes that average deviations and drifts over the surroundings."""

_DEGREE = 1.0 - np.cos(np.radians(1.0))
"""Deviations of this size, 1 degree, count as none."""

_REPORTED_MOVE = 0.1
"""Moves by more than this, in mean edge lengths, are reported if they are undone."""

_THIN, _FAR = 2.0, 3.0
"""Thickness below which a wall is thin, and up to which it is measured, in mean edge lengths."""

_TOUCHING = 0.1
"""Thickness, in mean edge lengths, below which even a finer remesh would not separate the sides."""

_LATERAL_SQUARE = 1.5
"""Greatest square of the lateral distance at which a vertex counts as the other side of a wall, in
squared mean edge lengths."""

_DRIFT = 0.02
"""Mean move of the surroundings along the normal, in mean edge lengths, up to which there is no
drift."""

_DISTANCE_RAMP = 3.0, 4.0
"""Ramp of the distance between two sides, in mean edge lengths: below the first value their drift
matters fully, above the second not at all."""

_NARROWING_RAMP = 0.04, 0.12
"""Ramp of the share of that distance by which drift would reduce it: below the first value drift
stays, above the second it is undone fully. Creases that close cause no drift."""


def without_worse(mesh: TriangleMesh, targets: Floats, moved: Floats) -> tuple[Floats, Floats]:
    """Undo a displacement where it hardly brings faces nearer to their target normals.

    Parameters
    ----------
    mesh : TriangleMesh
        The mesh before the displacement.
    targets : (m, 3) float64
        Target normals of its faces.
    moved : (n, 3) float64
        The displacement, in the unit of `mesh.vertices`.

    Returns
    -------
    moved : (n, 3) float64
        The displacement that is left.
    lost : (n,) float64
        How far each vertex went back, in mean edge lengths.
    """
    off = np.empty((mesh.face_count, 2))
    run(_measure, mesh.face_count, mesh.scaled_vertices, moved, mesh.faces, mesh.normals, targets,
        1.0 / mesh.mean_edge_length, off)  # fmt: skip
    off = smooth_vertices(mesh, average_to_vertices(mesh, off), _PASSES)
    back = ramp(off[:, 1] / (off[:, 0] + _DEGREE), _LEFT)
    if not back.any():
        return moved, back
    back = smooth_vertices(mesh, back.reshape(-1, 1), 2)
    lengths = np.linalg.norm(moved, axis=1) / mesh.mean_edge_length
    return moved * (1.0 - back), back[:, 0] * lengths


def tell_lost(mesh: TriangleMesh, lost: Floats) -> None:
    """Report in how many places the refit was undone, and what helps."""
    places = np.flatnonzero(lost > _REPORTED_MOVE)
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
    # The number of places that vertices form: those within about two edges belong to one place.
    if len(vertices) == 0:
        return 0
    chosen = np.zeros(mesh.vertex_count, dtype=np.bool_)
    chosen[vertices] = True
    start, ring = mesh.neighbours
    inside = within_rings((start, ring), chosen, 1)
    keep = inside[ring] & np.repeat(inside, np.diff(start))
    counts = np.add.reduceat(np.append(keep, False), start[:-1]) * (np.diff(start) > 0)
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    part, _ = connected_parts((starts, ring[keep]))
    return len(np.unique(part[inside]))


def without_drift(
    mesh: TriangleMesh, moved: Floats, fixed: npt.NDArray[np.bool_] | None = None
) -> Floats:
    """Undo drift: moves of the two sides of a thin wall, or of a narrow gap, towards each other.

    A refit only sees normals, so sheets whose borders turn may sink into each other. Drift is the
    mean move of the surroundings along the normal; a crease that closes causes none.

    Parameters
    ----------
    mesh : TriangleMesh
        The mesh before the displacement.
    moved : (n, 3) float64
        The displacement, in the unit of `mesh.vertices`.
    fixed : (n,) bool, optional
        Vertices whose displacement must not change.

    Returns
    -------
    (n, 3) float64
        The displacement; `moved` itself where nothing drifts.
    """
    normals = unit_vectors(mean_normals(mesh))
    along = np.einsum("vx,vx->v", moved, normals) / mesh.mean_edge_length
    drift = smooth_vertices(mesh, along.reshape(-1, 1), _PASSES)[:, 0]
    places = np.flatnonzero(np.abs(drift) > _DRIFT)
    if len(places) == 0:
        return moved
    toward = normals[places] * np.sign(drift[places])[:, None]
    between = _other_sides(mesh, normals, places, toward, _DISTANCE_RAMP[1])
    narrowed = 2.0 * np.abs(drift[places]) / np.maximum(between, 1e-12)
    share = np.zeros(mesh.vertex_count)
    share[places] = ramp(narrowed, _NARROWING_RAMP) * (1.0 - ramp(between, _DISTANCE_RAMP))
    share = smooth_vertices(mesh, share.reshape(-1, 1), 2)[:, 0]
    if fixed is not None:
        share[fixed] = 0.0
    return moved - (share * drift * mesh.mean_edge_length)[:, None] * normals


def _thickness(mesh: TriangleMesh, places: npt.NDArray[np.intp]) -> Floats:
    # The distance of vertices to the opposite side of the surface, behind or before them, in mean
    # edge lengths; at most _FAR.
    return _other_sides(mesh, mean_normals(mesh), places, None, _FAR)


def _other_sides(
    mesh: TriangleMesh, normals: Floats, places: npt.NDArray[np.intp], toward: Floats | None,
    far: float,
) -> Floats:  # fmt: skip
    # Distances along the normals to parts of the surface that face the other way, in mean edge
    # lengths; only in the directions `toward`, if given.
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
            if dot(way, way) - along * along < _LATERAL_SQUARE:
                least = min(least, abs(along))
        found[i] = least


@kernel
def _is_same(one, other):
    return one[0] == other[0] and one[1] == other[1] and one[2] == other[2]


@kernel
def _is_zero(vector):
    return vector[0] == 0 and vector[1] == 0 and vector[2] == 0


@kernel
def _measure(start, stop, vertices, moved, faces, before, targets, unit, off):
    # 1 - cos of the angle to the target normal, times twice the area in squared mean edge lengths:
    # before and after the displacement. Faces that keep normal and place have exactly 0.
    for f in range(start, stop):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        moves = not (_is_zero(moved[a]) and _is_zero(moved[b]) and _is_zero(moved[c]))
        if _is_same(before[f], targets[f]) and not moves:
            off[f, 0] = off[f, 1] = 0.0
            continue
        u, v = edge(vertices, a, b), edge(vertices, a, c)
        n = cross(u, v)
        off[f, 0] = np.sqrt(dot(n, n)) * (1.0 - dot(before[f], targets[f]))
        p, q = edge(moved, a, b), edge(moved, a, c)
        n = cross(
            (u[0] + unit * p[0], u[1] + unit * p[1], u[2] + unit * p[2]),
            (v[0] + unit * q[0], v[1] + unit * q[1], v[2] + unit * q[2]),
        )
        off[f, 1] = np.sqrt(dot(n, n)) - dot(n, targets[f])
