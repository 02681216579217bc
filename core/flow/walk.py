# SPDX-License-Identifier: GPL-3.0-or-later
"""Walks along the flow-lines of a triangle mesh (paper A, Appendix A, "Tracing Flow-Lines").

The flow is constant in a face. It is the shock flow of a potential, v = -u = -grad(P) / 2 (values
flow with u, so what arrives at a point is found by walking against it), or a given tangent vector
in each face. A walk ends when its time is used up or at a border; one along the shock flow also
where the flow turns by a right angle or more.

Two ways of walking:

- *exact*: straight from edge to edge. Where both faces of an edge flow into it, the walk slides
  along the edge with the combination of both flows that stays on the edge (Filippov); the part of
  the shock flow along the edge is the same on both sides, half the fall of P. At a vertex it
  leaves in the direction of steepest descent; along a given field, in the one straightest on
  among those that lead away.
- *literal*: the paper's steps of a tenth of a mean edge length, continued over edges by
  unfolding; it zigzags along the edges on which the exact walk slides.

Both differ from the paper at borders only, about which it is silent: the walk ends there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel
from ..mesh.triangle_mesh import Floats, Ints

_MOST_RESTS = 30


class Triangles(NamedTuple):
    """What walks read of a mesh; see `TriangleMesh`."""

    vertices: Floats  # scaled
    faces: Ints
    twins: Ints
    areas: Floats
    normals: Floats


class Field(NamedTuple):
    """What a walk follows.

    Attributes
    ----------
    rates : (m, 3) float64
        The flow in each face, as the rates of the barycentric coordinates.
    potential : (n,) float64 or None
        P at the vertices, of which it is the shock flow; None: it is a given field.
    """

    rates: Floats
    potential: npt.NDArray[np.float64] | None = None


@kernel
def find_shock_rates(start, stop, triangles, potential, rates):
    """Compute d(barycentric coordinates)/dt under v = -grad(P) / 2.

    They are minus half the inner products of grad(P) with the gradients of the coordinates, all
    from edge vectors.
    """
    vertices, faces, _, areas, _ = triangles
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
        _clear_tiny(rates, f)


@kernel
def find_given_rates(start, stop, triangles, vectors, rates):
    """Compute d(barycentric coordinates)/dt under the tangential part of given vectors."""
    vertices, faces, _, areas, normals = triangles
    for f in range(start, stop):
        rates[f] = 0.0
        if areas[f] > 0:
            _coordinate_rates(vertices, faces, areas, normals, f, vectors[f], rates[f])
            rates[f, 0] = -rates[f, 1] - rates[f, 2]
            _clear_tiny(rates, f)


@kernel
def _clear_tiny(rates, f):
    if max(abs(rates[f, 0]), abs(rates[f, 1]), abs(rates[f, 2])) < 1e-100:
        rates[f] = 0.0  # so that crossing times stay finite


@kernel
def _coordinate_rates(vertices, faces, areas, normals, f, direction, r):
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


@kernel
def _given_along(triangles, rates, f, k):
    # Inner product of the flow in a face and its half-edge k.
    vertices, faces, _, _, _ = triangles
    a, b, c = faces[f, k], faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
    uu = 0.0
    uv = 0.0
    for x in range(3):
        u = vertices[b, x] - vertices[a, x]
        uu += u * u
        uv += u * (vertices[c, x] - vertices[a, x])
    return rates[f, (k + 1) % 3] * uu + rates[f, (k + 2) % 3] * uv


@kernel
def _sliding(potential, triangles, rates, f, k):
    # Inner product of half-edge k of a face, into which both its faces flow, with the combination
    # of both flows that stays on it.
    if potential is not None:
        return 0.5 * (potential[triangles.faces[f, k]] - potential[triangles.faces[f, (k + 1) % 3]])
    t = triangles.twins[f, k]
    g = t // 3
    h = t - 3 * g
    out = -rates[f, (k + 2) % 3] * triangles.areas[f]
    into = rates[g, (h + 2) % 3] * triangles.areas[g]
    share = -into / (out - into)
    along = share * _given_along(triangles, rates, f, k)
    return along - (1.0 - share) * _given_along(triangles, rates, g, h)


@kernel
def _edge_away(potential, triangles, rates, f, k):
    # Inner product of half-edge k and a flow along it that leads away from its first corner;
    # 0 if there is none.
    if potential is not None:
        a, b = triangles.faces[f, k], triangles.faces[f, (k + 1) % 3]
        return 0.5 * (potential[a] - potential[b]) if potential[b] < potential[a] else 0.0
    t = triangles.twins[f, k]
    g = t // 3
    if t < 0 or triangles.areas[g] == 0:
        return 0.0
    if rates[f, (k + 2) % 3] < 0 and rates[g, (t - 3 * g + 2) % 3] < 0:
        return max(_sliding(potential, triangles, rates, f, k), 0.0)
    return 0.0


@kernel
def _leave_vertex(triangles, field, f, k, came):
    # Where to go from corner k of face f, around its vertex: along the shock flow in the direction
    # of steepest descent, along a given field in the one closest to straight on. `came` says along
    # which half-edge of the first face the walk arrived: 0 along the one leaving the corner, 1
    # along the one that ends there. Returns (face, corner, kind): kind 0 nothing, 1 into the face,
    # 2 along the half-edge that leaves the corner.
    vertices, faces, twins, areas, _ = triangles
    rates = field.rates
    given = field.potential is None
    arrival = _corner_angle(triangles, f, k) if came == 1 else 0.0
    around = _angle_around(triangles, f, k) if given else 0.0
    total = 0.0
    best = 0.0
    best_angle = 0.0
    best_face, best_corner, kind = -1, -1, 0
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
        away = _edge_away(field.potential, triangles, rates, g, c)
        if away > 0:
            merit = _straightness(total, arrival, around) if given else away / np.sqrt(uu)
            if merit > best:
                best, best_angle = merit, total
                best_face, best_corner, kind = g, c, 2
        r, s = rates[g, (c + 1) % 3], rates[g, (c + 2) % 3]
        if (r > 0 and s > 0) or (given and r >= 0 and s >= 0 and r + s > 0):
            x = r * np.sqrt(uu) + s * uw / np.sqrt(uu)
            y = s * 2 * areas[g] / np.sqrt(uu)
            direction = total + np.arctan2(y, x)
            if given:
                merit = _straightness(direction, arrival, around)
            else:
                merit = np.sqrt(r * r * uu + 2 * r * s * uw + s * s * ww)
            if merit > best:
                best, best_angle = merit, direction
                best_face, best_corner, kind = g, c, 1
        total += angle
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
    if given or 0.25 < turn < 0.75:
        return best_face, best_corner, kind
    return -1, -1, 0


@kernel
def _straightness(angle, arrival, around):
    # 1 straight on, above 0 elsewhere.
    return 1.5 - abs(2.0 * abs(angle - arrival) / around - 1.0)


@kernel
def _corner_angle(triangles, f, k):
    vertices, faces, _, areas, _ = triangles
    v, a, b = faces[f, k], faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
    uw = 0.0
    for x in range(3):
        uw += (vertices[a, x] - vertices[v, x]) * (vertices[b, x] - vertices[v, x])
    return np.arctan2(2 * areas[f], uw)


@kernel
def _angle_around(triangles, f, k):
    # The sum of the angles at the vertex of corner k, up to a border if it lies on one.
    total = 0.0
    g, c = f, k
    while True:
        total += _corner_angle(triangles, g, c)
        t = triangles.twins[g, (c + 2) % 3]
        if t < 0:
            return total
        g = t // 3
        c = t - 3 * g
        if g == f and c == k:
            return total


@kernel
def walk_exactly(
    start, stop, triangles, field, time, most_steps, point_faces, coordinates, unfinished
):
    """Walk from edge to edge; parameters as in `flow.trace`."""
    vertices, faces, twins, areas, _ = triangles
    rates, potential = field
    b = np.empty(3)
    for point in range(start, stop):
        f = point_faces[point]
        b[:] = coordinates[point]
        left = time
        if areas[f] == 0 or (rates[f, 0] == 0 and rates[f, 1] == 0):
            left = 0.0
        slide = -1  # the half-edge along which the walk slides
        last = np.inf
        rests = 0  # steps in a row that took no time
        steps = 0
        while left > 0:
            if steps == most_steps:
                unfinished[point] = True
                break
            steps += 1
            rests = rests + 1 if left == last else 0
            last = left
            if rests > _MOST_RESTS and potential is None:
                break  # around a vertex to which all faces flow
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
                # Both faces flow into the edge. The inner product of both flows, unfolded, times
                # the squared length of the edge, tells whether the shock flow turns back.
                sliding = _sliding(potential, triangles, rates, f, k)
                across = (rates[f, exit_corner] * areas[f]) * (inward * areas[g])
                turned = potential is not None and sliding * sliding - 4 * across <= 0
                if turned or sliding == 0:
                    b[k] = 1.0 - along
                    b[(k + 1) % 3] = along
                    break
                # fall through with `along` measured from corner k
            else:
                f = slide // 3
                k = slide - 3 * f
                along = 0.0
                sliding = _sliding(potential, triangles, rates, f, k)
            a, d = faces[f, k], faces[f, (k + 1) % 3]
            x = vertices[d, 0] - vertices[a, 0]
            y = vertices[d, 1] - vertices[a, 1]
            z = vertices[d, 2] - vertices[a, 2]
            rate = sliding / (x * x + y * y + z * z)
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
            g, c, kind = _leave_vertex(triangles, field, f, corner, came)
            if kind == 0:
                break
            f = g
            b[0] = b[1] = b[2] = 0.0
            b[c] = 1.0
            slide = 3 * f + c if kind == 2 else -1
        _put(point, f, b, point_faces, coordinates)


@kernel
def _put(point, f, b, point_faces, coordinates):
    point_faces[point] = f
    total = b[0] + b[1] + b[2]
    for c in range(3):
        coordinates[point, c] = b[c] / total


@kernel
def walk_literally(
    start, stop, triangles, field, time, step, most_steps, point_faces, coordinates, unfinished
):
    """Walk in steps of a given length; parameters as in `flow.trace`."""
    vertices, faces, twins, areas, normals = triangles
    rates, potential = field
    b = np.empty(3)
    v = np.empty(3)
    old = np.empty(3)
    r = np.empty(3)
    e = np.empty(3)
    for point in range(start, stop):
        f = point_faces[point]
        b[:] = coordinates[point]
        left = time if areas[f] > 0 else 0.0
        _flow_vector(vertices, faces, rates, f, v)
        old[:] = v
        steps = 0
        while left > 0:
            turn = v[0] * old[0] + v[1] * old[1] + v[2] * old[2]
            if potential is None:  # a given field may turn back, but not rest
                turn = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
            if not turn > 0:
                break
            steps += 1
            speed = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
            pace = min(left, step / speed)
            left -= pace
            old[:] = v
            f, ended, crossed = _go_straight(
                vertices, faces, twins, areas, normals, most_steps, pace, f, b, old, r, e
            )
            if crossed == most_steps or steps == most_steps:
                unfinished[point] = True
                break
            if ended:
                break
            _flow_vector(vertices, faces, rates, f, v)
        _put(point, f, b, point_faces, coordinates)


@kernel
def _go_straight(vertices, faces, twins, areas, normals, most_steps, pace, f, b, direction, r, e):
    # Go along a geodesic for some time, face by face, and turn `direction` with it. Returns the
    # face, whether it ended at a border, and the number of edges crossed; r and e are scratch.
    for crossed in range(most_steps):
        _coordinate_rates(vertices, faces, areas, normals, f, direction, r)
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
            return f, False, crossed
        b[exit_corner] = 0.0
        k = (exit_corner + 1) % 3
        t = twins[f, k]
        if t < 0 or areas[t // 3] == 0:
            return f, True, crossed
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
            tangent += e[x] * direction[x]
        # Outward in f is e x n(f); inward in g is e x n(g).
        outward = (
            (e[1] * normals[f, 2] - e[2] * normals[f, 1]) * direction[0]
            + (e[2] * normals[f, 0] - e[0] * normals[f, 2]) * direction[1]
            + (e[0] * normals[f, 1] - e[1] * normals[f, 0]) * direction[2]
        )
        direction[0] = tangent * e[0] + outward * (e[1] * normals[g, 2] - e[2] * normals[g, 1])
        direction[1] = tangent * e[1] + outward * (e[2] * normals[g, 0] - e[0] * normals[g, 2])
        direction[2] = tangent * e[2] + outward * (e[0] * normals[g, 1] - e[1] * normals[g, 0])
        share = b[(k + 1) % 3] / (b[k] + b[(k + 1) % 3])
        b[h] = share
        b[(h + 1) % 3] = 1.0 - share
        b[(h + 2) % 3] = 0.0
        f = g
    return f, False, most_steps


@kernel
def _flow_vector(vertices, faces, rates, f, v):
    for x in range(3):
        v[x] = 0.0
        for c in range(3):
            v[x] += rates[f, c] * vertices[faces[f, c], x]
