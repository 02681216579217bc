# SPDX-License-Identifier: GPL-3.0-or-later
"""Crisp low poly: few triangles between the creases of a part, out of a fine remesh of it.

Not in the papers. Vertices are merged with neighbours, one by one (half-edge collapse with
quadrics, as in Garland and Heckbert: Surface Simplification Using Quadric Error Metrics, SIGGRAPH
1997). Those on a crease merge along it only, so that both of its sides share its vertices and no
T-joints come up. Then each vertex that is left moves to where the planes around it meet best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..base.checks import Floats, by_keyword
from ..base.parallel import kernel, run
from ..base.progress import ProgressCallback, ask, phase, reporting
from ..base.vectors import TIE_BREAKER, after, cross, dot, edge
from ..errors import InvalidSettings
from ..mesh.triangle_mesh import TriangleMesh, check_mesh
from ..settings import GeometrySettings, given_or_default
from .crease_edges import Bools
from .crease_lines import edges_of, find_creases
from .fit import displacement
from .sharpening import sharpen_geometry

Ints = npt.NDArray[np.int32]

_SHAPE = 2e-3
"""Height of the thinnest face over its longest edge; only those that were thinner may be."""

_NODE = 2.0
"""Edge lengths that ends and forks of lines move at most: what is no real corner goes so."""

_SMOOTHING = 8
"""Passes over the normals that faces are held to: those of slivers mean nothing."""

_PASSES = 200
_HOLD = 1e-3
"""How strongly vertices are held along directions in which no plane does."""


@dataclass(frozen=True)
class LowPoly:
    """A mesh of few triangles, and what it came from.

    Attributes
    ----------
    vertices : (k, 3) float64
        In the unit of the mesh that it was made from.
    faces : (j, 3) int32
        Wound as the faces of that mesh.
    vertex_source : (k,) int
        The vertex of that mesh which each stands for.
    face_source : (j,) int
        A face of that mesh which lies in each, between the same creases.
    corner_source : (j, 3) int
        A corner of that mesh, 3 * face + number, at each corner: on the same side of all lines that
        were kept, so that its UVs fit.

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
    angle: float = 25.0,
    keep: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> LowPoly:
    """Sharpen a remeshed part and dissolve what is flat or simply curved between its creases.

    Parameters
    ----------
    mesh : TriangleMesh
        Out of a voxel remesh, a scan, or sharpened already.
    settings : GeometrySettings, optional
        With which it is sharpened and its creases are found; an amount of 0 moves nothing before.
    tolerance : float
        How far the surface may move, in mean edge lengths: smaller keeps more faces on what is
        round. From 0.001 to 10.
    turn : float
        How far faces may turn from those that they replace, in degrees, from 0.1 to 60: what
        keeps round surfaces round.
    angle : float
        Least angle of creases, in degrees, from 5 to 170.
    keep : (k, 2) array of int, optional
        Vertices of edges that are kept as creases are, such as seams of UVs and borders of
        materials.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    LowPoly
        As manifold and as closed as the mesh, without T-joints.

    Raises
    ------
    InvalidSettings
        If tolerance, turn or angle are out of range.
    Cancelled
        If `progress` returned False.

    Notes
    -----
    Each vertex of the sharpened mesh stays within the tolerance of the faces that are left, before
    these settle, which may move them by as much again.

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
    if not 1e-3 <= tolerance <= 10.0:
        raise InvalidSettings(f"tolerance is {tolerance:g}; give 0.001 to 10 edge lengths.")
    if not 0.1 <= turn <= 60.0:
        raise InvalidSettings(f"turn is {turn:g}; give 0.1 to 60 degrees.")
    with reporting(progress):
        with phase(0.0, 0.5, "Sharpening"):
            sharp = mesh.moved_to(sharpen_geometry(mesh, settings))
        with phase(0.5, 0.6, "Tracing creases"):
            lines = find_creases(mesh, settings, angle=angle)
            pairs = edges_of(line for line in lines if line.state in ("closes", "sharp"))
            # How far ends and forks of lines have moved: what is asked for stays.
            gone = np.zeros(mesh.vertex_count)
            if keep is not None:
                kept_edges = np.asarray(keep, dtype=np.intp).reshape(-1, 2)
                degrees = np.bincount(kept_edges.reshape(-1), minlength=mesh.vertex_count)
                gone[(degrees > 0) & (degrees != 2)] = np.inf
                pairs = np.concatenate([pairs, kept_edges])
            held = _half_edges(mesh, pairs) | (mesh.twins < 0)
        with phase(0.6, 0.8, "Fitting the surface"):
            # Once more, to normals that are the same all over a side.
            normals = _smooth_normals(sharp, held | _bends(sharp, 0.5 * angle))
            moved, _ = displacement(sharp, normals, settings, None, settings.fit_steps,
                                    settings.crease_freedom)  # fmt: skip
            sharp = sharp.moved_to(sharp.vertices + moved)
        with phase(0.8, 1.0, "Dissolving faces"):
            return _dissolved(sharp, normals, held, gone, tolerance, np.cos(np.radians(turn)))


def _half_edges(mesh: TriangleMesh, pairs: npt.NDArray[np.intp]) -> Bools:
    ends = np.stack([mesh.faces, mesh.faces[:, (1, 2, 0)]], axis=-1)
    keys, given = (
        each.min(axis=-1) * np.int64(mesh.vertex_count) + each.max(axis=-1)
        for each in (ends, pairs)
    )
    return np.isin(keys, given)


def _dissolved(
    mesh: TriangleMesh, normals: Floats, held: Bools, gone: Floats, tolerance: float, cosine: float
) -> LowPoly:
    points, faces = mesh.scaled_vertices.copy(), mesh.faces.copy()
    start, corners = mesh.corners
    # The corners at each vertex, as a list: its first one, and the one after each.
    first = np.full(mesh.vertex_count, -1, dtype=np.int32)
    following = np.full(3 * mesh.face_count, -1, dtype=np.int32)
    used = np.flatnonzero(np.diff(start) > 0)
    first[used] = corners[start[used]]
    inner = np.ones(len(corners), dtype=bool)
    inner[start[used + 1] - 1] = False
    following[corners[inner]] = corners[np.flatnonzero(inner) + 1]
    quadrics = np.zeros((mesh.vertex_count, 11))
    _add_planes(points, faces, normals, mesh.areas, held, mesh.twins, quadrics)
    sources = np.arange(3 * mesh.face_count, dtype=np.int64).reshape(-1, 3)
    alive = np.ones(mesh.face_count, dtype=np.bool_)
    order = used[np.argsort(_scattered(points[used]), kind="stable")]
    # What has gone into each face, as a list: its first vertex, and the one after each.
    points_at = np.full(mesh.face_count, -1, dtype=np.int32)
    next_point = np.full(mesh.vertex_count, -1, dtype=np.int32)
    touched = np.zeros(mesh.vertex_count, dtype=np.int32)
    share = 1.0 / 64.0
    for number in range(1, _PASSES):
        merged = _merge(order, points, faces, normals, first, following, held, alive,
                        quadrics, sources, points_at, next_point, gone, touched, number,
                        share * tolerance**2, cosine)  # fmt: skip
        order = order[first[order] >= 0]
        ask(number / _PASSES)
        if merged < 0.02 * len(order):
            if share == 1.0 and merged == 0:
                break
            share = min(4.0 * share, 1.0)
    vertices = np.unique(faces[alive])
    moved = np.zeros((mesh.vertex_count, 3))
    _settle(vertices, points, quadrics, tolerance, moved)
    index = np.empty(mesh.vertex_count, dtype=np.int32)
    index[vertices] = np.arange(len(vertices), dtype=np.int32)
    left = np.flatnonzero(alive)
    turned = mesh.flipped[left]
    given, kept_corners = index[faces[left]], sources[left]
    given[turned] = given[turned][:, (0, 2, 1)]
    kept_corners[turned] = kept_corners[turned][:, (0, 2, 1)]
    face, corner = np.divmod(kept_corners, 3)
    corner = np.where(mesh.flipped[face] & (corner > 0), 3 - corner, corner)
    positions = mesh.vertices[vertices] + mesh.mean_edge_length * moved[vertices]
    return LowPoly(positions, given, vertices, left, 3 * face + corner)


def _bends(mesh: TriangleMesh, degrees: float) -> Bools:
    # Half-edges across which normals differ by more: lines may leave some out.
    other = np.where(mesh.twins >= 0, mesh.twins // 3, np.arange(mesh.face_count)[:, None])
    cosines = np.einsum("fx,fkx->fk", mesh.normals, mesh.normals[other])
    return cosines < np.cos(np.radians(degrees))


def _smooth_normals(mesh: TriangleMesh, held: Bools) -> Floats:
    # Of the faces, averaged over those beside them up to the lines.
    normals = mesh.normals * mesh.areas[:, None]
    for _ in range(_SMOOTHING):
        smoother = np.empty_like(normals)
        run(_average, mesh.face_count, mesh.twins, held, normals, smoother)
        normals = smoother
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 1e-12)


def _scattered(points: Floats) -> Floats:
    # An order in which places that follow each other lie apart, whatever that of the vertices.
    return np.modf(np.abs(np.sin(points @ np.array(TIE_BREAKER) * 12.9898) * 43758.5453))[0]


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
def _add_plane(q, n, d, weight):
    q[0] += weight * n[0] * n[0]
    q[1] += weight * n[0] * n[1]
    q[2] += weight * n[0] * n[2]
    q[3] += weight * n[1] * n[1]
    q[4] += weight * n[1] * n[2]
    q[5] += weight * n[2] * n[2]
    q[6] += weight * n[0] * d
    q[7] += weight * n[1] * d
    q[8] += weight * n[2] * d
    q[9] += weight * d * d
    q[10] += weight


@kernel
def _add_planes(points, faces, normals, areas, held, twins, quadrics):
    # Of each face at its corners, and through borders, upright on their faces.
    for f in range(len(faces)):
        n = normals[f, 0], normals[f, 1], normals[f, 2]
        middle = (points[faces[f, 0]] + points[faces[f, 1]] + points[faces[f, 2]]) / 3.0
        for k in range(3):
            _add_plane(quadrics[faces[f, k]], n, -dot(n, middle), areas[f] / 3.0)
            if twins[f, k] < 0:
                a, b = faces[f, k], faces[f, after(k)]
                e = edge(points, a, b)
                m = cross(e, n)
                length = np.sqrt(dot(m, m))
                if length < 1e-12:
                    continue
                m = m[0] / length, m[1] / length, m[2] / length
                d = -dot(m, points[a])
                for v in (a, b):
                    _add_plane(quadrics[v], m, d, 0.5 * length)


@kernel
def _distance2(p, a, b, c):
    # The squared distance of a point to a triangle (Ericson: Real-Time Collision Detection, 5.1.5).
    u = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    v = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    w = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    d1, d2 = dot(u, w), dot(v, w)
    uu, uv, vv, ww = dot(u, u), dot(u, v), dot(v, v), dot(w, w)
    d3, d4, d5, d6 = d1 - uu, d2 - uv, d1 - uv, d2 - vv
    if d1 <= 0.0 and d2 <= 0.0:
        return ww
    if d3 >= 0.0 and d4 <= d3:
        s, t = 1.0, 0.0
    elif d6 >= 0.0 and d5 <= d6:
        s, t = 0.0, 1.0
    else:
        vc, vb, va = d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4
        if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
            s, t = d1 / max(d1 - d3, 1e-30), 0.0
        elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
            s, t = 0.0, d2 / max(d2 - d6, 1e-30)
        elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
            t = (d4 - d3) / max((d4 - d3) + (d5 - d6), 1e-30)
            s = 1.0 - t
        else:
            whole = max(va + vb + vc, 1e-30)
            s, t = vb / whole, vc / whole
    x, y, z = w[0] - s * u[0] - t * v[0], w[1] - s * u[1] - t * v[1], w[2] - s * u[2] - t * v[2]
    return x * x + y * y + z * z


@kernel
def _nearest(p, u, v, points, faces, first, following, alive, enough):
    # The nearest of the faces that u leaves at v, and its squared distance to a point; stops at one
    # that is near enough.
    nearest, least = -1, np.inf
    c = first[u]
    while c >= 0 and least > enough:
        f = c // 3
        if alive[f] and faces[f, 0] != v and faces[f, 1] != v and faces[f, 2] != v:
            a = points[v if faces[f, 0] == u else faces[f, 0]]
            b = points[v if faces[f, 1] == u else faces[f, 1]]
            d = points[v if faces[f, 2] == u else faces[f, 2]]
            distance = _distance2(p, a, b, d)
            if distance < least:
                nearest, least = f, distance
        c = following[c]
    return nearest, least


@kernel
def _stays_near(u, v, points, faces, first, following, alive, points_at, next_point, most):
    # Whether u and all that has gone into its faces lie near enough once u is at v.
    if _nearest(points[u], u, v, points, faces, first, following, alive, most)[1] > most:
        return False
    c = first[u]
    while c >= 0:
        if alive[c // 3]:
            p = points_at[c // 3]
            while p >= 0:
                near = _nearest(points[p], u, v, points, faces, first, following, alive, most)
                if near[1] > most:
                    return False
                p = next_point[p]
        c = following[c]
    return True


@kernel
def _hand_on(u, v, points, faces, first, following, alive, points_at, next_point):
    # Gives u and what has gone into its faces to those that are nearest once u is at v.
    waiting = u
    next_point[u] = -1
    c = first[u]
    while c >= 0:
        f = c // 3
        if alive[f]:
            p = points_at[f]
            points_at[f] = -1
            while p >= 0:
                following_point = next_point[p]
                next_point[p] = waiting
                waiting, p = p, following_point
        c = following[c]
    while waiting >= 0:
        p = waiting
        waiting = next_point[p]
        f = _nearest(points[p], u, v, points, faces, first, following, alive, -1.0)[0]
        if f >= 0:
            next_point[p] = points_at[f]
            points_at[f] = p


@kernel
def _ring(u, faces, first, following, held, alive, ring, counts, lines):
    # The neighbours of a vertex, in how many faces each is with it, and whether along a line;
    # returns how many there are, -1 if there are too many. Drops dead corners from the list.
    size = 0
    before, c = -1, first[u]
    while c >= 0:
        f, k = c // 3, c % 3
        if not alive[f]:
            c = following[c]
            if before < 0:
                first[u] = c
            else:
                following[before] = c
            continue
        for side in range(2):
            j = after(k) if side == 0 else after(after(k))
            w = faces[f, j]
            on = held[f, k] if side == 0 else held[f, j]
            at = -1
            for i in range(size):
                if ring[i] == w:
                    at = i
            if at < 0:
                if size == len(ring):
                    return -1
                at = size
                size += 1
                ring[at], counts[at], lines[at] = w, 0, False
            counts[at] += 1
            lines[at] |= on
        before, c = c, following[c]
    return size


@kernel
def _quality(points, faces, f, u, v, n):
    # Of a face of u once that is at v: height over longest edge, and how far it has turned.
    a = v if faces[f, 0] == u else faces[f, 0]
    b = v if faces[f, 1] == u else faces[f, 1]
    c = v if faces[f, 2] == u else faces[f, 2]
    x, y = edge(points, a, b), edge(points, a, c)
    z = y[0] - x[0], y[1] - x[1], y[2] - x[2]
    m = cross(x, y)
    double = np.sqrt(dot(m, m))
    longest = max(dot(x, x), dot(y, y), dot(z, z))
    if double <= 1e-9 * longest:
        return -1.0, -1.0
    return double / longest, (m[0] * n[0] + m[1] * n[1] + m[2] * n[2]) / double


@kernel
def _fits(u, v, points, faces, normals, first, following, alive, least):
    # How well the faces of u are shaped after it has gone to v; -1 where that must not be.
    worst = np.inf
    c = first[u]
    while c >= 0:
        f = c // 3
        if alive[f] and faces[f, 0] != v and faces[f, 1] != v and faces[f, 2] != v:
            shape, cosine = _quality(points, faces, f, u, v, normals[f])
            old_shape, old_cosine = _quality(points, faces, f, u, u, normals[f])
            if cosine < least and (cosine <= old_cosine or cosine < 0):
                return -1.0
            if shape < _SHAPE and shape <= old_shape:
                return -1.0
            worst = min(worst, shape)
        c = following[c]
    return worst


@kernel
def _merge(
    order,
    points,
    faces,
    normals,
    first,
    following,
    held,
    alive,
    quadrics,
    sources,
    points_at,
    next_point,
    gone,
    touched,
    number,
    most,
    least_cosine,
):
    ring, counts, lines = np.empty(256, np.int32), np.empty(256, np.int32), np.empty(256, np.bool_)
    ring_2, counts_2 = np.empty(256, np.int32), np.empty(256, np.int32)
    lines_2 = np.empty(256, np.bool_)
    merged = 0
    for u in order:
        if first[u] < 0 or touched[u] == number:
            continue
        size = _ring(u, faces, first, following, held, alive, ring, counts, lines)
        if size < 3:
            continue
        along = 0
        manifold = True
        for i in range(size):
            along += lines[i]
            manifold &= counts[i] == 2 or (counts[i] == 1 and lines[i])
        if not manifold:
            continue
        best, shape = -1, -1.0
        for i in range(size):
            v = ring[i]
            if along > 0 and not lines[i]:
                continue
            if along > 0 and along != 2:
                e = edge(points, u, v)
                if gone[u] + np.sqrt(dot(e, e)) > _NODE:
                    continue
            quality = _fits(u, v, points, faces, normals, first, following, alive, least_cosine)
            if quality <= shape:
                continue
            # Only the corners opposite of the edge may be neighbours of both.
            size_2 = _ring(v, faces, first, following, held, alive, ring_2, counts_2, lines_2)
            if size_2 < 0:
                continue
            common = 0
            for a in range(size):
                for b in range(size_2):
                    common += ring[a] == ring_2[b]
            if common != counts[i]:
                continue
            # A solid needs four corners.
            if common == 2 and size == 3 and size_2 == 3:
                continue
            if not _stays_near(u, v, points, faces, first, following, alive, points_at,
                               next_point, most):  # fmt: skip
                continue
            best, shape = i, quality
        if best < 0:
            continue
        v = ring[best]
        if along > 0 and along != 2:
            e = edge(points, u, v)
            gone[v] = max(gone[v], gone[u] + np.sqrt(dot(e, e)))
        _hand_on(u, v, points, faces, first, following, alive, points_at, next_point)
        _go(u, v, faces, first, following, held, alive, sources)
        for x in range(11):
            quadrics[v, x] += quadrics[u, x]
        for i in range(size):
            touched[ring[i]] = number
        merged += 1
    return merged


@kernel
def _hold_edge(v, w, faces, first, following, held, alive):
    # Marks the edge between two vertices as one of a line, in all its faces.
    c = first[v]
    while c >= 0:
        f, k = c // 3, c % 3
        if alive[f]:
            if faces[f, after(k)] == w:
                held[f, k] = True
            if faces[f, after(after(k))] == w:
                held[f, after(after(k))] = True
        c = following[c]


@kernel
def _go(u, v, faces, first, following, held, alive, sources):
    # Moves the corners of u to v; the faces that have both vanish.
    tips, marks = np.empty(2, np.int32), np.zeros(2, np.bool_)
    dying = 0
    given = np.empty(2, np.int64)
    sides = np.empty(2, np.int64)
    c = first[u]
    while c >= 0:
        f, k = c // 3, c % 3
        if alive[f] and (faces[f, after(k)] == v or faces[f, after(after(k))] == v):
            ahead = faces[f, after(k)] == v
            tip = after(after(k)) if ahead else after(k)
            tips[dying] = faces[f, tip]
            # Lines along either of the sides that become one.
            marks[dying] = held[f, after(k)] or held[f, after(after(k)) if ahead else k]
            given[dying] = sources[f, after(k) if ahead else after(after(k))]
            sides[dying] = f
            alive[f] = False
            dying += 1
        c = following[c]
    # Faces beside a vanished one, up to a line, take its corner at v.
    for i in range(dying):
        f = sides[i]
        w = tips[i]
        blocked = False
        for j in range(3):
            if faces[f, j] == w and faces[f, after(j)] == u:
                blocked = held[f, j]
            if faces[f, j] == u and faces[f, after(j)] == w:
                blocked = held[f, j]
        while not blocked:
            # The living face of u across the edge from u to w.
            found = -1
            c = first[u]
            while c >= 0:
                g, k = c // 3, c % 3
                beside = faces[g, after(k)] == w or faces[g, after(after(k))] == w
                if alive[g] and sources[g, k] >= 0 and beside:
                    found = c
                    break
                c = following[c]
            if found < 0:
                break
            g, k = found // 3, found % 3
            sources[g, k] = -1 - given[i]
            ahead = faces[g, after(k)] == w
            w = faces[g, after(after(k))] if ahead else faces[g, after(k)]
            blocked = held[g, after(after(k))] if ahead else held[g, k]
    c = first[u]
    while c >= 0:
        f, k = c // 3, c % 3
        if alive[f]:
            faces[f, k] = v
            if sources[f, k] < 0:
                sources[f, k] = -1 - sources[f, k]
            else:
                sources[f, k] = given[0]
        c = following[c]
    c = first[v]
    while following[c] >= 0:
        c = following[c]
    following[c] = first[u]
    first[u] = -1
    for i in range(dying):
        if marks[i]:
            _hold_edge(v, tips[i], faces, first, following, held, alive)


@kernel
def _settle(vertices, points, quadrics, most, moved):
    # To where the planes meet best: the least of the quadric, held a little.
    for v in vertices:
        q = quadrics[v]
        hold = _HOLD * q[10]
        x, y, z = points[v, 0], points[v, 1], points[v, 2]
        a, b, c, d, e, f = q[0] + hold, q[1], q[2], q[3] + hold, q[4], q[5] + hold
        r = -(q[0] * x + q[1] * y + q[2] * z + q[6])
        s = -(q[1] * x + q[3] * y + q[4] * z + q[7])
        t = -(q[2] * x + q[4] * y + q[5] * z + q[8])
        i, j, k = d * f - e * e, c * e - b * f, b * e - c * d
        whole = a * i + b * j + c * k
        if not whole > 1e-12 * (a * d * f):
            continue
        g, h, m = a * f - c * c, b * c - a * e, a * d - b * b
        dx = (i * r + j * s + k * t) / whole
        dy = (j * r + g * s + h * t) / whole
        dz = (k * r + h * s + m * t) / whole
        length = np.sqrt(dx * dx + dy * dy + dz * dz)
        if length > most:
            continue
        moved[v, 0], moved[v, 1], moved[v, 2] = dx, dy, dz
