# SPDX-License-Identifier: GPL-3.0-or-later
"""Calculus on triangle meshes: gradient, cotangent stiffness, averages, smoothing.

All lengths are in mean edge lengths of the mesh (`TriangleMesh.scaled_vertices`). Faces without
area have zero gradients, weights and stiffness.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.checks import checked_signal
from ..base.memo import kept
from ..base.parallel import kernel, run
from ..base.progress import aside, ask, phase
from ..base.vectors import after, cross, dot, edge
from .adjacency import within_rings
from .triangle_mesh import Floats, Ints, TriangleMesh

_MOSTLY = 0.25
"""Smoothing computes only the vertices around values other than 0 if a sample of the values has no
greater share of these."""

_STRIDE = 61
"""The sample contains one vertex in this many."""


def gradient(mesh: TriangleMesh, signal: npt.ArrayLike) -> Floats:
    """Compute the gradient of the linear interpolant in each face (paper A, Appendix A).

    Parameters
    ----------
    mesh : TriangleMesh
    signal : (n,) or (n, d) array of float
        Values at the vertices.

    Returns
    -------
    (m, d, 3) float64
        Tangent vectors, per mean edge length; zero in faces without area.

    Raises
    ------
    InvalidSignal
        If the signal does not fit the mesh or is not finite.
    """
    values = checked_signal(signal, mesh.vertex_count, largest=np.inf)
    out = np.zeros((mesh.face_count, values.shape[1], 3))
    run(_gradient, mesh.face_count, mesh.scaled_vertices, mesh.faces, mesh.normals, mesh.areas,
        values, out)  # fmt: skip
    return out


def cotangents(mesh: TriangleMesh) -> Floats:
    """Half the cotangent of the angle opposite each half-edge: (m, 3), zero if degenerate.

    Needle-like faces (cotangents above 1000, angles below 0.06 degrees) are scaled down as a whole
    to that bound, which keeps the stiffness positive and linear solves possible.
    """
    return cotangents_of(mesh.scaled_vertices, mesh.faces, mesh.areas)


def cotangents_of(vertices: Floats, faces: Ints, areas: Floats) -> Floats:
    """The `cotangents` of any faces, given their areas: (k, 3)."""
    out = np.empty((len(faces), 3))
    run(_cotangents, len(faces), vertices, faces, areas, out)
    return out


def lumped_mass(mesh: TriangleMesh) -> Floats:
    """A third of the area around each vertex, in squared mean edge lengths: (n,)."""
    out = np.empty(mesh.vertex_count)
    run(_mass, mesh.vertex_count, *mesh.corners, mesh.areas, out)
    return out


def stiffness_weights(
    mesh: TriangleMesh, halves: Floats, screen: Floats
) -> tuple[Ints, Ints, Floats, Floats]:
    """Assemble the cotangent stiffness plus `screen` on the diagonal, row by row.

    Parameters
    ----------
    mesh : TriangleMesh
    halves : (m, 3) float64
        The `cotangents` of the mesh.
    screen : (n,) float64

    Returns
    -------
    start, columns : (n + 1,) int32, (k,) int32
        ``mesh.neighbours``.
    weights : (k,) float64
        One per neighbour, symmetric: the matrix entry, negated.
    diagonal : (n,) float64
    """
    start, columns = mesh.neighbours
    weights, diagonal = np.empty(len(columns)), np.empty(mesh.vertex_count)
    run(_assemble, mesh.vertex_count, *mesh.corners, mesh.twins, halves, screen, start, weights,
        diagonal)  # fmt: skip
    return start, columns, weights, diagonal


def average_to_vertices(mesh: TriangleMesh, values: Floats) -> Floats:
    """Area-weighted averages of face values at the vertices: (m, d) -> (n, d).

    Vertices without area get zeros.
    """
    out = np.empty((mesh.vertex_count, values.shape[1]))
    start, corners = mesh.corners
    corners = corners.view(np.uint32)  # spares a test for negative indices in each access
    run(_average, mesh.vertex_count, start, corners, mesh.areas, values, out)
    return out


def mean_normals(mesh: TriangleMesh) -> Floats:
    """Area-weighted averages of the face normals at the vertices: (n, 3). Do not modify them."""
    return kept(mesh, "mean normals", (), lambda: average_to_vertices(mesh, mesh.normals))


def average_to_faces(mesh: TriangleMesh, values: Floats) -> Floats:
    """Means of the three vertex values of each face: (n, d) -> (m, d)."""
    out = np.empty((mesh.face_count, values.shape[1]))
    run(_average_corners, mesh.face_count, mesh.faces, values, out)
    return out


def greatest_to_faces(mesh: TriangleMesh, values: npt.NDArray) -> npt.NDArray:
    """The greatest of the three vertex values of each face, of any number type: (n,) -> (m,)."""
    out = np.empty(mesh.face_count, dtype=values.dtype)
    run(_greatest_corner, mesh.face_count, mesh.faces, values, out)
    return out


def corners_of(mesh: TriangleMesh, chosen: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Mark the vertices of marked faces: (m,) -> (n,)."""
    marked = np.zeros(mesh.vertex_count, dtype=np.bool_)
    marked[mesh.faces[chosen]] = True
    return marked


def faces_touching(mesh: TriangleMesh, chosen: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Mark the faces with a marked vertex: (n,) -> (m,)."""
    return greatest_to_faces(mesh, chosen.view(np.uint8)).view(np.bool_)


def greatest_to_vertices(mesh: TriangleMesh, values: npt.NDArray) -> npt.NDArray:
    """The greatest of the faces around each vertex, not below 0: (m,) -> (n,)."""
    out = np.empty(mesh.vertex_count, dtype=values.dtype)
    run(_greatest_around, mesh.vertex_count, *mesh.corners, values, out)
    return out


def cosines(one: Floats, other: Floats) -> Floats:
    """Inner products of two vectors per face: (m, 3) -> (m,)."""
    out = np.empty(len(one))
    run(_cosines, len(one), one, other, out)
    return out


def blended_normals(mesh: TriangleMesh, old: Floats, new: Floats, weights: Floats) -> Floats:
    """Blend face normals by vertex weights (n,); blends of opposite normals may become zero."""
    out = np.empty_like(old)
    run(_blend, mesh.face_count, mesh.faces, old, new, weights, out)
    return out


def group_means(groups: npt.NDArray[np.integer], rows: npt.NDArray, out: npt.NDArray) -> None:
    """Write the mean of each group's rows to `out`; rows of `out` without a group stay.

    Parameters
    ----------
    groups : (k,) int
        The row of `out` that each row contributes to.
    rows : (k, d) array of float
    out : (n, d) array of float
    """
    sizes = np.bincount(groups, minlength=len(out))
    some = sizes > 0
    for column in range(out.shape[1]):
        ask()
        sums = np.bincount(groups, rows[:, column], len(out))
        out[some, column] = sums[some] / sizes[some]


def smooth_vertices(mesh: TriangleMesh, signal: Floats, passes: int) -> Floats:
    """Umbrella smoothing with Gaussian weights (paper A, Appendix A, "Smoothing").

    Parameters
    ----------
    mesh : TriangleMesh
    signal : (n, d) float64
    passes : int
        With 0 the signal itself is returned.
    """
    if passes == 0:
        return signal
    with aside("Smoothing"):
        weights = mesh.neighbour_weights
    start, ring = mesh.neighbours
    rows = _rows_to_smooth(mesh, signal, passes)
    ring = ring.view(np.uint32)  # see `average_to_vertices`
    spare = None
    for done in range(passes):
        out = spare
        if out is None:
            out = np.empty_like(signal) if rows is None else np.zeros_like(signal)
        with phase(done / passes, (done + 1) / passes, "Smoothing"):
            if rows is None:
                run(_umbrella, mesh.vertex_count, start, ring, weights, signal, out)
            else:
                run(_umbrella_at, len(rows), rows, start, ring, weights, signal, out)
        spare = signal if done else None  # the caller's array is never written to
        signal = out
    return signal


def _rows_to_smooth(mesh: TriangleMesh, signal: Floats, passes: int) -> Ints | None:
    # The vertices where a signal that is mostly 0 can become other than 0; None if it is not.
    sample = signal[::_STRIDE]
    if np.count_nonzero(sample) > _MOSTLY * sample.size:
        return None
    ask()
    other = within_rings(mesh.neighbours, nonzero_rows(signal), passes)
    return np.flatnonzero(other).astype(np.int32)


def nonzero_rows(values: npt.NDArray) -> npt.NDArray[np.bool_]:
    """Tell which rows have a value other than 0: (n, d) -> (n,)."""
    found = values[:, 0] != 0
    for column in values.T[1:]:  # several times faster than `any` along the rows
        found |= column != 0
    return found


@kernel
def _greatest_around(start, stop, corner_start, corners, values, out):
    for v in range(start, stop):
        out[v] = 0
        for i in range(corner_start[v], corner_start[v + 1]):
            out[v] = max(out[v], values[corners[i] // 3])


@kernel
def _cosines(start, stop, one, other, out):
    for f in range(start, stop):
        out[f] = dot(one[f], other[f])


@kernel
def _gradient(start, stop, vertices, faces, normals, areas, values, out):
    for f in range(start, stop):
        if areas[f] == 0:
            continue
        scale = 0.5 / areas[f]
        for k in range(3):
            v, a, b = faces[f, k], faces[f, after(k)], faces[f, after(after(k))]
            x, y, z = cross(normals[f], edge(vertices, a, b))
            x, y, z = x * scale, y * scale, z * scale
            for j in range(values.shape[1]):
                out[f, j, 0] += values[v, j] * x
                out[f, j, 1] += values[v, j] * y
                out[f, j, 2] += values[v, j] * z


@kernel
def _cotangents(start, stop, vertices, faces, areas, out):
    for f in range(start, stop):
        if areas[f] == 0:
            out[f] = 0.0
            continue
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        u, v, w = edge(vertices, a, b), edge(vertices, b, c), edge(vertices, c, a)
        out[f, 0] = -0.25 * dot(v, w) / areas[f]
        out[f, 1] = -0.25 * dot(w, u) / areas[f]
        out[f, 2] = -0.25 * dot(u, v) / areas[f]
        share = needle_share(u, v, w, areas[f])
        if share < 1:
            for k in range(3):
                out[f, k] *= share


@kernel
def needle_share(u, v, w, area):
    """The weight of a face with these edges and this area: 1, less for needle-like ones."""
    largest = 0.25 * max(abs(dot(u, v)), abs(dot(v, w)), abs(dot(w, u))) / area
    return 500.0 / largest if largest > 500.0 else 1.0


@kernel
def _assemble(
    start, stop, corner_start, corners, twins, cots, screen, ring_start, weights, diagonal
):
    # Entries follow the corners, as in TriangleMesh.neighbours.
    for v in range(start, stop):
        place = ring_start[v]
        total = screen[v]
        for i in range(corner_start[v], corner_start[v + 1]):
            f = corners[i] // 3
            k = corners[i] - 3 * f
            weight = cots[f, k]
            t = twins[f, k]
            if t >= 0:
                weight += cots[t // 3, t % 3]
            weights[place] = weight
            total += weight
            place += 1
            back = after(after(k))
            if twins[f, back] < 0:
                weights[place] = cots[f, back]
                total += cots[f, back]
                place += 1
        diagonal[v] = total


@kernel
def _average(start, stop, corner_start, corners, areas, values, out):
    # Three channels or one at a time, with their sums in registers.
    count, sides = values.shape[1], np.uint32(3)
    for v in range(start, stop):
        begin, end = corner_start[v], corner_start[v + 1]
        j = 0
        while j + 3 <= count:
            a = b = c = total = 0.0
            for i in range(begin, end):
                f = corners[i] // sides
                area = areas[f]
                total += area
                a += area * values[f, j]
                b += area * values[f, j + 1]
                c += area * values[f, j + 2]
            if total > 0:
                a, b, c = a / total, b / total, c / total
            out[v, j], out[v, j + 1], out[v, j + 2] = a, b, c
            j += 3
        while j < count:
            a = total = 0.0
            for i in range(begin, end):
                f = corners[i] // sides
                total += areas[f]
                a += areas[f] * values[f, j]
            out[v, j] = a / total if total > 0 else a
            j += 1


@kernel
def _mass(start, stop, corner_start, corners, areas, out):
    for v in range(start, stop):
        total = 0.0
        for i in range(corner_start[v], corner_start[v + 1]):
            total += areas[corners[i] // 3]
        out[v] = total / 3


@kernel
def _average_corners(start, stop, faces, values, out):
    for f in range(start, stop):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        for j in range(values.shape[1]):
            out[f, j] = (values[a, j] + values[b, j] + values[c, j]) / 3.0


@kernel
def _greatest_corner(start, stop, faces, values, out):
    for f in range(start, stop):
        out[f] = max(values[faces[f, 0]], values[faces[f, 1]], values[faces[f, 2]])


@kernel
def _blend(start, stop, faces, old, new, weights, out):
    for f in range(start, stop):
        share = (weights[faces[f, 0]] + weights[faces[f, 1]] + weights[faces[f, 2]]) / 3.0
        for x in range(3):
            out[f, x] = old[f, x] + share * (new[f, x] - old[f, x])
        make_unit(out[f])


def unit_vectors(vectors: Floats, least: float = 1e-12) -> Floats:
    """Divide vectors (..., 3) by their lengths; those no longer than `least` become zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > least, length, np.inf)


@kernel
def make_unit(vector):
    """Normalize a vector in place; a vector of zero length becomes zero."""
    length = np.sqrt(dot(vector, vector))
    if not length > 1e-12:
        length = np.inf
    for x in range(3):
        vector[x] /= length


@kernel
def make_unit_or(vector, old):
    """Normalize a vector in place; it becomes `old` if either has zero length."""
    length = np.sqrt(dot(vector, vector))
    if not length > 1e-12 or (old[0] == 0 and old[1] == 0 and old[2] == 0):
        vector[:] = old
    else:
        for x in range(3):
            vector[x] /= length


@kernel
def _umbrella_at(start, stop, rows, ring_start, ring, weights, values, out):
    for row in range(start, stop):
        _umbrella(rows[row], rows[row] + 1, ring_start, ring, weights, values, out)


@kernel
def _umbrella(start, stop, ring_start, ring, weights, values, out):
    # Six, three or one channels at a time, with their sums in registers.
    count = values.shape[1]
    for v in range(start, stop):
        begin, end = ring_start[v], ring_start[v + 1]
        j = 0
        while j + 6 <= count:
            a, b, c = values[v, j], values[v, j + 1], values[v, j + 2]
            d, e, f = values[v, j + 3], values[v, j + 4], values[v, j + 5]
            total = 1.0
            for i in range(begin, end):
                u, weight = ring[i], weights[i]
                total += weight
                a += weight * values[u, j]
                b += weight * values[u, j + 1]
                c += weight * values[u, j + 2]
                d += weight * values[u, j + 3]
                e += weight * values[u, j + 4]
                f += weight * values[u, j + 5]
            out[v, j], out[v, j + 1], out[v, j + 2] = a / total, b / total, c / total
            out[v, j + 3], out[v, j + 4], out[v, j + 5] = d / total, e / total, f / total
            j += 6
        while j + 3 <= count:
            a, b, c = values[v, j], values[v, j + 1], values[v, j + 2]
            total = 1.0
            for i in range(begin, end):
                u, weight = ring[i], weights[i]
                total += weight
                a += weight * values[u, j]
                b += weight * values[u, j + 1]
                c += weight * values[u, j + 2]
            out[v, j], out[v, j + 1], out[v, j + 2] = a / total, b / total, c / total
            j += 3
        while j < count:
            a, total = values[v, j], 1.0
            for i in range(begin, end):
                total += weights[i]
                a += weights[i] * values[ring[i], j]
            out[v, j] = a / total
            j += 1
