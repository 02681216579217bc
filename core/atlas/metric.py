# SPDX-License-Identifier: GPL-3.0-or-later
"""The metric of the surface under the texels, and its geodesic exponential map.

Each face has its own frame: corner 0 is the origin and the edge to corner 1 the first axis.
Lengths are in mean texel sizes on the surface.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..base.progress import ask
from ..base.vectors import after
from ..errors import InvalidUV
from ..mesh.triangle_mesh import Floats, Ints, TriangleMesh
from .charts import Charts, degenerate_faces

_SLIVER = 1e-6
"""Faces have no area if it is at most this share of their squared longest side: vertices are stored
with 24 bits.
"""

MOST_FACES = 4000
"""Most faces that a geodesic crosses. It would cross more only where texels are far larger than
faces, as around a vertex of very many faces. There it ends early, within a few texels.
"""


class Ways(NamedTuple):
    """The connections between faces, across which the surface continues.

    Attributes
    ----------
    twins : (m, 3) int32
        The opposite half-edges, or -1.
    starts : (3 m + 1,) int32
        The first part of each half-edge, and the number of parts. Seams are cut into parts of
        equal length; other half-edges have none.
    closed : (parts,) bool
        Parts at which the texture treats the surface as ending.
    """

    twins: Ints
    starts: Ints
    closed: npt.NDArray[np.bool_]


class AtlasMetric(NamedTuple):
    """The geometry of the faces in space, measured in texels.

    Attributes
    ----------
    ways : Ways
        Where the surface continues: everywhere but at borders, unless seams were closed.
    shapes : (m, 3) float64
        In the face's frame: corner 1 is (shapes[0], 0), corner 2 (shapes[1], shapes[2]).
    jacobians : (m, 2, 2) float64
        Map steps in (row, column) to steps in the face's frame; zero for faces without area in
        the texture or in space.
    inverse_jacobians : (m, 2, 2) float64
        Map steps in the face's frame to steps in (row, column); zero where the Jacobian is.
    inverse_metrics : (m, 3) float32
        The inverse h^-1 of the metric h = J^T J: entries 11, 12 and 22, axis 1 the rows.
    texel_areas : (m,) float32
        The area of a texel on the surface, the square root of det h.
    neighbour_weights : (m, 2) float32
        The Gaussian umbrella's weights of the next nodes down and up, and of those to the right
        and left.
    texel_size : float
        The mean length of a texel on the surface, in the unit of the mesh.
    """

    ways: Ways
    shapes: Floats
    jacobians: Floats
    inverse_jacobians: Floats
    inverse_metrics: npt.NDArray[np.float32]
    texel_areas: npt.NDArray[np.float32]
    neighbour_weights: npt.NDArray[np.float32]
    texel_size: float


def measure_metric(mesh: TriangleMesh, charts: Charts, points: Floats) -> AtlasMetric:
    """Measure the faces, whose corners lie at `points` in the sheet."""
    areas = np.where(_slivers(mesh), 0.0, mesh.areas)
    seen = ~degenerate_faces(charts) & (areas > 0)
    area = mesh.areas[seen].sum()
    if not area > 0:
        raise InvalidUV(
            "No face has an area both in space and in the texture; unwrap the mesh again."
        )
    size = float(np.sqrt(area / np.abs(charts.areas[seen]).sum()))  # in mean edge lengths
    count = mesh.face_count
    metric = AtlasMetric(
        Ways(mesh.twins, np.zeros(3 * count + 1, dtype=np.int32), np.zeros(0, dtype=np.bool_)),
        np.zeros((count, 3)),
        np.zeros((count, 2, 2)),
        np.zeros((count, 2, 2)),
        np.zeros((count, 3), dtype=np.float32),
        np.zeros(count, dtype=np.float32),
        np.full((count, 2), np.exp(-1.0), dtype=np.float32),
        size * mesh.mean_edge_length,
    )
    run(_measure, count, mesh.scaled_vertices, mesh.faces, areas, seen, points, 1.0 / size,
        metric)  # fmt: skip
    return metric


def _slivers(mesh: TriangleMesh) -> npt.NDArray[np.bool_]:
    # Faces whose corners lie on a line up to rounding, as where polygons have points on straight
    # borders: their measurements would be noise, and have more weight than all others.
    longest = np.zeros(mesh.face_count)
    for k in range(3):
        ask()
        sides = mesh.scaled_vertices[mesh.faces[:, k]] - mesh.scaled_vertices[mesh.faces[:, k - 1]]
        np.maximum(longest, (sides**2).sum(axis=1), out=longest)
    return mesh.areas <= _SLIVER * longest


@kernel
def _measure(start, stop, vertices, faces, areas, seen, points, scale, metric):
    shapes = metric.shapes
    for f in range(start, stop):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        uu = 0.0
        uv = 0.0
        for x in range(3):
            u = scale * (vertices[b, x] - vertices[a, x])
            v = scale * (vertices[c, x] - vertices[a, x])
            uu += u * u
            uv += u * v
        if areas[f] == 0 or uu == 0:
            continue
        along = np.sqrt(uu)
        shapes[f, 0] = along
        shapes[f, 1] = uv / along
        shapes[f, 2] = 2.0 * areas[f] * scale * scale / along
        if not seen[f]:
            continue
        py = points[f, 1, 0] - points[f, 0, 0]
        px = points[f, 1, 1] - points[f, 0, 1]
        qy = points[f, 2, 0] - points[f, 0, 0]
        qx = points[f, 2, 1] - points[f, 0, 1]
        det = py * qx - px * qy
        # The columns of J: the frame's steps for one row and for one column.
        ay = (qx * shapes[f, 0] - px * shapes[f, 1]) / det
        by = -px * shapes[f, 2] / det
        ax = (py * shapes[f, 1] - qy * shapes[f, 0]) / det
        bx = py * shapes[f, 2] / det
        store(metric.jacobians[f], ay, ax, by, bx)
        det_j = ay * bx - ax * by
        store(metric.inverse_jacobians[f], bx / det_j, -ax / det_j, -by / det_j, ay / det_j)
        rr = ay * ay + by * by
        rc = ay * ax + by * bx
        cc = ax * ax + bx * bx
        det_h = det_j * det_j
        metric.inverse_metrics[f, 0] = min(cc / det_h, 1e15)
        metric.inverse_metrics[f, 1] = min(max(-rc / det_h, -1e15), 1e15)
        metric.inverse_metrics[f, 2] = min(rr / det_h, 1e15)
        metric.texel_areas[f] = abs(det_j)
        metric.neighbour_weights[f, 0] = np.exp(-rr)
        metric.neighbour_weights[f, 1] = np.exp(-cc)


@kernel
def store(matrix, a, b, c, d):
    """Set a matrix of two rows to (a, b) and (c, d)."""
    matrix[0, 0] = a
    matrix[0, 1] = b
    matrix[1, 0] = c
    matrix[1, 1] = d


@kernel
def apply(matrices, f, x, y):
    """Multiply matrix `f` of (m, 2, 2) with (x, y)."""
    return (
        matrices[f, 0, 0] * x + matrices[f, 0, 1] * y,
        matrices[f, 1, 0] * x + matrices[f, 1, 1] * y,
    )


@kernel
def _corner(shapes, f, k):
    # A corner of a face in its frame.
    if k == 0:
        return 0.0, 0.0
    if k == 1:
        return shapes[f, 0], 0.0
    return shapes[f, 1], shapes[f, 2]


@kernel
def frame_axis(shapes, f, k):
    """Unit vector along half-edge k of a face, in its frame; the face lies on its left."""
    ax, ay = _corner(shapes, f, k)
    bx, by = _corner(shapes, f, after(k))
    length = np.sqrt((bx - ax) ** 2 + (by - ay) ** 2)
    return (bx - ax) / length, (by - ay) / length


@kernel
def is_closed(ways, edge, share):
    """Whether a place on a half-edge is closed: the surface ends there despite an other side."""
    start = ways.starts[edge]
    count = ways.starts[edge + 1] - start
    return count > 0 and ways.closed[start + min(int(share * count), count - 1)]


def open_places(ways: Ways, edges: Ints, shares: Floats) -> npt.NDArray[np.bool_]:
    """Whether places on half-edges are not closed."""
    start, end = ways.starts[edges], ways.starts[edges + 1]
    is_open = start == end
    has = ~is_open
    count = (end - start)[has]
    part = np.minimum((shares[has] * count).astype(np.int64), count - 1)
    is_open[has] = ~ways.closed[start[has] + part]
    return is_open


@kernel
def exponential_map(ways, shapes, jacobians, edge, share, dy, dx, b):
    """Walk straight on the surface, from a half-edge to a target (geodesic exponential map).

    Each face on the way is unfolded into the plane of the previous one.

    Parameters
    ----------
    ways : Ways
    edge : int
        The half-edge that is crossed first.
    share : float
        The position on it, from its first corner.
    dy, dx : float
        Direction and length of the walk, as a step in the texels of the half-edge's face.
    b : (3,) float64
        Barycentric coordinates of the end; overwritten.

    Returns
    -------
    face : int
        Where the walk ends, or -1 if it cannot begin. At a border or a closed place, and after
        `MOST_FACES`, it ends early.
    cosine, sine : float
        Parallel transport along the walk: the rotation from components in the frame of the
        half-edge's face to components in the frame of `face`.
    """
    f, k = divmod(edge, 3)
    if shapes[f, 2] == 0:
        return -1, 1.0, 0.0
    u, v = apply(jacobians, f, dy, dx)
    cosine, sine = 1.0, 0.0
    share = min(max(share, 1e-6), 1.0 - 1e-6)
    left = 1.0
    for _ in range(MOST_FACES):
        t = ways.twins[f, k]
        g, j = divmod(t, 3)
        if t < 0 or shapes[g, 2] == 0 or is_closed(ways, 3 * f + k, share):
            if left == 1.0:
                return -1, cosine, sine
            break
        # Unfold: the twin runs in the opposite direction.
        px, py = frame_axis(shapes, f, k)
        qx, qy = frame_axis(shapes, g, j)
        c = -(px * qx + py * qy)
        s = -(px * qy - py * qx)
        u, v = c * u - s * v, s * u + c * v
        cosine, sine = c * cosine - s * sine, s * cosine + c * sine
        f = g
        b[j] = share
        b[after(j)] = 1.0 - share
        far = after(after(j))
        b[far] = 0.0
        # Straight to the side that is reached first.
        rate2 = v / shapes[f, 2]
        rate1 = (u - shapes[f, 1] * rate2) / shapes[f, 0]
        rates = -rate1 - rate2, rate1, rate2
        leaving = -1
        first = left
        for side in range(3):
            if side != far and rates[side] < 0 and b[side] / -rates[side] < first:
                first = b[side] / -rates[side]
                leaving = side
        for side in range(3):
            b[side] = max(b[side] + rates[side] * first, 0.0)
        total = b[0] + b[1] + b[2]
        for side in range(3):
            b[side] /= total
        left -= first
        if leaving < 0:
            break
        b[leaving] = 0.0
        k = after(leaving)
        share = b[after(k)]
    return f, cosine, sine
