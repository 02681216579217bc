# SPDX-License-Identifier: GPL-3.0-or-later
"""Selects the edges of a mesh that are creases: lines without gaps and spurs.

Not in the papers. An edge is a crease if the target normals of its two faces differ much. Single
faces that belong to neither side would double a line, so small regions between such edges are
merged with the most similar neighbour. Lines are continued along weaker edges (hysteresis, as in
edge detection for images), ends close to another line are joined with it, and short lines with
loose ends are removed.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import numpy.typing as npt

from ..base.memo import kept
from ..base.parallel import kernel, run, run_in_order
from ..base.progress import ask
from ..base.vectors import TIE_BREAKER, after, cross, dot, edge
from ..mesh.calculus import greatest_to_faces, greatest_to_vertices, smooth_vertices
from ..mesh.triangle_mesh import Floats, TriangleMesh
from ..sparse.components import root_of
from .noise import even_edges, possible_noise

Bools = npt.NDArray[np.bool_]
Singles = npt.NDArray[np.float32]

STRONG = 25.0
"""Angle in degrees between the normals across an edge from which it is a crease by itself."""

EVEN = 0.15
"""On designed parts, the mean turn across edges beside a crease is at most this share of the
crease's own: up to 0.09 on parts of few faces, but more than 0.15 at 90 % of the steep edges of
rocks, heads and noise."""

_RINGS = 2
"""Smoothing passes over that mean."""

_WEAK = 0.5
"""Share of the crease angle from which an edge may continue a crease."""

_SMALL_AREA = 2.0
"""Area, in squared mean edge lengths, below which a region between creases may be merged."""

_TURNED_COSINE = np.cos(np.radians(2.0))
"""Cosine of 2 degrees. A small region is merged if most of its area belongs to faces that turn to
their targets by more, or that share a vertex with such faces."""

_SLIVER = 0.035
"""Small regions of evenly meshed surfaces are also merged if their area is below this share of
their squared perimeter. Elsewhere such regions are narrow sides of the part, as of plates."""

_LARGEST_SHARE = 0.25
"""No region is merged whose area is more than this share of the region it would join: on coarse
meshes, single faces are regions."""

_ROUNDS = 3
"""Rounds of merging: a region may be merged with one that is small too."""

_AHEAD_COSINE = 0.35
"""Least cosine of the angle by which a line turns where it is continued."""

_FIRST_PRUNING = 3, 1
"""Most edges of lines that are removed at first: of lines that end at another one, and of lines
with two loose ends."""

_LAST_PRUNING = 3, 5
"""The same after lines have been continued and joined."""

_OWN_VERTICES = 8
"""An end is not joined with the last vertices of its own line, up to this number."""


def turns_across(mesh: TriangleMesh, normals: Floats) -> Singles:
    """Measure the angles between normals across half-edges: (m, 3), in degrees.

    Positive where the crease is convex, negative where it is concave, 0 at borders.
    """
    turns = np.empty((mesh.face_count, 3), dtype=np.float32)
    run(_measure_turns, mesh.face_count, mesh.scaled_vertices, mesh.faces, mesh.twins, normals,
        turns)  # fmt: skip
    return turns


def unevenness(mesh: TriangleMesh, turns: Singles, angle: float) -> Floats:
    """Average the turns across edges below the crease angle around vertices: (n,), in degrees."""
    uneven = np.empty((mesh.vertex_count, 1))
    run(_measure_unevenness, mesh.vertex_count, *mesh.corners, turns, angle, uneven)
    return smooth_vertices(mesh, uneven, _RINGS)[:, 0]


def even_share(mesh: TriangleMesh, chosen: Bools | None = None) -> float:
    """Return the share of steep edges, of all faces or of chosen ones, with smooth sides."""
    turns = turns_across(mesh, mesh.normals)
    uneven = unevenness(mesh, turns, STRONG)
    if chosen is not None:
        turns[~chosen] = 0.0
    steep = np.abs(turns) >= STRONG
    beside = uneven[mesh.faces] + uneven[np.roll(mesh.faces, -1, axis=1)]
    even = steep & (beside <= 2.0 * EVEN * np.abs(turns))
    return np.count_nonzero(even) / max(np.count_nonzero(steep), 1)


def crease_edges(
    mesh: TriangleMesh,
    normals: Floats,
    turns: Singles,
    angle: float = STRONG,
    allowed: Bools | None = None,
    hidden: Bools | None = None,
) -> Bools:
    """Select the half-edges of crease lines.

    Parameters
    ----------
    mesh : TriangleMesh
    normals : (m, 3) float64
        The target normals of the faces.
    turns : (m, 3) float32
        Angles across half-edges, from `turns_across`.
    angle : float
        Angle in degrees from which an edge is a crease by itself; half of it continues a crease.
    allowed : (n,) bool, optional
        Vertices that lines may pass through; all by default.
    hidden : (m, 3) bool, optional
        Half-edges that lines must avoid, such as diagonals of quads.

    Returns
    -------
    (m, 3) bool
        True at both half-edges of each crease edge.
    """
    chosen = np.empty(mesh.faces.shape, dtype=np.bool_)
    run(_choose_strong, mesh.face_count, turns, angle, chosen)
    _join_small_regions(mesh, normals, turns, chosen)
    barred = np.zeros(chosen.shape, dtype=np.bool_) if hidden is None else hidden.copy()
    if hidden is not None:
        _go_around(mesh.twins, turns, hidden, chosen)
    if allowed is not None:
        barred |= ~(allowed[mesh.faces] & allowed[mesh.faces[:, (1, 2, 0)]])
        chosen &= ~barred
    degrees = np.zeros(mesh.vertex_count, dtype=np.int32)
    run_in_order(_count_edges, mesh.face_count, mesh.faces, chosen, degrees)
    of_mesh = mesh.scaled_vertices, mesh.faces, mesh.twins, *mesh.corners
    more = turns, angle, barred, chosen, degrees
    _prune(_ends(mesh, degrees), *of_mesh, *_FIRST_PRUNING, chosen, degrees)
    _continue(_ends(mesh, degrees), *of_mesh, *more)
    for _ in range(2):
        _bridge(_ends(mesh, degrees), *of_mesh, *more)
        _drop_doubles(mesh, normals, turns, chosen, degrees)
        _prune(_ends(mesh, degrees), *of_mesh, *_LAST_PRUNING, chosen, degrees)
        ask()
    return chosen


def _ends(mesh: TriangleMesh, degrees: npt.NDArray[np.int32]) -> npt.NDArray[np.intp]:
    # The loose ends of lines, in an order that does not depend on that of the vertices.
    ends = np.flatnonzero(degrees == 1)
    return ends[np.argsort(mesh.scaled_vertices[ends] @ np.array(TIE_BREAKER), kind="stable")]


def _drop_doubles(
    mesh: TriangleMesh,
    normals: Floats,
    turns: Singles,
    chosen: Bools,
    degrees: npt.NDArray[np.int32],
) -> None:
    # Bridges may enclose small regions: merges these, unless that would make a line end.
    before, inner = chosen.copy(), degrees > 1
    _join_small_regions(mesh, normals, turns, chosen)
    face, side = np.nonzero(before & ~chosen)
    ends = mesh.faces[face, side], mesh.faces[face, (side + 1) % 3]
    while True:
        degrees[:] = 0
        run_in_order(_count_edges, mesh.face_count, mesh.faces, chosen, degrees)
        ending = inner & (degrees == 1)
        back = ~chosen[face, side] & (ending[ends[0]] | ending[ends[1]])
        if not back.any():
            return
        chosen[face[back], side[back]] = True


def _join_small_regions(mesh: TriangleMesh, normals: Floats, turns: Singles, chosen: Bools) -> None:
    # Removes the edges around regions that are too small to be sides of a crease.
    if not chosen.any():
        return
    parts = np.arange(mesh.face_count, dtype=np.int32)
    run_in_order(_unite, mesh.face_count, mesh.twins, chosen, parts)
    run_in_order(_flatten, mesh.face_count, parts)
    face, side = np.nonzero(chosen)
    other = mesh.twins[face, side] // 3
    ends = mesh.faces[face, side], mesh.faces[face, (side + 1) % 3]
    steps = mesh.scaled_vertices[ends[0]] - mesh.scaled_vertices[ends[1]]
    # A region is similar to a neighbour by a long common border and a small turn across it.
    length = np.linalg.norm(steps, axis=1)
    alike = length * (1.0 + np.cos(np.radians(turns[face, side])))
    turned = (np.einsum("ij,ij->i", mesh.normals, normals) < _TURNED_COSINE).astype(np.float64)
    turned = mesh.areas * greatest_to_faces(mesh, greatest_to_vertices(mesh, turned))
    first = parts.copy()
    for _ in range(_ROUNDS):
        area = np.bincount(parts, mesh.areas, minlength=mesh.face_count)
        here, there = parts[face], parts[other]
        around = np.bincount(here, length * (here != there), minlength=mesh.face_count)
        none = np.bincount(parts, turned, minlength=mesh.face_count) > 0.5 * area
        narrow = area <= _SLIVER * around**2
        if (narrow[here] & (area[here] < _SMALL_AREA)).any():
            shares = kept(mesh, "evenly meshed", (), partial(_evenly_meshed, mesh))
            even = np.bincount(parts, mesh.areas * shares, minlength=mesh.face_count)
            none |= narrow & (even > 0.5 * area)
        rows = np.flatnonzero((here != there) & (area[here] < _SMALL_AREA) & none[here])
        pairs = here[rows].astype(np.int64) * mesh.face_count + there[rows]
        unique, number = np.unique(pairs, return_inverse=True)
        likeness = np.bincount(number, alike[rows])
        small, large = np.divmod(unique, mesh.face_count)
        likeness[area[small] > _LARGEST_SHARE * area[large]] = 0.0
        order = np.lexsort((area[large], likeness.round(9), small))
        last = np.append(small[order][1:] != small[order][:-1], True) & (likeness[order] > 0)
        joins = np.arange(mesh.face_count, dtype=np.int32)
        _unite_pairs(small[order][last], large[order][last], joins)  # for none, too: to compile it
        if len(rows) == 0:
            break
        parts = joins[parts]
        run_in_order(_flatten, mesh.face_count, parts)
        ask()
    joined = (parts[face] == parts[other]) & (first[face] != first[other])
    chosen[face[joined], side[joined]] = False


def _evenly_meshed(mesh: TriangleMesh) -> Floats:
    # From 0 where a design program surely made the faces, to 1.
    return np.minimum(possible_noise(mesh, remeshed=True), even_edges(mesh))


@kernel
def _measure_turns(start, stop, vertices, faces, twins, normals, turns):
    for f in range(start, stop):
        for k in range(3):
            turns[f, k] = 0.0
            twin = twins[f, k]
            if twin < 0:
                continue
            one, other = normals[f], normals[twin // 3]
            angle = np.degrees(np.arccos(min(max(dot(one, other), -1.0), 1.0)))
            along = edge(vertices, faces[f, k], faces[f, after(k)])
            turns[f, k] = angle if dot(cross(one, other), along) >= 0 else -angle


@kernel
def _measure_unevenness(start, stop, corner_start, corners, turns, angle, uneven):
    for v in range(start, stop):
        total, count = 0.0, 0
        for i in range(corner_start[v], corner_start[v + 1]):
            turn = abs(turns[corners[i] // 3, corners[i] % 3])
            if turn < angle:
                total += turn
                count += 1
        uneven[v, 0] = total / max(count, 1)


@kernel
def _choose_strong(start, stop, turns, least, chosen):
    for f in range(start, stop):
        for k in range(3):
            chosen[f, k] = abs(turns[f, k]) >= least


@kernel
def _go_around(twins, turns, hidden, chosen):
    # Replaces the diagonal of a quad by the quad's two edges on its sharper side.
    for f in range(len(twins)):
        for k in range(3):
            twin = twins[f, k]
            if not (hidden[f, k] and chosen[f, k]) or twin < 3 * f + k:
                continue
            g, j = twin // 3, twin % 3
            a, b = after(k), after(after(k))
            c, d = after(j), after(after(j))
            here, there = abs(turns[f, a]) + abs(turns[f, b]), abs(turns[g, c]) + abs(turns[g, d])
            chosen[f, k] = chosen[g, j] = False
            face, one, other = (f, a, b) if here >= there else (g, c, d)
            for side in (one, other):
                beyond = twins[face, side]
                if beyond >= 0 and not hidden[face, side]:
                    chosen[face, side] = True
                    chosen[beyond // 3, beyond % 3] = True


@kernel
def _unite(start, stop, twins, chosen, parts):
    # Joins faces across edges that are no creases; the lowest face index labels a region.
    for f in range(start, stop):
        for k in range(3):
            if twins[f, k] >= 3 * f and not chosen[f, k]:
                a, b = root_of(parts, f), root_of(parts, twins[f, k] // 3)
                parts[max(a, b)] = min(a, b)


@kernel
def _unite_pairs(ones, others, parts):
    for i in range(len(ones)):
        a, b = root_of(parts, ones[i]), root_of(parts, others[i])
        parts[max(a, b)] = min(a, b)


@kernel
def _flatten(start, stop, parts):
    for f in range(start, stop):
        parts[f] = root_of(parts, f)


@kernel
def _count_edges(start, stop, faces, chosen, degrees):
    for f in range(start, stop):
        for k in range(3):
            if chosen[f, k]:
                degrees[faces[f, k]] += 1


@kernel
def _choose(faces, twins, h, chosen, degrees, chooses):
    twin = twins[h // 3, h % 3]
    chosen[h // 3, h % 3] = chooses
    chosen[twin // 3, twin % 3] = chooses
    change = 1 if chooses else -1
    degrees[faces[h // 3, h % 3]] += change
    degrees[faces[twin // 3, twin % 3]] += change


@kernel
def _next(v, h, faces, twins, corner_start, corners, chosen):
    # The half-edge along which the line leaves v, other than back along h; -1 for none.
    back = twins[h // 3, h % 3] if h >= 0 else -1
    for i in range(corner_start[v], corner_start[v + 1]):
        out = corners[i]
        if chosen[out // 3, out % 3] and out != back:
            return out
    return -1


@kernel
def _end_of(h, faces):
    return faces[h // 3, after(h % 3)]


@kernel
def _last_vertices(v, faces, twins, corner_start, corners, chosen, degrees, last):
    # Lists the end v of a line and the vertices before it; returns how many.
    last[0] = v
    count, h = 1, -1
    while count < len(last):
        h = _next(last[count - 1], h, faces, twins, corner_start, corners, chosen)
        if h < 0:
            break
        last[count] = _end_of(h, faces)
        count += 1
        if degrees[last[count - 1]] != 2:
            break
    return count


@kernel
def _way(vertices, last, count):
    # The unit direction of a line at its end.
    x, y, z = edge(vertices, last[min(count - 1, 3)], last[0])
    length = max(np.sqrt(x * x + y * y + z * z), 1e-30)
    return x / length, y / length, z / length


@kernel
def _turn_to(vertices, way, a, b):
    # The cosine between a direction and the edge from a to b, and the length of that edge.
    e = edge(vertices, a, b)
    length = max(np.sqrt(dot(e, e)), 1e-30)
    return dot(way, e) / length, length


@kernel
def _continue(
    ends, vertices, faces, twins, corner_start, corners, turns, angle, barred, chosen, degrees
):
    # Continues lines along the strongest weak edge ahead, until they meet a line or find none.
    last = np.empty(4, dtype=np.int32)
    for v in ends:
        if degrees[v] != 1:
            continue
        h = _next(v, -1, faces, twins, corner_start, corners, chosen)
        convex = turns[h // 3, h % 3] >= 0
        while degrees[v] == 1:
            count = _last_vertices(v, faces, twins, corner_start, corners, chosen, degrees, last)
            way = _way(vertices, last, count)
            best, strongest = -1, 0.0
            for i in range(corner_start[v], corner_start[v + 1]):
                h = corners[i]
                w = _end_of(h, faces)
                turn = turns[h // 3, h % 3] if convex else -turns[h // 3, h % 3]
                if (
                    turn < _WEAK * angle
                    or turn <= strongest
                    or chosen[h // 3, h % 3]
                    or barred[h // 3, h % 3]
                ):
                    continue
                if _turn_to(vertices, way, v, w)[0] > _AHEAD_COSINE:
                    best, strongest = h, turn
            if best < 0:
                break
            _choose(faces, twins, best, chosen, degrees, True)
            v = _end_of(best, faces)


@kernel
def _price(vertices, turns, angle, way, v, h, faces):
    # The cost of an edge of a bridge; infinite where it leads back.
    w = _end_of(h, faces)
    ahead, length = _turn_to(vertices, way, v, w)
    if ahead < 0.0:
        return np.inf
    return length * (2.0 - min(abs(turns[h // 3, h % 3]) / angle, 1.0)) * (1.5 - 0.5 * ahead)


@kernel
def _bridge(
    ends, vertices, faces, twins, corner_start, corners, turns, angle, barred, chosen, degrees
):
    # Joins loose ends, over at most three edges, with another line or a far part of their own.
    last = np.empty(_OWN_VERTICES, dtype=np.int32)
    way_h = np.empty(3, dtype=np.int64)
    best_h = np.empty(3, dtype=np.int64)
    at = np.empty(4, dtype=np.int64)
    cursor = np.empty(3, dtype=np.int64)
    cost = np.zeros(4)
    for v in ends:
        if degrees[v] != 1:
            continue
        count = _last_vertices(v, faces, twins, corner_start, corners, chosen, degrees, last)
        way = _way(vertices, last, count)
        best, steps = np.inf, 0
        at[0], depth = v, 0
        cursor[0] = corner_start[v]
        while depth >= 0:
            a = at[depth]
            if cursor[depth] == corner_start[a + 1]:
                depth -= 1
                continue
            h = corners[cursor[depth]]
            cursor[depth] += 1
            w = _end_of(h, faces)
            if chosen[h // 3, h % 3] or twins[h // 3, h % 3] < 0 or barred[h // 3, h % 3]:
                continue
            price = cost[depth] + _price(vertices, turns, angle, way, a, h, faces)
            if not price < best:
                continue
            own = False
            for i in range(count):
                own |= last[i] == w
            for i in range(depth + 1):
                own |= at[i] == w
            if own:
                continue
            way_h[depth] = h
            if degrees[w] > 0:
                whole = 0.7 * price if degrees[w] == 1 else price
                if whole < best:
                    best, steps = whole, depth + 1
                    best_h[:steps] = way_h[:steps]
            elif depth < 2:
                depth += 1
                at[depth], cost[depth] = w, price
                cursor[depth] = corner_start[w]
        for i in range(steps):
            _choose(faces, twins, best_h[i], chosen, degrees, True)


@kernel
def _prune(ends, vertices, faces, twins, corner_start, corners, spur, short, chosen, degrees):
    # Removes short lines with loose ends.
    last = np.empty(max(spur, short) + 2, dtype=np.int32)
    for v in ends:
        if degrees[v] != 1:
            continue
        count = _last_vertices(v, faces, twins, corner_start, corners, chosen, degrees, last)
        goes_on = degrees[last[count - 1]]
        if goes_on == 2 or count - 1 > (short if goes_on == 1 else spur):
            continue
        for _ in range(count - 1):
            h = _next(v, -1, faces, twins, corner_start, corners, chosen)
            _choose(faces, twins, h, chosen, degrees, False)
            v = _end_of(h, faces)
