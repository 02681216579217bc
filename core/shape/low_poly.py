# SPDX-License-Identifier: GPL-3.0-or-later
"""Crisp low poly: simplifies a fine remesh of a part to few triangles, and keeps its creases.

Edges collapse in the order of their cost, to the point of least quadric error (Garland and
Heckbert: Surface Simplification Using Quadric Error Metrics, SIGGRAPH 1997). Not in the papers:
each face keeps samples, the vertices and face normals of the sharpened mesh that it represents. An
edge does not collapse if that would leave a sample too far from the surface, turn the surface too
much from the normals of the samples, or make a face that spans a gap.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base.checks import Floats, by_keyword, checked_angle, checked_number
from ..base.parallel import kernel, run
from ..base.progress import ProgressCallback, ask, phase, reporting
from ..base.vectors import after, cross, dot, edge
from ..mesh.edges import checked_edges, half_edges_between
from ..mesh.triangle_mesh import TriangleMesh, check_mesh
from ..settings import GeometrySettings, given_or_default
from ..sparse.components import connected_components
from .crease_edges import Bools
from .noise import possible_noise
from .sharpening import sharpen_geometry

Ints = npt.NDArray[np.int32]

_TURN_AREA = 1.5
"""A collapse may add at most this much to the sum of areas times squared turns: a change of the
surface by `turn` over this area, in squared mean edge lengths."""

_TURN_CAP = 0.08
"""Squared turn, in radians squared, that no normal exceeds in that sum. Normals off by more are
wrong in the sharpened mesh, such as those of faces across a crease."""

_CREASE_WEIGHT = 0.1
"""Weight of the normals of faces at creases, which are the least reliable."""

_SMALL_AREA = 1.2
"""Area between creases, in squared mean edge lengths, at which the planes of its faces have a
quarter of their weight; in larger areas they have more."""

_CREASE_FACTOR = 2.0
"""Factor of the tolerance at vertices along creases, because a remesh cuts corners."""

_SMOOTHING = 12
"""Smoothing passes over the normals of the samples."""

_TURN_WEIGHT = 1.0
"""Squared distance, in mean edge lengths, that counts as much as a turn by 90 degrees when the new
face of a sample is chosen."""

_SIMILAR = 0.01
"""1 - cos of the turn below which a sample takes a face without further search, if it projects
into it."""

_LEAST_COSINE = 0.5
"""Least cosine between a new face and the mean normal of its samples."""

_LEAST_SHAPE = 2e-3
"""Least ratio of a new face's height to its longest edge, unless its ratio was smaller before."""

_MOST_MOVE = 2.0
"""The farthest that a vertex moves, in mean edge lengths."""

_LARGE_AREA, _COVER_FACTOR = 2.0, 1.5
"""A new face of more than this area, in squared edge lengths, is checked not to span a gap: points
on it may be as far from the surface as vertices along creases may, times the factor."""

_HOLD = 1e-3
"""Weight, relative to the trace of a quadric, of a term that holds the new vertex in directions
that no plane determines."""

_LENGTH_COST = 1e-6
"""Cost per squared edge length, so that among equal edges the shortest collapse first."""


@dataclass(frozen=True)
class LowPoly:
    """A mesh of few triangles, with references to the mesh it was made from, the source.

    Attributes
    ----------
    vertices : (k, 3) float64
        Positions, in the unit of the source.
    faces : (j, 3) int32
        Triangles, wound as those of the source.
    vertex_source : (k,) int
        For each vertex, its vertex in the source.
    face_source : (j,) int
        For each face, a face of the source on the same side of all kept edges, and between the
        same creases.
    corner_source : (j, 3) int
        For each corner, a corner of the source, as 3 * face + number: on the same side of all kept
        edges, so that its UVs fit, and between the same creases.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> square = core.TriangleMesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]],
    ...                            [[0, 1, 2], [0, 2, 3]])
    >>> core.crisp_low_poly(square).faces.shape
    (2, 3)
    """

    vertices: Floats
    faces: Ints
    vertex_source: npt.NDArray[np.intp]
    face_source: npt.NDArray[np.intp]
    corner_source: npt.NDArray[np.intp]


@by_keyword
def crisp_low_poly(
    mesh: TriangleMesh,
    settings: GeometrySettings | None = None,
    *,
    tolerance: float = 0.25,
    turn: float = 8.0,
    angle: float = 15.0,
    keep: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> LowPoly:
    """Sharpen a remeshed part, then dissolve faces on its flat or smoothly curved areas.

    Parameters
    ----------
    mesh : TriangleMesh
        A voxel remesh, a scan, or a mesh that is sharpened already.
    settings : GeometrySettings, optional
        Settings of the sharpening; an amount of 0 leaves it out.
    tolerance : float
        The farthest that vertices of the sharpened mesh may lie from the new faces, in mean edge
        lengths, above 0 and up to 10; twice as far along creases, whose corners a remesh cuts. In
        components of some dozens of faces, and where faces in one plane have edges of many
        lengths, as in exports of design programs, the unit is the shortest edge at each vertex, if
        that is less. In turn, points on large new faces lie within three times as far from the
        sharpened mesh, so that no face spans a gap.
    turn : float
        How far a collapse may turn the surface away from the sharpened mesh, in degrees, from 0.1
        to 60, over an area of a few faces; over larger areas less. Smaller values keep more faces
        on round parts.
    angle : float
        Least angle of edges of the sharpened mesh across which normals are not smoothed, in
        degrees, from 5 to 170.
    keep : (k, 2) array of int, optional
        Edges that stay, as pairs of vertices, such as UV seams and borders of materials. Pairs
        that are no edge are ignored.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    LowPoly
        It is closed if the mesh is, and has no T-junctions. Sheets that touch, with four faces at
        an edge or several fans at a vertex, are separated.

    Raises
    ------
    InvalidSettings
        If tolerance, turn or angle are out of range.
    InvalidSignal
        If edges to keep are not pairs of vertices.
    SolverError, InvalidMesh
        As in `sharpen_geometry`.
    Cancelled
        If `progress` returned False.

    Notes
    -----
    Creases stay because faces must not turn, so they need not be found. The ends and forks of kept
    edges and of borders stay in place.

    Examples
    --------
    A sheet of 128 triangles that is folded once becomes four:

    >>> import numpy as np
    >>> from shock_filter import core
    >>> x, y = np.divmod(np.arange(81.0), 9)
    >>> a = np.flatnonzero((x < 8) & (y < 8))
    >>> faces = np.stack([[a, a + 9, a + 1], [a + 1, a + 9, a + 10]]).swapaxes(1, 2)
    >>> faces = faces.reshape(-1, 3)
    >>> sheet = core.TriangleMesh(np.stack([x, y, -abs(x - 4)], axis=1), faces)
    >>> low = core.crisp_low_poly(sheet)
    >>> low.vertices.shape, low.faces.shape
    ((6, 3), (4, 3))
    """
    check_mesh(mesh)
    settings = given_or_default(settings, GeometrySettings)
    tolerance = checked_number(tolerance, "tolerance", 10.0)
    turn = checked_angle(turn, "turn", 0.1, 60.0)
    angle = checked_angle(angle, "angle", 5.0, 170.0)
    kept = None if keep is None else checked_edges(mesh, keep)
    with reporting(progress):
        with phase(0.0, 0.7, "Sharpening"):
            whole, origins = _parted(mesh)
            sharp = whole.moved_to(sharpen_geometry(whole, settings))
        held = whole.twins < 0
        if kept is not None:
            held |= half_edges_between(mesh, kept)[0]
        with phase(0.7, 1.0, "Dissolving faces"):
            vertices, faces, corners, moved = _dissolved(
                sharp, held, angle, _allowed(whole, tolerance), np.radians(turn)
            )
    turned = mesh.flipped[faces]
    for each in (vertices, corners):
        each[turned] = each[turned][:, (0, 2, 1)]
    face, k = np.divmod(corners, 3)
    k = np.where(mesh.flipped[face] & (k > 0), 3 - k, k)
    used, given = np.unique(vertices, return_inverse=True)
    given = given.reshape(-1, 3).astype(np.int32)
    return LowPoly(moved[used], given, origins[used], faces, 3 * face + k)


def _lines_at(faces: Ints, held: Bools, count: int) -> Ints:
    # How many held edges meet at each vertex; an edge of three or more faces counts as 9.
    begin = faces.astype(np.int64)  # numpy 1 would multiply with 32 bits
    end = begin[:, (1, 2, 0)]
    keys = np.minimum(begin, end) * count + np.maximum(begin, end)
    keys, counts = np.unique(keys[held], return_counts=True)
    ends = np.concatenate(np.divmod(keys, count))
    return np.bincount(ends, np.tile(np.where(counts > 2, 9, 1), 2), count).astype(np.int32)


def _sectors(twins: Ints, held: Bools) -> npt.NDArray[np.int64]:
    # Labels corners at the same vertex between the same held edges by the first of them.
    here = np.flatnonzero((twins >= 0) & ~held)
    face, k = np.divmod(twins.reshape(-1)[here], 3)
    there = 3 * face + (k + 1) % 3
    _, labels = connected_components(twins.size, here, there)
    _, firsts = np.unique(labels, return_index=True)
    return firsts[labels].reshape(-1, 3)


def _parted(mesh: TriangleMesh) -> tuple[TriangleMesh, npt.NDArray[np.intp]]:
    # Separates sheets that touch at edges and vertices, as remeshers leave them where a part is
    # thin. Returns the new mesh, and for each of its vertices the one it comes from. Of four faces
    # at an edge, those pairs form sheets that bend less.
    faces, twins = mesh.faces, mesh.twins.copy()
    loose = np.flatnonzero(twins < 0)
    face, k = np.divmod(loose, 3)
    a, b = faces[face, k].astype(np.int64), faces[face, (k + 1) % 3]
    keys = np.minimum(a, b) * mesh.vertex_count + np.maximum(a, b)
    order = np.lexsort((a < b, keys))
    _, starts, counts = np.unique(keys[order], return_index=True, return_counts=True)
    rows = order[starts[counts == 4][:, None] + np.arange(4)]
    four = loose[rows[(a < b)[rows].sum(axis=1) == 2]]
    n, tips = mesh.normals[four // 3], mesh.scaled_vertices[faces[four // 3, (four + 2) % 3]]
    # If both ways bend alike, ridges are preferred to grooves.
    flat = [
        np.einsum("gkx,gkx->g", n[:, :2], n[:, way] - 1e-3 * (tips[:, way] - tips[:, :2]))
        for way in ((2, 3), (3, 2))
    ]
    here, there = four[:, :2], np.where((flat[0] > flat[1])[:, None], four[:, 2:], four[:, :1:-1])
    twins.reshape(-1)[here], twins.reshape(-1)[there] = there, here
    fans = _sectors(twins, np.zeros_like(twins, dtype=bool))
    # Sheets that touch at border vertices stay together.
    firsts, closed = np.zeros(mesh.vertex_count, np.int64), np.ones(mesh.vertex_count, dtype=bool)
    firsts[faces] = fans
    for ends in (faces, faces[:, (1, 2, 0)]):
        closed[ends[twins < 0]] = False
    fans = np.where(closed[faces], fans, firsts[faces])
    corners, parted = np.unique(fans, return_inverse=True)
    origins = faces.reshape(-1)[corners]
    return TriangleMesh(mesh.vertices[origins], parted.reshape(-1, 3)), origins


def _chains(keys: npt.NDArray[Any], count: int) -> tuple[Ints, Ints]:
    # Linked lists of the items of each key: the first item, and the one after each; -1 at the end.
    first, following = np.full(count, -1, dtype=np.int32), np.full(len(keys), -1, dtype=np.int32)
    order = np.argsort(keys, kind="stable").astype(np.int32)
    same = np.diff(keys[order]) == 0
    following[order[:-1][same]] = order[1:][same]
    first[keys[order[::-1]]] = order[::-1]
    return first, following


def _dissolved(
    mesh: TriangleMesh, held: Bools, angle: float, allowed: tuple[Floats, Floats], turn: float
) -> tuple[Ints, npt.NDArray[np.intp], npt.NDArray[np.int64], Floats]:
    # Returns the vertices of the faces that are left, their indices, a source corner for each of
    # their corners, and the positions of the vertices. `allowed` is the tolerance of each vertex
    # away from creases, and along them.
    sharp = _bends(mesh, angle)
    normals = _smooth_normals(mesh, held | sharp)
    count, faces, home = mesh.vertex_count, mesh.faces.copy(), mesh.scaled_vertices
    points = home.copy()
    near = np.zeros(count, dtype=bool)
    near[faces[sharp]] = near[faces[:, (1, 2, 0)][sharp]] = True
    areas = np.where(near[faces].any(axis=1), _CREASE_WEIGHT, 1.0) * mesh.areas
    off = np.minimum(2.0 - 2.0 * (normals * mesh.normals).sum(axis=1), _TURN_CAP)
    first, following = _chains(faces.reshape(-1), count)
    # The samples: vertices, which have positions only, and the centres of faces.
    samples = np.concatenate([points, points[faces].mean(axis=1)])
    lists = _chains(np.concatenate([first // 3, np.arange(mesh.face_count)]), mesh.face_count)
    wanted = np.concatenate([np.zeros((count, 3)), normals])
    weights = np.concatenate([np.zeros(count), areas])
    away, along = allowed
    most = np.concatenate([np.where(near, along, away), away[faces].min(axis=1)]) ** 2
    triangles = points[faces]
    # No point of a face is farther from its middle than its farthest corner.
    radii = np.linalg.norm(triangles - samples[count:, None], axis=2).max(axis=1)
    near_enough = _COVER_FACTOR * along[faces].max(axis=1)
    reach = np.column_stack([radii + near_enough, near_enough]) ** 2
    sums = np.column_stack([normals, off]) * areas[:, None]
    quadrics = np.zeros((count, 4, 4))
    _add_planes(points, faces, normals, areas * _share(mesh, held | sharp), held, quadrics)
    # The sector of each corner between held edges in the high bits, between creases too in the low.
    sources = _sectors(mesh.twins, held) << 32 | _sectors(mesh.twins, held | sharp)
    alive = np.ones(mesh.face_count, dtype=bool)
    state = (points, home, faces, first, following, alive, held, _lines_at(faces, held, count),
             sources, quadrics, samples, wanted, weights, most, triangles, mesh.normals, reach,
             *lists, sums)  # fmt: skip
    changed, seen = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
    tried = np.full(faces.size, -1)
    found = np.empty((len(samples), 2), dtype=np.int32)
    left, done = mesh.face_count, 1
    while done:
        done = _collapse(*state, changed, tried, seen, found, max(left // 8, 64),
                         _TURN_AREA * turn**2)  # fmt: skip
        left -= 2 * done
        ask(1.0 - left / mesh.face_count)
    kept = np.flatnonzero(alive)
    moved = mesh.vertices + mesh.mean_edge_length * (points - home)
    return faces[kept], kept, sources[kept] & 0xFFFFFFFF, moved


def _allowed(mesh: TriangleMesh, tolerance: float) -> tuple[Floats, Floats]:
    # The tolerance of each vertex, away from creases and along them. The mean edge length is no
    # measure where design programs put short edges beside long ones: a quarter of it may be thicker
    # than the part. There the shortest edge at the vertex is the unit, if that is less, and
    # tolerances along creases are the same, because no remesh has cut corners.
    ends = mesh.faces, mesh.faces[:, (1, 2, 0)]
    lengths = np.linalg.norm(mesh.scaled_vertices[ends[0]] - mesh.scaled_vertices[ends[1]], axis=2)
    shortest, remeshed = np.ones(mesh.vertex_count), np.ones(mesh.vertex_count)
    for each in ends:
        np.minimum.at(shortest, each, lengths)
    np.minimum.at(remeshed, mesh.faces, possible_noise(mesh, remeshed=True)[:, None])
    away = tolerance * shortest ** (1.0 - remeshed)
    return away, away * (1.0 + (_CREASE_FACTOR - 1.0) * remeshed)


def _share(mesh: TriangleMesh, held: Bools) -> Floats:
    # Weights of the planes of faces: small in small areas between lines.
    here = np.flatnonzero((mesh.twins >= 0) & ~held)
    there = mesh.twins.reshape(-1)[here] // 3
    count, labels = connected_components(mesh.face_count, here // 3, there)
    areas = np.bincount(labels, mesh.areas, count)
    shares: Floats = areas / (areas + _SMALL_AREA)
    return shares[labels] ** 2


def _bends(mesh: TriangleMesh, degrees: float) -> Bools:
    # Half-edges across which normals differ by more than an angle.
    other = np.where(mesh.twins >= 0, mesh.twins // 3, np.arange(mesh.face_count)[:, None])
    cosines = np.einsum("fx,fkx->fk", mesh.normals, mesh.normals[other])
    return cosines < np.cos(np.radians(degrees))


def _smooth_normals(mesh: TriangleMesh, held: Bools) -> Floats:
    # Averages the normal of each face with those across edges that are not held.
    normals = mesh.normals * mesh.areas[:, None]
    for _ in range(_SMOOTHING):
        smoother = np.empty_like(normals)
        run(_average, mesh.face_count, mesh.twins, held, normals, smoother)
        normals = smoother
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 1e-12)


@kernel
def _average(start, stop, twins, held, normals, smoother):
    for f in range(start, stop):
        for x in range(3):
            smoother[f, x] = normals[f, x]
        for k in range(3):
            if twins[f, k] >= 0 and not held[f, k]:
                for x in range(3):
                    smoother[f, x] += normals[twins[f, k] // 3, x]


@kernel
def _add_plane(q, n, place, weight):
    plane = n[0], n[1], n[2], -dot(n, place)
    for x in range(4):
        for y in range(4):
            q[x, y] += weight * plane[x] * plane[y]


@kernel
def _add_planes(points, faces, normals, areas, held, quadrics):
    # Adds to each vertex the planes of its faces, and, through held edges, planes perpendicular to
    # their faces.
    for f in range(len(faces)):
        n = normals[f, 0], normals[f, 1], normals[f, 2]
        middle = (points[faces[f, 0]] + points[faces[f, 1]] + points[faces[f, 2]]) / 3.0
        for k in range(3):
            _add_plane(quadrics[faces[f, k]], n, middle, areas[f] / 3.0)
            if held[f, k]:
                a, b = faces[f, k], faces[f, after(k)]
                m = cross(edge(points, a, b), n)
                length = np.sqrt(dot(m, m))
                if length > 1e-12:
                    m = m[0] / length, m[1] / length, m[2] / length
                    for v in (a, b):
                        _add_plane(quadrics[v], m, points[a], 0.5 * length)


@kernel
def _value(q, p):
    # The sum of squared distances to the planes of a quadric.
    total, place = 0.0, (p[0], p[1], p[2], 1.0)
    for x in range(4):
        for y in range(4):
            total += q[x, y] * place[x] * place[y]
    return total


@kernel
def _least(q, p):
    # The point of least quadric error; in directions that no plane determines it stays at p.
    hold = _HOLD * (q[0, 0] + q[1, 1] + q[2, 2])
    x, y, z = (
        (q[0, 0] + hold, q[0, 1], q[0, 2]),
        (q[1, 0], q[1, 1] + hold, q[1, 2]),
        (q[2, 0], q[2, 1], q[2, 2] + hold),
    )
    r = dot(q[0], p) + q[0, 3], dot(q[1], p) + q[1, 3], dot(q[2], p) + q[2, 3]
    yz = cross(y, z)
    whole = dot(x, yz)
    if not whole > 1e-12 * x[0] * y[1] * z[2]:
        return p
    return (
        p[0] - dot(r, yz) / whole,
        p[1] - dot(r, cross(z, x)) / whole,
        p[2] - dot(r, cross(x, y)) / whole,
    )


@kernel
def _distance2(p, triangle, n, height):
    # The squared distance of a point at some height above the plane of a triangle.
    least, inside = np.inf, True
    for k in range(3):
        e = edge(triangle, k, after(k))
        w = p[0] - triangle[k, 0], p[1] - triangle[k, 1], p[2] - triangle[k, 2]
        inside &= dot(cross(e, w), n) >= 0.0
        t = min(max(dot(e, w) / max(dot(e, e), 1e-30), 0.0), 1.0)
        x, y, z = w[0] - t * e[0], w[1] - t * e[1], w[2] - t * e[2]
        least = min(least, x * x + y * y + z * z)
    return height * height if inside else least


@kernel
def _merger(f, k, points, home, faces, held, lines, quadrics, q):
    # For the edge (f, k): the vertex that vanishes, the one that it is merged with, the new
    # position of that, and the cost. -1 if the edge must not collapse.
    u, v = faces[f, k], faces[f, after(k)]
    u_goes = lines[u] == 0 or (lines[u] == 2 and held[f, k])
    v_goes = lines[v] == 0 or (lines[v] == 2 and held[f, k])
    q[:] = quadrics[u] + quadrics[v]
    a, b = (points[u, 0], points[u, 1], points[u, 2]), (points[v, 0], points[v, 1], points[v, 2])
    if v_goes and (not u_goes or _value(q, a) < _value(q, b)):
        u, v, a, b = v, u, b, a
        u_goes, v_goes = v_goes, u_goes
    if not u_goes:
        return -1, -1, b, np.inf
    p = b
    if v_goes:
        p = _least(q, b)
        e = p[0] - home[u, 0], p[1] - home[u, 1], p[2] - home[u, 2]
        d = p[0] - home[v, 0], p[1] - home[v, 1], p[2] - home[v, 2]
        if dot(d, d) > _MOST_MOVE * _MOST_MOVE:
            if dot(e, e) > _MOST_MOVE * _MOST_MOVE:
                p = b
            else:
                u, v, a, b = v, u, b, a
    e = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return u, v, p, max(_value(q, p), 0.0) + _LENGTH_COST * dot(e, e)


@kernel
def _is_linked(u, v, faces, first, following, seen, tick):
    # The link condition: u may be merged with v if their only common neighbours are the tips of the
    # faces at their edge. Otherwise two sheets would touch.
    dying, of_u, of_v, common = 0, 0, 0, 0
    c = first[u]
    while c >= 0:
        f, k = c // 3, c % 3
        a, b = faces[f, after(k)], faces[f, after(after(k))]
        seen[a] = seen[b] = tick
        dying += a == v or b == v
        of_u += 1
        c = following[c]
    seen[v] = 0
    c = first[v]
    while c >= 0:
        f, k = c // 3, c % 3
        for w in (faces[f, after(k)], faces[f, after(after(k))]):
            if seen[w] == tick:
                common += 1
                seen[w] = 0
        of_v += 1
        c = following[c]
    # A tetrahedron must not collapse.
    return common == dying <= 2 and not (dying == 2 and of_u == 3 and of_v == 3)


@kernel
def _drop_dead(v, first, following, alive):
    # Removes the corners of vanished faces from the list of a vertex.
    before, c = -1, first[v]
    while c >= 0:
        if alive[c // 3]:
            before = c
        elif before < 0:
            first[v] = following[c]
        else:
            following[before] = following[c]
        c = following[c]


@kernel
def _along(n, wanted):
    # The cosine of the angle between a unit vector and another vector, 1 if that is zero.
    length = np.sqrt(wanted[0] ** 2 + wanted[1] ** 2 + wanted[2] ** 2)
    return (n[0] * wanted[0] + n[1] * wanted[1] + n[2] * wanted[2]) / length if length > 0 else 1.0


@kernel
def _shape(a, b, c):
    # The unit normal of a triangle, its height over its longest edge, and twice its area.
    x = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    y = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    z = y[0] - x[0], y[1] - x[1], y[2] - x[2]
    n = cross(x, y)
    double = max(np.sqrt(dot(n, n)), 1e-30)
    longest = max(dot(x, x), dot(y, y), dot(z, z), 1e-30)
    return (n[0] / double, n[1] / double, n[2] / double), double / longest, double


@kernel
def _fan(u, v, p, points, faces, sums, first, following, fan, corners, new):
    # Lists the faces around an edge that collapses to p, vanishing ones last, with their new
    # corners and normals. Returns how many stay and how many there are in all; -1 if some would
    # turn over or become needles.
    size, gone = 0, 0
    for w in (u, v):
        c = first[w]
        while c >= 0:
            f, k = c // 3, c % 3
            a, b = faces[f, after(k)], faces[f, after(after(k))]
            if a != u and a != v and b != u and b != v:
                if size + 2 > len(fan):
                    return -1, -1
                n, shape, area = _shape(p, points[a], points[b])
                old_n, old_shape, old_area = _shape(points[w], points[a], points[b])
                if shape < _LEAST_SHAPE and shape <= old_shape:
                    return -1, -1
                turned = _along(n, sums[f])
                if turned < _LEAST_COSINE and (turned < _along(old_n, sums[f]) or area > old_area):
                    return -1, -1
                fan[size] = f
                for x in range(3):
                    corners[size, 0, x], corners[size, 1, x] = p[x], points[a, x]
                    corners[size, 2, x], new[size, x] = points[b, x], n[x]
                size += 1
            c = following[c]
    c = first[u]
    while c >= 0:
        f, k = c // 3, c % 3
        if faces[f, after(k)] == v or faces[f, after(after(k))] == v:
            fan[size + gone] = f
            gone += 1
        c = following[c]
    return size, size + gone


@kernel
def _hand_on(fan, size, whole, corners, new, samples, wanted, areas, most, first_sample,
             next_sample, found, sums, tally):  # fmt: skip
    # Finds a new face for each sample of the old ones; returns how many samples there are, -1 if
    # one is too far from all faces.
    heights = np.empty(size)
    for i in range(size):
        heights[i] = dot(new[i], corners[i, 0])
        # A face that gets no sample keeps the direction of its old normal.
        n = sums[fan[i]]
        length = np.sqrt(n[0] ** 2 + n[1] ** 2 + n[2] ** 2)
        for x in range(3):
            tally[i, x] = 1e-6 * n[x] / max(length, 1e-30)
        tally[i, 3] = 0.0
    count = 0
    for j in range(whole):
        s = first_sample[fan[j]]
        while s >= 0:
            best, least, near = -1, np.inf, areas[s] > 0.0
            for step in range(size):
                i = (j + step) % size
                n = new[i]
                d = dot(n, samples[s]) - heights[i]
                turned = _TURN_WEIGHT * (1.0 - dot(n, wanted[s]))
                if d * d + turned >= least and (near or d * d > most[s]):
                    continue
                d2 = _distance2(samples[s], corners[i], n, d)
                near |= d2 <= most[s]
                if d2 + turned < least:
                    best, least = i, d2 + turned
                    if near and turned < _SIMILAR and d2 == d * d:
                        break
            if not near:
                return -1
            found[count, 0], found[count, 1] = s, best
            count += 1
            for x in range(3):
                tally[best, x] += areas[s] * wanted[s, x]
            off = 2.0 * (1.0 - dot(new[best], wanted[s]))
            tally[best, 3] += areas[s] * min(off, _TURN_CAP)
            s = next_sample[s]
    return count


@kernel
def _is_near(p, face, count, vertices, triangles, normals, reach, found):
    # Whether a point lies near one of the old faces; those whose samples a new face has come first.
    for others in range(2):
        for j in range(count):
            f = found[j, 0] - vertices
            if f < 0 or (found[j, 1] == face) == (others == 1):
                continue
            a, b, c = triangles[f, 0], triangles[f, 1], triangles[f, 2]
            x = p[0] - (a[0] + b[0] + c[0]) / 3.0
            y = p[1] - (a[1] + b[1] + c[1]) / 3.0
            z = p[2] - (a[2] + b[2] + c[2]) / 3.0
            if x * x + y * y + z * z <= reach[f, 0]:
                n = normals[f, 0], normals[f, 1], normals[f, 2]
                height = n[0] * x + n[1] * y + n[2] * z
                if _distance2(p, triangles[f], n, height) <= reach[f, 1]:
                    return True
    return False


@kernel
def _is_covered(size, count, corners, vertices, triangles, normals, reach, found):
    # Whether no large new face spans a gap: the middles of n x n equal triangles of each lie near
    # the old faces.
    for i in range(size):
        a, b, c = corners[i, 0], corners[i, 1], corners[i, 2]
        _, _, double = _shape(a, b, c)
        if double < 2.0 * _LARGE_AREA:
            continue
        n = 2 + (double > 8.0 * _LARGE_AREA) + (double > 32.0 * _LARGE_AREA)
        for row in range(n):
            for column in range(2 * (n - row) - 1):
                up = column % 2
                x = (row + (1.0 + up) / 3.0) / n
                y = (column // 2 + (1.0 + up) / 3.0) / n
                z = 1.0 - x - y
                p = (
                    x * a[0] + y * b[0] + z * c[0],
                    x * a[1] + y * b[1] + z * c[1],
                    x * a[2] + y * b[2] + z * c[2],
                )
                if not _is_near(p, i, count, vertices, triangles, normals, reach, found):
                    return False
    return True


@kernel
def _collapse(points, home, faces, first, following, alive, held, lines, sources, quadrics,
              samples, wanted, areas, most, triangles, normals, reach, first_sample, next_sample,
              sums, changed, tried, seen, found, budget, worse):  # fmt: skip
    # Collapses up to `budget` edges, the cheapest first; returns how many.
    q, q2 = np.empty((4, 4)), np.empty((4, 4))
    fan, corners, new = np.empty(512, np.int32), np.empty((512, 3, 3)), np.empty((512, 3))
    tally = np.empty((512, 4))
    heap = [(0.0, 0, np.int64(-1))]
    for f in range(len(faces)):
        if alive[f]:
            for k in range(3):
                a, b = faces[f, k], faces[f, after(k)]
                stamp = changed[a] + changed[b]
                if (a < b or held[f, k]) and tried[3 * f + k] != stamp:
                    cost = _merger(f, k, points, home, faces, held, lines, quadrics, q)[3]
                    if cost < np.inf:
                        heap.append((cost, 3 * f + k, stamp))
    heapq.heapify(heap)
    done, tick = 0, seen.max()
    while heap and done < budget:
        _, c, stamp = heapq.heappop(heap)
        f, k = c // 3, c % 3
        if not alive[f] or changed[faces[f, k]] + changed[faces[f, after(k)]] != stamp:
            continue
        tried[c] = stamp
        u, v, p, cost = _merger(f, k, points, home, faces, held, lines, quadrics, q)
        tick += 1
        if u < 0 or not _is_linked(u, v, faces, first, following, seen, tick):
            continue
        size, whole = _fan(u, v, p, points, faces, sums, first, following, fan, corners, new)
        if size < 0:
            p = points[v, 0], points[v, 1], points[v, 2]
            size, whole = _fan(u, v, p, points, faces, sums, first, following, fan, corners, new)
        if size < 1:
            continue
        count = _hand_on(fan, size, whole, corners, new, samples, wanted, areas, most,
                         first_sample, next_sample, found, sums, tally)  # fmt: skip
        if count < 0:
            continue
        change = -worse
        for i in range(whole):
            change -= sums[fan[i], 3]
            if i < size:
                change += tally[i, 3]
        if change > 0.0:
            continue
        if not _is_covered(size, count, corners, len(home), triangles, normals, reach, found):
            continue
        if not _go(u, v, fan, size, whole, faces, first, following, alive, held, sources):
            continue
        for x in range(3):
            points[v, x] = p[x]
        quadrics[v] = q
        for i in range(size):
            first_sample[fan[i]] = -1
            sums[fan[i]] = tally[i]
        for i in range(count):
            s, g = found[i, 0], fan[found[i, 1]]
            next_sample[s] = first_sample[g]
            first_sample[g] = s
        for i in range(size):
            for j in range(3):
                changed[faces[fan[i], j]] += 1
        for i in range(size):
            g = fan[i]
            for j in range(3):
                a, b = faces[g, j], faces[g, after(j)]
                if a == v or (b == v and held[g, j]):
                    cost = _merger(g, j, points, home, faces, held, lines, quadrics, q2)[3]
                    if cost < np.inf:
                        heapq.heappush(heap, (cost, 3 * g + j, changed[a] + changed[b]))
        done += 1
    return done


@kernel
def _go(u, v, fan, size, whole, faces, first, following, alive, held, sources):
    # Moves the corners of u to v, and removes the faces that have both. Returns False, and changes
    # nothing, if two held edges would be merged.
    old, given = np.empty(2, np.int64), np.empty(2, np.int64)
    for again in range(2):
        for i in range(size, whole):
            f = fan[i]
            k = 0
            while faces[f, k] != u:
                k = after(k)
            ahead = faces[f, after(k)] == v
            there = after(k) if ahead else after(after(k))
            old[i - size], given[i - size] = sources[f, k], sources[f, there]
            # Held edges along either of the two edges that become one.
            of_u, of_v = held[f, after(after(k)) if ahead else k], held[f, after(k)]
            if again == 0 and of_u and of_v:
                return False
            if again == 1:
                alive[f] = False
                if of_u or of_v:
                    tip = faces[f, 3 - k - there]
                    for j in range(size):
                        g = fan[j]
                        for m in range(3):
                            a, b = faces[g, m], faces[g, after(m)]
                            if (a == tip and b in (u, v)) or (b == tip and a in (u, v)):
                                held[g, m] = True
    c = first[u]
    while c >= 0:
        f, k = c // 3, c % 3
        if alive[f]:
            faces[f, k] = v
            side = 0
            for i in range(whole - size):
                if old[i] == sources[f, k] or (i == 1 and old[0] >> 32 != sources[f, k] >> 32):
                    side = i
            sources[f, k] = given[side]
        c = following[c]
    c = first[v]
    while following[c] >= 0:
        c = following[c]
    following[c] = first[u]
    first[u] = -1
    _drop_dead(v, first, following, alive)
    for i in range(size, whole):
        for j in range(3):
            w = faces[fan[i], j]
            if w != v and w != u:
                _drop_dead(w, first, following, alive)
    return True
