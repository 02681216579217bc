# SPDX-License-Identifier: GPL-3.0-or-later
"""Repairs the faces that a refit has folded: vertices slide, follow their neighbours, or go back.

Not in the papers. A face is bad if the refit has folded it, so that across an edge normals turn by
more than 140 degrees; if it has turned it over, nearly a right angle away from its target normal;
or if it has taken nearly all of its area. Faces that were so before are not bad. Faces that are
nearly bad are repaired in part, so that rounding never decides.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..base.progress import ask
from ..base.vectors import cross, dot
from ..mesh.adjacency import distinct, faces_around
from ..mesh.calculus import greatest_to_faces, greatest_to_vertices, nonzero_rows
from ..mesh.triangle_mesh import Floats, TriangleMesh

_FOLD, _CLEAR, _ALREADY = np.cos(np.radians((140.0, 149.9, 150.1)))
"""Cosines of angles between the normals of two faces at an edge: beyond the first, the edge is a
fold; beyond the second, where the input is nearly a fold or three faces or more meet; edges of the
input beyond the third were folds before."""

_SAME = 1e-9
"""Cosines that differ by less are equal."""

_WORSE = 0.02
"""Cosines may fall by this much where an edge was a fold before, or a face was turned over."""

_FLIPPED = 0.05
"""Cosine of the angle to its target below which a face is turned over."""

_RAMP_WIDTH = 0.1
"""Width of the ramp of cosines above these bounds in which a face is bad in part."""

_AREA_RAMP = 0.02, 0.1
"""Ramp of a face's area over that of the input: below the first value the face is bad and its
normal is not used, above the second it is neither; in between, both apply in part."""

_STIFF = (200.0,) * 6 + (20.0,) * 3
"""Stiffness that keeps sliding vertices in the planes of their faces, for each round."""

_SLIDES = 4
"""Slides in each round."""

_MOVE_RINGS, _MOVE_FACTOR = 2, 2.0
"""Limit of a sliding vertex's distance from its input position: the longest move within this number
of rings (first), times a factor (second). Small moves suffice to undo the folds of small moves."""

_AVERAGING_ROUNDS = 8
"""Rounds in which vertices take over the mean displacement of their neighbours."""

_RETREATS, _RETURNS, _RETREAT = 8, 32, 0.6
"""Rounds in which vertices of bad faces go back in part; rounds in which they go back fully and
their neighbours in part; and the factor of a displacement that goes back in part."""

_MOST_SHEETS = 8
"""Most faces at one edge that are compared pairwise."""

Indices = npt.NDArray[Any]


class FoldChecks:
    """Finds the bad faces of a displaced mesh: those that the displacement folds or turns over.

    Parameters
    ----------
    mesh : TriangleMesh
        The mesh before the displacement.
    targets : (m, 3) float64
        Target normals of its faces.
    """

    def __init__(self, mesh: TriangleMesh, targets: Floats) -> None:
        self.mesh, self.targets = mesh, targets
        self._thick = _pairs_at_thick_edges(mesh)

    def bad_faces(self, moved: Floats, among: Indices) -> Indices:
        """Return the bad ones among some faces, sorted."""
        return distinct(among[self.grades(moved, among) >= 1], self.mesh.face_count)

    def grades(self, moved: Floats, among: Indices) -> Floats:
        """Grade some faces, given sorted: 1 if bad, 0 if not, in between if nearly bad."""
        mesh = self.mesh
        found = np.empty(len(among))
        run(_grade, len(among), among, mesh.vertices, moved, mesh.faces, mesh.twins, mesh.normals,
            mesh.areas, mesh.mean_edge_length**-2, self.targets, found)  # fmt: skip
        one, two = self._thick
        if len(one):
            folded = np.empty(len(one), dtype=np.bool_)
            run(_find_folded, len(one), one, two, mesh.vertices, moved, mesh.faces, mesh.normals,
                folded)  # fmt: skip
            found[np.isin(among, np.concatenate([one[folded], two[folded]]))] = 1.0
        return found

    def graded_near(
        self, moved: Floats, faces: Indices, vertices: Indices
    ) -> tuple[Indices, Floats]:
        """Grade some faces together with those whose grades depend on some vertices.

        Returns the indices of all these faces, and their grades.
        """
        among = np.union1d(faces, self.faces_near(vertices))
        return among, self.grades(moved, among)

    def faces_near(self, vertices: Indices) -> Indices:
        """Return the faces whose grades depend on some vertices, sorted."""
        mesh = self.mesh
        around = mesh.faces[faces_around(mesh.corners, vertices)]
        return faces_around(mesh.corners, distinct(around, mesh.vertex_count))


def mended(
    mesh: TriangleMesh, targets: Floats, moved: Floats, fixed: npt.NDArray[np.bool_] | None
) -> Floats:
    """Change a displacement so that no face is folded or turned over.

    Parameters
    ----------
    mesh : TriangleMesh
        The mesh before the displacement.
    targets : (m, 3) float64
        Target normals of its faces.
    moved : (n, 3) float64
        The displacement, in the unit of `mesh.vertices`.
    fixed : (n,) bool or None
        Vertices that must not move.

    Returns
    -------
    (n, 3) float64
        The displacement, changed around bad faces.
    """
    checks = FoldChecks(mesh, targets)
    near = checks.faces_near(np.flatnonzero(nonzero_rows(moved)))
    grades = checks.grades(moved, near)
    if not grades.any():
        return moved
    moved = moved.copy()
    bad = _slide(checks, moved, near, grades, fixed)
    bad = _even_out(checks, moved, bad, fixed)
    return _without(checks, moved, bad)


def undone(mesh: TriangleMesh, targets: Floats, moved: Floats) -> Floats:
    """Undo a displacement, in place, around bad faces."""
    checks = FoldChecks(mesh, targets)
    near = checks.faces_near(np.flatnonzero(nonzero_rows(moved)))
    return _without(checks, moved, checks.bad_faces(moved, near))


def _slide(
    checks: FoldChecks,
    moved: Floats,
    among: Indices,
    grades: Floats,
    fixed: npt.NDArray[np.bool_] | None,
) -> Indices:
    # Slides the vertices of bad faces to the mean of their neighbours, along the planes of their
    # faces, weighted by the grade. Borders would shrink and stay. Returns the faces still bad.
    mesh = checks.mesh
    still = np.zeros(mesh.vertex_count, dtype=np.bool_) if fixed is None else fixed.copy()
    still[_border(mesh)] = True
    most = np.linalg.norm(moved, axis=1)
    for _ in range(_MOVE_RINGS):
        most = greatest_to_vertices(mesh, greatest_to_faces(mesh, most))
    most *= _MOVE_FACTOR
    for stiff in _STIFF:
        # Rounds of low stiffness move vertices off creases, so they are for fully bad faces only.
        counted = grades if stiff == _STIFF[0] else np.floor(grades)
        if not counted.any():
            break
        ask()
        chosen, shares = _ends(mesh, among, counted, still)
        slides = np.empty((len(chosen), 3))
        for _ in range(_SLIDES):
            run(_find_slides, len(chosen), chosen, mesh.vertices, moved, mesh.faces, *mesh.corners,
                mesh.areas, checks.targets, stiff, slides)  # fmt: skip
            moved[chosen] += shares * slides
            _shorten(moved, chosen, most)
        among, grades = checks.graded_near(moved, among[grades > 0], chosen)
    return among[grades >= 1]


def _shorten(moved: Floats, chosen: Indices, most: Floats) -> None:
    lengths = np.linalg.norm(moved[chosen], axis=1)
    far = lengths > most[chosen]
    moved[chosen[far]] *= (most[chosen] / np.maximum(lengths, 1e-300))[far, None]


def _even_out(
    checks: FoldChecks, moved: Floats, bad: Indices, fixed: npt.NDArray[np.bool_] | None
) -> Indices:
    # Averages displacements with those of neighbours, which keeps the input's shape.
    mesh = checks.mesh
    among, grades = bad, np.ones(len(bad))
    for _ in range(_AVERAGING_ROUNDS):
        if not (grades >= 1).any():
            break
        ask()
        chosen, shares = _ends(mesh, among, grades, fixed)
        means = np.empty((len(chosen), 3))
        run(_average_moves, len(chosen), chosen, *mesh.neighbours, moved, means)
        moved[chosen] += shares * (means - moved[chosen])
        among, grades = checks.graded_near(moved, among[grades > 0], chosen)
    return among[grades >= 1]


def _without(checks: FoldChecks, moved: Floats, bad: Indices) -> Floats:
    # Vertices of bad faces go back, at first in part, then fully, with more and more around them.
    mesh = checks.mesh
    start, ring = mesh.neighbours
    among, grades = bad, np.ones(len(bad))
    for turn in range(_RETREATS + _RETURNS):
        if not (grades >= 1).any():
            break
        ask()
        if turn < _RETREATS:
            chosen, shares = _ends(mesh, among, grades)
            moved[chosen] *= 1.0 - (1.0 - _RETREAT) * shares
        else:
            chosen = np.unique(mesh.faces[among[grades >= 1]])
            moved[chosen] = 0.0
            chosen = np.unique(np.concatenate([ring[start[v] : start[v + 1]] for v in chosen]))
            moved[chosen] *= _RETREAT
        among, grades = checks.graded_near(moved, among[grades > 0], chosen)
    return moved


def _ends(
    mesh: TriangleMesh,
    faces: Indices,
    grades: Floats,
    fixed: npt.NDArray[np.bool_] | None = None,
) -> tuple[Indices, Floats]:
    # The vertices of graded faces, except fixed ones, and the worst grade at each: (k,), (k, 1).
    worst = np.zeros(mesh.vertex_count)
    np.maximum.at(worst, mesh.faces[faces], grades[:, None])
    if fixed is not None:
        worst[fixed] = 0.0
    vertices = np.flatnonzero(worst)
    return vertices, worst[vertices, None]


def _border(mesh: TriangleMesh) -> Indices:
    # The ends of border edges, which have one face.
    face, k = np.nonzero(mesh.twins < 0)
    ends = np.sort(np.stack([mesh.faces[face, k], mesh.faces[face, (k + 1) % 3]], axis=1))
    edges, counts = np.unique(ends, axis=0, return_counts=True)
    return edges[counts == 1]


def _pairs_at_thick_edges(mesh: TriangleMesh) -> tuple[Indices, Indices]:
    # Pairs of faces at edges of three or more faces, whose half-edges have no twins.
    alone = np.flatnonzero(mesh.twins.reshape(-1) < 0)
    faces = np.unique(alone // 3)
    ends = np.sort(np.concatenate([mesh.faces[faces][:, k] for k in ([0, 1], [1, 2], [2, 0])]), 1)
    key = ends[:, 0].astype(np.int64) * mesh.vertex_count + ends[:, 1]
    order = np.argsort(key, kind="stable")
    key, faces = key[order], np.tile(faces, 3)[order]
    ones, twos = [], []
    for apart in range(1, _MOST_SHEETS):
        same = np.flatnonzero(key[apart:] == key[:-apart])
        if len(same) == 0:
            break
        ones.append(faces[same])
        twos.append(faces[same + apart])
    if not ones:
        return faces[:0], faces[:0]
    return np.concatenate(ones), np.concatenate(twos)


@kernel
def _normal(vertices, moved, faces, f):
    return _normal_and_area(vertices, moved, faces, f)[0]


@kernel
def _normal_and_area(vertices, moved, faces, f):
    a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
    ux = vertices[b, 0] - vertices[a, 0] + (moved[b, 0] - moved[a, 0])
    uy = vertices[b, 1] - vertices[a, 1] + (moved[b, 1] - moved[a, 1])
    uz = vertices[b, 2] - vertices[a, 2] + (moved[b, 2] - moved[a, 2])
    vx = vertices[c, 0] - vertices[a, 0] + (moved[c, 0] - moved[a, 0])
    vy = vertices[c, 1] - vertices[a, 1] + (moved[c, 1] - moved[a, 1])
    vz = vertices[c, 2] - vertices[a, 2] + (moved[c, 2] - moved[a, 2])
    large = max(abs(ux), abs(uy), abs(uz), abs(vx), abs(vy), abs(vz))
    if not large > 0:
        return (0.0, 0.0, 0.0), 0.0
    s = 1.0 / large  # so that products neither overflow nor underflow
    x, y, z = cross((s * ux, s * uy, s * uz), (s * vx, s * vy, s * vz))
    length = np.sqrt(x * x + y * y + z * z)
    if length > 0:
        return (x / length, y / length, z / length), 0.5 * length * large**2
    return (0.0, 0.0, 0.0), 0.0


@kernel
def _grade(start, stop, among, vertices, moved, faces, twins, before, areas, unit, targets, grades):
    for i in range(start, stop):
        f = among[i]
        n, area = _normal_and_area(vertices, moved, faces, f)
        gone = _gone(unit * area, areas[f])
        on = dot(before[f], targets[f])
        grades[i] = gone
        if area > 0:
            least = min(_FLIPPED, on - _WORSE)
            grades[i] = max(grades[i], _graded(dot(n, targets[f]), least, on))
        for k in range(3):
            if twins[f, k] < 0:
                continue
            g = twins[f, k] // 3
            bent = dot(before[f], before[g])
            least = bent - _WORSE
            if bent > _ALREADY:
                least = min(max(min(_FOLD, least), _CLEAR), bent - _SAME)
            m, area = _normal_and_area(vertices, moved, faces, g)
            most = max(gone, _gone(unit * area, areas[g]))
            grade = (1.0 - most) * _graded(dot(n, m), least, bent)
            # At a fold, mainly the face that has lost more of its area is bad.
            grades[i] = max(grades[i], grade + max(2.0 * gone - most, 0.0))


@kernel
def _gone(area, before):
    # 1 where a face has nearly no area left, so that a little more noise would turn it over.
    if before <= 0:
        return 0.0
    return min(max((_AREA_RAMP[1] - area / before) / (_AREA_RAMP[1] - _AREA_RAMP[0]), 0.0), 1.0)


@kernel
def _graded(cosine, least, before):
    # 1 below the least cosine; 0 well above it, and where the cosine has not fallen.
    return min(max(1.0 - (cosine - least) / min(_RAMP_WIDTH, before - least), 0.0), 1.0)


@kernel
def _find_folded(start, stop, one, two, vertices, moved, faces, before, folded):
    # Where sheets touch, it is unclear which faces are neighbours, so only clear folds count.
    for i in range(start, stop):
        n = _normal(vertices, moved, faces, one[i])
        m = _normal(vertices, moved, faces, two[i])
        bent = dot(before[one[i]], before[two[i]])
        folded[i] = bent > _ALREADY and dot(n, m) < min(_CLEAR, bent - _SAME)


@kernel
def _find_slides(
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
    stiff,
    slides,
):
    # Half of the way to the mean of the neighbours, along the planes of the faces: solves
    # (1 + stiff * mean of N N^T) slide = way / 2.
    for j in range(start, stop):
        v = chosen[j]
        mx = my = mz = count = total = 0.0
        xx = xy = xz = yy = yz = zz = 0.0
        for i in range(corner_start[v], corner_start[v + 1]):
            f = corners[i] // 3
            for k in range(3):
                o = faces[f, k]
                if o != v:
                    mx += vertices[o, 0] - vertices[v, 0] + moved[o, 0]
                    my += vertices[o, 1] - vertices[v, 1] + moved[o, 1]
                    mz += vertices[o, 2] - vertices[v, 2] + moved[o, 2]
                    count += 1.0
            n, a = normals[f], areas[f]
            total += a
            xx += a * n[0] * n[0]
            xy += a * n[0] * n[1]
            xz += a * n[0] * n[2]
            yy += a * n[1] * n[1]
            yz += a * n[1] * n[2]
            zz += a * n[2] * n[2]
        count = max(count, 1.0)
        dx, dy, dz = mx / count - moved[v, 0], my / count - moved[v, 1], mz / count - moved[v, 2]
        s = stiff / max(total, 1e-12)
        xx, yy, zz = 1.0 + s * xx, 1.0 + s * yy, 1.0 + s * zz
        xy, xz, yz = s * xy, s * xz, s * yz
        p, q, r = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
        t = 0.5 / (xx * p + xy * q + xz * r)
        slides[j, 0] = t * (p * dx + q * dy + r * dz)
        slides[j, 1] = t * (q * dx + (xx * zz - xz * xz) * dy + (xy * xz - xx * yz) * dz)
        slides[j, 2] = t * (r * dx + (xy * xz - xx * yz) * dy + (xx * yy - xy * xy) * dz)


@kernel
def _average_moves(start, stop, chosen, ring_start, ring, moved, means):
    for j in range(start, stop):
        v = chosen[j]
        first, last = ring_start[v], ring_start[v + 1]
        for x in range(3):
            total = 0.0
            for i in range(first, last):
                total += moved[ring[i], x]
            means[j, x] = 0.5 * moved[v, x]
            if last > first:
                means[j, x] += 0.5 * total / (last - first)
