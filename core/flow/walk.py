# SPDX-License-Identifier: GPL-3.0-or-later
"""Walks along the flow-lines of a triangle mesh (paper A, Appendix A, "Tracing Flow-Lines").

The flow is constant in a face. It is the shock flow of a potential, v = -u = -grad(P) / 2: values
move with u, so the walk against it finds what arrives at a point. A walk ends when its time is used
up, at a border, or where the flow turns by a right angle or more.

The walk goes straight from edge to edge. Where both faces of an edge flow into it, the walk slides
along the edge; the component of the flow along the edge is the same on both sides, half the slope
of P. A walk leaves a vertex in the direction of steepest descent. This is the limit of the paper's
small steps, which zigzag along the edges on which the exact walk slides (see
`benchmarks/literal_walk.py`). The paper does not say what happens at borders: here the walk ends.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel
from ..base.vectors import TIE_BREAKER, after, dot, edge
from ..mesh.triangle_mesh import Floats, Ints

_ROUNDING = 1e-9
"""Relative difference that counts as rounding: of where an edge is crossed, and of steepness."""

MOST_AROUND = 1000
"""Most faces around a vertex that a walk looks at or crosses; around larger hubs it ends."""

CUT_OFF, AROUND_HUB = 1, 2
"""How unfinished walks end: after `most_steps`, or by `MOST_AROUND`."""


class Triangles(NamedTuple):
    """The arrays of a mesh that walks read; see `TriangleMesh`."""

    vertices: Floats  # scaled
    faces: Ints
    twins: Ints
    areas: Floats
    crowded: npt.NDArray[np.bool_] = np.zeros(0, np.bool_)
    """Vertices of more than `MOST_AROUND` faces; empty if there are none."""


@kernel
def find_shock_rates(start, stop, triangles, potential, rates):
    """Compute d(barycentric coordinates)/dt under v = -grad(P) / 2.

    They are minus half the inner products of grad(P) with the gradients of the coordinates,
    computed from edge vectors.
    """
    vertices, faces, _, areas, _ = triangles
    for f in range(start, stop):
        if areas[f] == 0:
            rates[f] = 0.0
            continue
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        u, v = edge(vertices, a, b), edge(vertices, a, c)
        uu, uv, vv = dot(u, u), dot(u, v), dot(v, v)
        p = potential[b] - potential[a]
        q = potential[c] - potential[a]
        scale = -0.125 / (areas[f] * areas[f])
        rates[f, 1] = scale * (vv * p - uv * q)
        rates[f, 2] = scale * (uu * q - uv * p)
        rates[f, 0] = -rates[f, 1] - rates[f, 2]
        if max(abs(rates[f, 0]), abs(rates[f, 1]), abs(rates[f, 2])) < 1e-100:
            rates[f] = 0.0  # keeps crossing times finite


@kernel
def _sides(vertices, faces, f, k):
    # The vectors from corner k of a face to the next corner, and to the one before it.
    v = faces[f, k]
    return edge(vertices, v, faces[f, after(k)]), edge(vertices, v, faces[f, after(after(k))])


@kernel
def _flow_along(potential, triangles, f, k):
    # Inner product of half-edge k of a face with the flow along it.
    return 0.5 * (potential[triangles.faces[f, k]] - potential[triangles.faces[f, after(k)]])


@kernel
def _leave_vertex(triangles, rates, potential, f, k, arrival):
    # The direction of steepest descent from corner k of face f, around its vertex. `arrival` is the
    # angle, from the half-edge that leaves the corner, at which the walk came through the face.
    # Returns (face, corner, kind): kind 0 nowhere, 1 into the face, 2 along the half-edge that
    # leaves the corner. TIE_BREAKER, not the order of faces, decides between equally steep
    # directions.
    vertices, faces, twins, areas, crowded = triangles
    if crowded.size and crowded[faces[f, k]]:
        return -1, -1, 0
    total = 0.0
    best = 0.0
    best_angle = 0.0
    best_side = 0.0
    best_face, best_corner, kind = -1, -1, 0
    g, c = f, k
    for _ in range(MOST_AROUND):  # twins are paired: the loop closes, or ends at a border
        if areas[g] == 0:
            return -1, -1, 0
        u, w = _sides(vertices, faces, g, c)
        uu, uw, ww = dot(u, u), dot(u, w), dot(w, w)
        away = _flow_along(potential, triangles, g, c)
        if away > 0:
            merit = away / np.sqrt(uu)
            side = dot(TIE_BREAKER, u) / np.sqrt(uu)
            if _is_better(merit, side, best, best_side):
                best, best_angle, best_side = merit, total, side
                best_face, best_corner, kind = g, c, 2
        r, s = rates[g, after(c)], rates[g, after(after(c))]
        if r > 0 and s > 0:
            x = r * np.sqrt(uu) + s * uw / np.sqrt(uu)
            y = s * 2 * areas[g] / np.sqrt(uu)
            direction = total + np.arctan2(y, x)
            merit = np.sqrt(r * r * uu + 2 * r * s * uw + s * s * ww)
            side = (r * dot(TIE_BREAKER, u) + s * dot(TIE_BREAKER, w)) / merit
            if _is_better(merit, side, best, best_side):
                best, best_angle, best_side = merit, direction, side
                best_face, best_corner, kind = g, c, 1
        total += np.arctan2(2 * areas[g], uw)
        t = twins[g, after(after(c))]
        if t < 0:
            return -1, -1, 0  # the vertex lies on a border
        g = t // 3
        c = t - 3 * g
        if g == f and c == k:
            break
    else:
        return -1, -1, 0
    if kind == 0:
        return -1, -1, 0
    # Straight on is half of the vertex's total angle from the direction of arrival.
    share = abs(best_angle - arrival) / total
    if 0.25 < share < 0.75:
        return best_face, best_corner, kind
    return -1, -1, 0


@kernel
def _is_better(merit, side, best, best_side):
    if abs(merit - best) <= _ROUNDING * best:
        return side > best_side
    return merit > best


@kernel
def _corner_angle(triangles, f, k):
    u, w = _sides(triangles.vertices, triangles.faces, f, k)
    return np.arctan2(2 * triangles.areas[f], dot(u, w))


@kernel
def _angle_of_arrival(triangles, rates, f, k):
    # The angle, from the half-edge that leaves corner k, at which the face's flow arrives there.
    u, w = _sides(triangles.vertices, triangles.faces, f, k)
    r, s = max(-rates[f, after(k)], 0.0), max(-rates[f, after(after(k))], 0.0)
    return np.arctan2(s * 2 * triangles.areas[f], r * dot(u, u) + s * dot(u, w))


@kernel
def walk_exactly(
    start, stop, triangles, rates, potential, times, most_steps, point_faces, coordinates, endings
):
    """Walk from edge to edge; parameters as in `flow.trace`. `endings` must be 0 before.

    `rates` are the flow in each face, see `find_shock_rates`; `times` has one entry for each point,
    or one for all.
    """
    vertices, faces, twins, areas, crowded = triangles
    b = np.empty(3)
    for point in range(start, stop):
        f = point_faces[point]
        b[:] = coordinates[point]
        left = times[point] if len(times) > 1 else times[0]
        if areas[f] == 0 or (rates[f, 0] == 0 and rates[f, 1] == 0):
            left = 0.0
        slide = -1  # the half-edge along which the walk slides
        steps = 0
        around = 0  # consecutive edges crossed at crowded vertices
        while left > 0:
            if steps == most_steps:
                endings[point] = CUT_OFF
                break
            steps += 1
            corner, arrival = -1, 0.0
            if slide < 0:
                # Straight to the edge that is reached first.
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
                k = after(exit_corner)
                t = twins[f, k]
                if t < 0:
                    break
                g = t // 3
                if areas[g] == 0:
                    break
                h = t - 3 * g
                apex = after(after(h))
                inward = rates[g, apex]
                along = b[after(k)] / (b[k] + b[after(k)])
                at_vertex = along < _ROUNDING or along > 1.0 - _ROUNDING
                if at_vertex:
                    # Not into the face that rounding chose.
                    corner = k if along < 0.5 else after(k)
                    arrival = _angle_of_arrival(triangles, rates, f, corner)
                elif inward > 0:
                    if crowded.size:
                        at_hub = crowded[faces[f, k]] or crowded[faces[f, after(k)]]
                        around = around + 1 if at_hub else 0
                        if around == MOST_AROUND:
                            endings[point] = AROUND_HUB
                            b[k] = 1.0 - along
                            b[after(k)] = along
                            break
                    f = g
                    b[h] = along
                    b[after(h)] = 1.0 - along
                    b[apex] = 0.0
                    continue
                else:
                    # Both faces flow into the edge. The inner product of both flows, unfolded,
                    # times the squared length of the edge, tells whether the flow turns back.
                    sliding = _flow_along(potential, triangles, f, k)
                    across = (rates[f, exit_corner] * areas[f]) * (inward * areas[g])
                    if sliding * sliding - 4 * across <= 0 or sliding == 0:
                        b[k] = 1.0 - along
                        b[after(k)] = along
                        break
                    # go on below, with `along` measured from corner k
            else:
                f = slide // 3
                k = slide - 3 * f
                along = 0.0
                sliding = _flow_along(potential, triangles, f, k)
            if corner < 0:
                e = edge(vertices, faces[f, k], faces[f, after(k)])
                rate = sliding / dot(e, e)
                reached = (1.0 - along) / rate if rate > 0 else -along / rate
                b[after(after(k))] = 0.0
                if reached >= left:
                    along += rate * left
                    left = 0.0
                    b[k] = 1.0 - along
                    b[after(k)] = along
                    break
                left -= reached
                if rate > 0:
                    corner, arrival = after(k), _corner_angle(triangles, f, after(k))
                else:
                    corner = k
            b[0] = b[1] = b[2] = 0.0
            b[corner] = 1.0
            g, c, kind = _leave_vertex(triangles, rates, potential, f, corner, arrival)
            if kind == 0:
                if crowded.size and crowded[faces[f, corner]]:
                    endings[point] = AROUND_HUB
                break
            f = g
            b[0] = b[1] = b[2] = 0.0
            b[c] = 1.0
            slide = 3 * f + c if kind == 2 else -1
        point_faces[point] = f
        total = b[0] + b[1] + b[2]
        for c in range(3):
            coordinates[point, c] = b[c] / total
