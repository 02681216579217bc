# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangle meshes: validation, connectivity and the unit of length.

Half-edges and corners are numbered as in `adjacency`.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import numpy.typing as npt

from ..base.checks import Floats, by_keyword
from ..base.parallel import kernel, run
from ..base.progress import ProgressCallback, aside, ask, reporting
from ..base.vectors import after, cross, dot, edge
from ..errors import InvalidMesh
from .adjacency import Ints, count_sort, rings, wound_twins

HUB = 100
"""Most faces around a vertex of ordinary meshes; up to this, no algorithm leaves any out."""


class TriangleMesh:
    """A triangle mesh with its connectivity.

    Any set of triangles is accepted: open borders, several components, loose vertices,
    zero-area faces, edges with three or more faces (they count as borders). Faces that are
    wound against their neighbours are flipped if the surface is orientable: see `flipped`.

    Parameters
    ----------
    vertices : (n, 3) array of float
        Positions in any unit of length. Never modified.
    faces : (m, 3) array of int
        Vertex indices of each triangle. Never modified.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels. Only the constructor calls it.

    Attributes
    ----------
    vertices : (n, 3) float64
        The positions, as passed in.
    faces : (m, 3) int32
        Vertex indices, consistently wound.
    flipped : (m,) bool
        True for faces whose winding was reversed.
    twins : (m, 3) int32
        The opposite half-edge of each half-edge, -1 at borders.
    corners : (n + 1,) int32, (3 m,) int32
        Corners at each vertex: ``corners[start[v]:start[v + 1]]``; as (start, corners).

    Raises
    ------
    InvalidMesh
        If the arrays have the wrong shape or type, are empty, hold NaN or infinity, or indices
        outside the vertices, or if all faces have zero area.
    Cancelled
        If `progress` returned False.

    Examples
    --------
    >>> from shock_filter import core
    >>> mesh = core.TriangleMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> mesh.vertex_count, mesh.face_count
    (3, 1)
    >>> mesh.normals.tolist()
    [[0.0, 0.0, 1.0]]
    """

    @by_keyword
    def __init__(
        self,
        vertices: npt.ArrayLike,
        faces: npt.ArrayLike,
        *,
        progress: ProgressCallback | None = None,
    ) -> None:
        with reporting(progress), aside(_PREPARING):
            self.vertices = checked_vertices(vertices)
            self.faces = _checked_faces(faces, len(self.vertices))
            ask()
            self.twins, self.flipped, self.corners = wound_twins(self.faces, self.vertex_count)
            self._check_size()
            if not self.mean_edge_length > 0 or not self.areas.any():
                raise InvalidMesh("All faces have zero area; give a mesh with a surface.")

    def _check_size(self) -> None:
        low, high = self.box
        if not (high - low).max() < _LARGEST or 0 < (high - low).max() < 1 / _LARGEST:
            raise InvalidMesh(
                "The mesh is {size:.1g} units large; scale it to a size between {least:g} and"
                " {most:g}.",
                size=(high - low).max(),
                least=1 / _LARGEST,
                most=_LARGEST,
            )

    @property
    def vertex_count(self) -> int:
        """Number of vertices, loose ones included."""
        return len(self.vertices)

    @property
    def face_count(self) -> int:
        """Number of triangles."""
        return len(self.faces)

    @cached_property
    def has_hubs(self) -> bool:
        """Whether more than `HUB` faces meet at some vertex.

        Around a hub, every face is near every other: an algorithm that visits all neighbours of a
        face or vertex must leave some out, or its work grows with the square of the hub's faces.
        """
        return bool(np.diff(self.corners[0]).max() > HUB)

    @cached_property
    def neighbours(self) -> tuple[Ints, Ints]:
        """One-ring neighbours: ``vertices[start[v]:start[v + 1]]``; returns (start, vertices).

        Around a vertex they follow the order of its corners: the next vertex of each face, and
        the previous one if the edge to it is a border.
        """
        with aside(_PREPARING):
            return rings(self.faces, self.twins, self.corners)

    @cached_property
    def neighbour_weights(self) -> npt.NDArray[np.float32]:
        """Gaussian weights exp(-length^2) of `neighbours`, lengths in mean edge lengths."""
        start, ring = self.neighbours
        weights = np.empty(len(ring), dtype=np.float32)
        with aside(_PREPARING):
            run(_weigh_ring, self.vertex_count, self.scaled_vertices, start, ring, weights)
        return weights

    @cached_property
    def mean_edge_length(self) -> float:
        """Mean length of the edges, each counted once, in the unit of `vertices`."""
        sums = np.zeros((-(-self.face_count // _SUM_CHUNK), 2))
        with aside(_PREPARING):
            run(_sum_edges, self.face_count, self.vertices, self.faces, self.twins, sums,
                chunk=_SUM_CHUNK)  # fmt: skip
        length, count = sums.sum(axis=0)
        return float(length / count) if count else 0.0

    @cached_property
    def box(self) -> tuple[Floats, Floats]:
        """Lowest and highest coordinates of the vertices that have faces: (3,), (3,)."""
        chunks = -(-self.vertex_count // _SUM_CHUNK)
        lows, highs = np.full((chunks, 3), np.inf), np.full((chunks, 3), -np.inf)
        with aside(_PREPARING):
            run(_bound, self.vertex_count, self.vertices, self.corners[0], lows, highs,
                chunk=_SUM_CHUNK)  # fmt: skip
        return lows.min(axis=0), highs.max(axis=0)

    @cached_property
    def scaled_vertices(self) -> Floats:
        """Positions relative to the bounding box's centre, in mean edge lengths: (n, 3)."""
        low, high = self.box
        scaled = self.vertices - (low + 0.5 * (high - low))
        scaled /= self.mean_edge_length
        return scaled

    @cached_property
    def _normals_and_areas(self) -> tuple[Floats, Floats]:
        normals = np.empty((self.face_count, 3))
        areas = np.empty(self.face_count)
        with aside(_PREPARING):
            run(_measure_faces, self.face_count, self.scaled_vertices, self.faces, normals, areas)
        return normals, areas

    @property
    def normals(self) -> Floats:
        """Unit normals of `faces`, zero for faces without area: (m, 3)."""
        return self._normals_and_areas[0]

    @property
    def areas(self) -> Floats:
        """Areas of the faces in squared mean edge lengths, exactly zero if degenerate: (m,)."""
        return self._normals_and_areas[1]

    def own_corners(self, corners: npt.NDArray) -> npt.NDArray:
        """Exchange the second and third corners (m, 3, ...) of flipped faces, to `faces` or back.

        If no face was flipped, `corners` itself is returned.
        """
        if not self.flipped.any():
            return corners
        own = corners.copy()
        own[self.flipped, 1] = corners[self.flipped, 2]
        own[self.flipped, 2] = corners[self.flipped, 1]
        return own

    def moved_to(self, positions: Floats) -> TriangleMesh:
        """Return the mesh with its vertices at other positions (n, 3).

        Raises
        ------
        InvalidMesh
            If a position is NaN or infinite, or the surface has shrunk to a point or a line.
        """
        check_finite(positions)
        moved = TriangleMesh.__new__(TriangleMesh)
        moved.vertices = positions
        for name in ("faces", "flipped", "twins", "corners", "neighbours"):
            if name in self.__dict__:
                moved.__dict__[name] = self.__dict__[name]
        moved._check_size()
        if not moved.mean_edge_length > 1e-9 * self.mean_edge_length or not moved.areas.any():
            raise InvalidMesh(
                "The mesh has shrunk to a point or a line; filter it fewer times, or less."
            )
        return moved


def part_of(mesh: TriangleMesh, chosen: npt.NDArray[np.intp]) -> tuple[TriangleMesh, Ints]:
    """Cut some faces out of a mesh, with its unit of length: the part, and its vertices' numbers.

    Parameters
    ----------
    mesh : TriangleMesh
    chosen : (k,) int
        The faces, in ascending order.
    """
    used = np.zeros(mesh.vertex_count, dtype=np.bool_)
    used[mesh.faces[chosen]] = True
    index = np.flatnonzero(used).astype(np.int32)
    number = np.empty(mesh.vertex_count, dtype=np.int32)
    number[index] = np.arange(len(index), dtype=np.int32)
    place = np.full(mesh.face_count, -1, dtype=np.int32)
    place[chosen] = np.arange(len(chosen), dtype=np.int32)
    twins = mesh.twins[chosen]
    other = place[twins // 3]
    part = TriangleMesh.__new__(TriangleMesh)
    part.vertices, part.faces = mesh.vertices[index], number[mesh.faces[chosen]]
    part.flipped = mesh.flipped[chosen]
    part.twins = np.where((twins >= 0) & (other >= 0), 3 * other + twins % 3, -1).astype(np.int32)
    part.corners = count_sort(part.faces.reshape(-1), len(index))
    part.__dict__.update(
        mean_edge_length=mesh.mean_edge_length,
        scaled_vertices=mesh.scaled_vertices[index],
        _normals_and_areas=(mesh.normals[chosen], mesh.areas[chosen]),
    )
    return part, index


def check_mesh(mesh: object) -> None:
    """Raise `InvalidMesh` unless `mesh` is a `TriangleMesh`."""
    if not isinstance(mesh, TriangleMesh):
        raise InvalidMesh(f"mesh is of type {type(mesh).__name__}; give a TriangleMesh.")


def checked_vertices(vertices: npt.ArrayLike) -> Floats:
    """Return an (n, 3) float64 copy, or raise `InvalidMesh`."""
    try:
        given = np.asarray(vertices)
    except ValueError as error:  # rows of different lengths
        raise InvalidMesh("Vertices are not numbers; give an (n, 3) array of floats.") from error
    if np.ma.is_masked(vertices):
        raise InvalidMesh("Vertices hold masked values; fill these first.")
    if given.dtype.kind not in "fiu":
        raise InvalidMesh(f"Vertices are of type {given.dtype}, not numbers; give floats.")
    array = np.array(given, dtype=np.float64, order="C")
    if array.ndim != 2 or array.shape[1] != 3:
        raise InvalidMesh(f"Vertices have the shape {array.shape}; give an (n, 3) array.")
    if len(array) == 0:
        raise InvalidMesh("The mesh has no vertices; give at least one triangle.")
    check_finite(array)
    return array


def check_finite(vertices: npt.NDArray) -> None:
    """Raise `InvalidMesh` with the number of the first vertex that is NaN or infinite."""
    if not np.isfinite(vertices).all():
        raise InvalidMesh(
            "Vertex {number} has no valid position (NaN or infinity); delete or move it.",
            number=int(np.argmin(np.isfinite(vertices).all(axis=1))),
        )


def _checked_faces(faces: npt.ArrayLike, vertex_count: int) -> Ints:
    try:
        array = np.asarray(faces)
    except ValueError as error:  # rows of different lengths
        raise InvalidMesh("Faces differ in length; triangulate to an (m, 3) array.") from error
    if array.size == 0:
        raise InvalidMesh("The mesh has no faces; give at least one triangle.")
    if array.ndim != 2 or array.shape[1] != 3:
        raise InvalidMesh(f"Faces have the shape {array.shape}; triangulate to an (m, 3) array.")
    if array.dtype.kind not in "iu":
        raise InvalidMesh(f"Faces are of type {array.dtype}; give vertex indices as integers.")
    if len(array) > _MOST_FACES:
        raise InvalidMesh(
            "The mesh has {count} faces; at most {most} are supported.",
            count=len(array),
            most=_MOST_FACES,
        )
    low, high = int(array.min()), int(array.max())
    if low < 0 or high >= vertex_count:
        raise InvalidMesh(
            f"Faces refer to the vertices {low} to {high}, but there are 0 to {vertex_count - 1};"
            " repair the indices."
        )
    return np.array(array, dtype=np.int32, order="C")


_PREPARING = "Preparing the mesh"
_LARGEST = 1e100  # beyond it, products of lengths overflow
_MOST_FACES = (2**31 - 1) // 3
_SUM_CHUNK = 1 << 15


@kernel
def _weigh_ring(start, stop, vertices, ring_start, ring, weights):
    for v in range(start, stop):
        for i in range(ring_start[v], ring_start[v + 1]):
            e = edge(vertices, v, ring[i])
            weights[i] = np.exp(-dot(e, e))


@kernel
def _bound(start, stop, vertices, corner_start, lows, highs):
    low = lows[start // _SUM_CHUNK]
    high = highs[start // _SUM_CHUNK]
    for v in range(start, stop):
        if corner_start[v] < corner_start[v + 1]:
            for x in range(3):
                low[x] = min(low[x], vertices[v, x])
                high[x] = max(high[x], vertices[v, x])


@kernel
def _sum_edges(start, stop, vertices, faces, twins, sums):
    total = 0.0
    count = 0
    for f in range(start, stop):
        for k in range(3):
            if twins[f, k] < 3 * f + k:  # each edge once; borders have the twin -1
                e = edge(vertices, faces[f, k], faces[f, after(k)])
                total += np.sqrt(dot(e, e))
                count += 1
    sums[start // _SUM_CHUNK, 0] = total
    sums[start // _SUM_CHUNK, 1] = count


@kernel
def _measure_faces(start, stop, vertices, faces, normals, areas):
    for f in range(start, stop):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        u, v = edge(vertices, a, b), edge(vertices, a, c)
        w = v[0] - u[0], v[1] - u[1], v[2] - u[2]
        n = cross(u, v)
        double = np.sqrt(dot(n, n))
        longest = max(dot(u, u), dot(v, v), dot(w, w))
        # If the face is flatter, the direction of its normal is rounding noise.
        if double > 1e-10 * longest and double > 1e-14:
            for x in range(3):
                normals[f, x] = n[x] / double
            areas[f] = 0.5 * double
        else:
            normals[f] = 0.0
            areas[f] = 0.0
