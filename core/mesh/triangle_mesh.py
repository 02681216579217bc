# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangle meshes: validation, connectivity and the unit of length.

A half-edge is numbered ``3 * face + k`` and runs from corner k of its face to corner
``(k + 1) % 3``; a corner has the number of the half-edge that leaves it.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import numpy.typing as npt

from ..base.parallel import Progress, kernel, run, run_in_order
from ..base.progress import ProgressCallback
from ..errors import InvalidMesh

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int32]


class TriangleMesh:
    """A triangle mesh with its connectivity.

    Any set of triangles is accepted: open borders, several components, loose vertices,
    zero-area faces, edges with three faces and more (they count as borders). Faces that are
    wound against their neighbours are turned, where the surface allows it: see `flipped`.

    Parameters
    ----------
    vertices : (n, 3) array of float
        Positions in any unit of length. Never modified.
    faces : (m, 3) array of int
        Vertex indices of each triangle. Never modified.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels. Only the constructor asks it.

    Attributes
    ----------
    vertices : (n, 3) float64
        The positions as given.
    faces : (m, 3) int32
        Vertex indices, consistently wound.
    flipped : (m,) bool
        True for faces that were turned against the input's winding.

    Raises
    ------
    InvalidMesh
        If the arrays have the wrong shape or type, are empty, hold NaN or infinity, or indices
        outside the vertices, or if all faces have zero area.
    Cancelled
        If `progress` returned False.
    """

    def __init__(
        self,
        vertices: npt.ArrayLike,
        faces: npt.ArrayLike,
        progress: Progress | ProgressCallback | None = None,
    ) -> None:
        phase = Progress.of(progress).part(0.0, 0.0, "Preparing the mesh")
        self.vertices = _checked_vertices(vertices)
        self.faces = _checked_faces(faces, len(self.vertices))
        phase.update(0.0)
        self.flipped = np.zeros(len(self.faces), dtype=bool)
        self.corners = self._corners(phase)
        low, high = self.box
        if not (high - low).max() < _LARGEST or 0 < (high - low).max() < 1 / _LARGEST:
            raise InvalidMesh(
                "The mesh is {size:.1g} units large; scale it to a size between {least:g} and"
                " {most:g}.",
                size=(high - low).max(),
                least=1 / _LARGEST,
                most=_LARGEST,
            )
        phase.update(0.0)
        if self._match_twins(phase):
            self._unify_winding(phase)
        phase.update(0.0)
        if self.mean_edge_length > 0:
            self._normals_and_areas = self._measured_faces(phase)
        if not self.mean_edge_length > 0 or not self.areas.any():
            raise InvalidMesh("All faces have zero area; give a mesh with a surface.")
        phase.update(0.0)

    @property
    def vertex_count(self) -> int:
        """Number of vertices, loose ones included."""
        return len(self.vertices)

    @property
    def face_count(self) -> int:
        """Number of triangles."""
        return len(self.faces)

    @cached_property
    def corners(self) -> tuple[Ints, Ints]:
        """Corners at each vertex: ``corners[start[v]:start[v + 1]]``; returns (start, corners)."""
        return self._corners(None)

    def _corners(self, progress: Progress | None) -> tuple[Ints, Ints]:
        return count_sort(self.faces.reshape(-1), self.vertex_count, progress)

    def _match_twins(self, progress: Progress = Progress(None)) -> bool:
        """Pair half-edges; True if some pairs run in the same direction (bad winding)."""
        self.twins: Ints = np.full((self.face_count, 3), -1, dtype=np.int32)
        same = np.zeros(1, dtype=np.int64)
        run(_pair, self.vertex_count, self.faces, *self.corners, self.twins.reshape(-1), same,
            progress=progress)  # fmt: skip
        return bool(same[0])

    def _unify_winding(self, progress: Progress = Progress(None)) -> None:
        # Pairs of equal direction are marked in twins as -2 - twin.
        _turn_faces(self.faces, self.twins.reshape(-1), self.flipped)
        progress.update(0.0)
        self.corners = self._corners(progress)
        self._match_twins(progress)
        self.twins[self.twins < -1] = -1  # what stays is not orientable: a border

    @cached_property
    def neighbours(self) -> tuple[Ints, Ints]:
        """One-ring neighbours: ``vertices[start[v]:start[v + 1]]``; returns (start, vertices).

        Around a vertex they follow its corners: the next vertex of each face, and the previous
        one where no face lies beyond.
        """
        return self._neighbours(None)

    @cached_property
    def neighbour_weights(self) -> npt.NDArray[np.float32]:
        """Gaussian weights exp(-length^2) of `neighbours`, lengths in mean edge lengths."""
        return self._neighbour_weights(None)

    def find_neighbours(self, progress: Progress | None) -> None:
        """Compute `neighbours`, which stay, asking whether to go on."""
        if "neighbours" not in self.__dict__:
            self.neighbours = self._neighbours(progress)

    def weigh_neighbours(self, progress: Progress | None) -> None:
        """Compute `neighbour_weights`, which stay, asking whether to go on."""
        self.find_neighbours(progress)
        if "neighbour_weights" not in self.__dict__:
            self.neighbour_weights = self._neighbour_weights(progress)

    def _neighbours(self, progress: Progress | None) -> tuple[Ints, Ints]:
        parts = self.faces, self.twins, *self.corners
        start = np.zeros(self.vertex_count + 1, dtype=np.int32)
        run(_count_ring, self.vertex_count, *parts, start, progress=progress)
        np.cumsum(start, out=start)
        ring = np.empty(start[-1], dtype=np.int32)
        run(_fill_ring, self.vertex_count, *parts, start, ring, progress=progress)
        return start, ring

    def _neighbour_weights(self, progress: Progress | None) -> npt.NDArray[np.float32]:
        start, ring = self.neighbours
        weights = np.empty(len(ring), dtype=np.float32)
        run(_weigh_ring, self.vertex_count, self.scaled_vertices, start, ring, weights,
            progress=progress)  # fmt: skip
        return weights

    @cached_property
    def mean_edge_length(self) -> float:
        """Mean length of the edges, each counted once, in the unit of `vertices`."""
        sums = np.zeros((-(-self.face_count // _SUM_CHUNK), 2))
        run(_sum_edges, self.face_count, self.vertices, self.faces, self.twins, sums,
            chunk=_SUM_CHUNK)  # fmt: skip
        length, count = sums.sum(axis=0)
        return float(length / count) if count else 0.0

    @cached_property
    def box(self) -> tuple[Floats, Floats]:
        """Lowest and highest coordinates of the vertices that have faces: (3,), (3,)."""
        chunks = -(-self.vertex_count // _SUM_CHUNK)
        lows, highs = np.full((chunks, 3), np.inf), np.full((chunks, 3), -np.inf)
        run(_bound, self.vertex_count, self.vertices, self.corners[0], lows, highs,
            chunk=_SUM_CHUNK)  # fmt: skip
        return lows.min(axis=0), highs.max(axis=0)

    @cached_property
    def scaled_vertices(self) -> Floats:
        """Positions from the bounding box's centre, in mean edge lengths: (n, 3)."""
        low, high = self.box
        scaled = self.vertices - (low + 0.5 * (high - low))
        scaled /= self.mean_edge_length
        return scaled

    @cached_property
    def _normals_and_areas(self) -> tuple[Floats, Floats]:
        return self._measured_faces(None)

    def _measured_faces(self, progress: Progress | None) -> tuple[Floats, Floats]:
        normals = np.empty((self.face_count, 3))
        areas = np.empty(self.face_count)
        run(_measure_faces, self.face_count, self.scaled_vertices, self.faces, normals, areas,
            progress=progress)  # fmt: skip
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
        """Exchange second and third corners (m, 3, ...) of turned faces, to `faces` or back.

        Where no face was turned, `corners` itself is returned.
        """
        if not self.flipped.any():
            return corners
        own = corners.copy()
        own[self.flipped, 1] = corners[self.flipped, 2]
        own[self.flipped, 2] = corners[self.flipped, 1]
        return own

    def displaced(self, displacement: Floats) -> TriangleMesh:
        """Return the mesh with its vertices moved by `displacement` (n, 3)."""
        moved = TriangleMesh.__new__(TriangleMesh)
        moved.vertices = self.vertices + displacement
        for name in ("faces", "flipped", "twins", "corners", "neighbours"):
            if name in self.__dict__:
                moved.__dict__[name] = self.__dict__[name]
        return moved


def count_sort(keys: Ints, count: int, progress: Progress | None = None) -> tuple[Ints, Ints]:
    """Sort indices by their keys, which are below `count`, stably; returns (start, order).

    The indices with key k are ``order[start[k]:start[k + 1]]``.
    """
    start = np.zeros(count + 1, dtype=np.int32)
    run_in_order(_count_keys, len(keys), keys, start, progress=progress)
    np.cumsum(start, out=start)
    order = np.empty(len(keys), dtype=np.int32)
    run_in_order(_place_keys, len(keys), keys, start[:-1].copy(), order, progress=progress)
    return start, order


def split_at_jumps(
    mesh: TriangleMesh, signal: Floats, progress: Progress | None = None
) -> tuple[TriangleMesh, Floats]:
    """Cut a mesh open where the values of a corner signal jump.

    Corners at one vertex that share a value stay one vertex; others become vertices of their
    own, so that edges between faces that disagree turn into borders.

    Parameters
    ----------
    mesh : TriangleMesh
    signal : (3 m, d) float64
        Values of the corners in the order of ``mesh.faces``.
    progress : Progress, optional

    Returns
    -------
    cut : TriangleMesh
        With the faces of `mesh`, in order, and possibly more vertices.
    values : (n', d) float64
        The values at its vertices.
    """
    phase = (progress or Progress(None)).part(0.0, 0.0, "Finding jumps")
    leaders = np.empty(3 * mesh.face_count, dtype=np.int32)
    run(_lead_corners, mesh.vertex_count, *mesh.corners, signal, leaders, progress=phase)
    leads = leaders == np.arange(len(leaders), dtype=np.int32)
    first = np.flatnonzero(leads)
    phase.update(0.0)
    index = (np.cumsum(leads, dtype=np.int32) - 1)[leaders]
    phase.update(0.0)
    vertices = mesh.vertices[mesh.faces.reshape(-1)[first]]
    values = signal[first]
    phase.update(0.0)
    return TriangleMesh(vertices, index.reshape(-1, 3), phase), values


def weld(
    vertices: npt.ArrayLike, progress: Progress | ProgressCallback | None = None
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Find vertices at exactly the same place.

    Files split vertices along UV seams; filtering such a mesh would open cracks. Filter
    ``vertices[representatives]`` with ``index[faces]`` instead, and take ``result[index]``.

    Parameters
    ----------
    vertices : (n, 3) array of float
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    representatives : (k,) int
        The first vertex at each place, in the order of the input.
    index : (n,) int
        The number in `representatives` that stands for each vertex.

    Raises
    ------
    InvalidMesh
        If `vertices` is not an (n, 3) array of finite numbers.
    Cancelled
        If `progress` returned False.
    """
    phase = Progress.of(progress).part(0.0, 0.0, "Finding vertices at the same place")
    points = _checked_vertices(vertices) + 0.0  # -0.0 and 0.0 are the same place
    bits = points.view(np.uint64)
    count, places = len(points), np.zeros(1, dtype=np.int64)
    table = np.full(1 << (2 * count - 1).bit_length(), -1, dtype=np.int64)
    first = np.empty(count, dtype=np.intp)
    index = np.empty(count, dtype=np.intp)
    run_in_order(_number_places, count, bits, table, places, first, index, progress=phase)
    return first[: places[0]].copy(), index


def weld_borders(
    vertices: npt.ArrayLike,
    faces: npt.ArrayLike,
    progress: Progress | ProgressCallback | None = None,
) -> Ints:
    """Join a surface that was split along seams, and only there.

    Vertices at exactly the same place become one if they lie on borders of the surface. Where
    sheets lie on each other, as the two sides of a leaf do, only their rims are joined.

    Parameters
    ----------
    vertices : (n, 3) array of float
    faces : (m, 3) array of int
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    (m, 3) int32
        The faces with other vertex indices: the first of those that are one.

    Raises
    ------
    InvalidMesh, Cancelled
        See `TriangleMesh`.
    """
    phase = Progress.of(progress)
    mesh = TriangleMesh(vertices, faces, phase)
    face, side = np.nonzero(mesh.twins < 0)
    on_border = np.zeros(mesh.vertex_count, dtype=bool)
    on_border[mesh.faces[face, side]] = True
    on_border[mesh.faces[face, (side + 1) % 3]] = True
    places = np.flatnonzero(on_border)
    index = np.arange(mesh.vertex_count, dtype=np.int32)
    if len(places):
        representatives, welded = weld(mesh.vertices[places], phase)
        index[places] = places[representatives[welded]]
    return index[np.asarray(faces)]


def _checked_vertices(vertices: npt.ArrayLike) -> Floats:
    try:
        given = np.asarray(vertices)
    except ValueError as error:  # rows of different lengths
        raise InvalidMesh("Vertices are not numbers; give an (n, 3) array of floats.") from error
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


_LARGEST = 1e100  # beyond, products of lengths leave the range of floats
_MOST_FACES = (2**31 - 1) // 3
_SUM_CHUNK = 1 << 15


@kernel
def _number_places(start, stop, bits, table, places, first, index):
    # The table holds the number of each place, at the first free slot from its hash on.
    last = np.uint64(table.shape[0] - 1)
    count = places[0]
    for v in range(start, stop):
        mixed = np.uint64(0)
        for axis in range(4):
            if axis < 3:
                mixed ^= bits[v, axis]
            mixed *= np.uint64(0x9E3779B97F4A7C15)
            mixed ^= mixed >> np.uint64(32)
        slot = mixed & last
        while True:
            place = table[slot]
            if place < 0:
                place = count
                table[slot] = place
                first[place] = v
                count += 1
                break
            w = first[place]
            if bits[w, 0] == bits[v, 0] and bits[w, 1] == bits[v, 1] and bits[w, 2] == bits[v, 2]:
                break
            slot = (slot + np.uint64(1)) & last
        index[v] = place
    places[0] = count


@kernel
def _count_keys(start, stop, keys, counts):
    for i in range(start, stop):
        counts[keys[i] + 1] += 1


@kernel
def _place_keys(start, stop, keys, cursors, order):
    for i in range(start, stop):
        k = keys[i]
        order[cursors[k]] = i
        cursors[k] += 1


@kernel
def _pair(start, stop, faces, corner_start, corners, twins, same):
    # Around each vertex v, collect the half-edges between v and vertices of higher number.
    size = 64
    far = np.empty(size, np.int32)
    half = np.empty(size, np.int32)
    for v in range(start, stop):
        first, last = corner_start[v], corner_start[v + 1]
        if 2 * (last - first) > size:
            size = 2 * (last - first)
            far = np.empty(size, np.int32)
            half = np.empty(size, np.int32)
        count = 0
        for i in range(first, last):
            f = corners[i] // 3
            k = corners[i] - 3 * f
            ahead = faces[f, (k + 1) % 3]
            behind = faces[f, (k + 2) % 3]
            if ahead == v or behind == v or ahead == behind:
                continue  # a face with a repeated vertex has no edges
            if ahead > v:
                far[count] = ahead
                half[count] = 3 * f + k
                count += 1
            if behind > v:
                far[count] = behind
                half[count] = 3 * f + (k + 2) % 3
                count += 1
        if count > 64:
            order = np.argsort(far[:count], kind="mergesort")
            far[:count] = far[:count][order]
            half[:count] = half[:count][order]
        else:
            for i in range(1, count):
                w, h = far[i], half[i]
                j = i - 1
                while j >= 0 and far[j] > w:
                    far[j + 1] = far[j]
                    half[j + 1] = half[j]
                    j -= 1
                far[j + 1] = w
                half[j + 1] = h
        i = 0
        while i < count:
            j = i + 1
            while j < count and far[j] == far[i]:
                j += 1
            if j - i == 2:  # one face: a border; more than two: not a surface there
                a, b = half[i], half[i + 1]
                if faces[a // 3, a % 3] != faces[b // 3, b % 3]:
                    twins[a] = b
                    twins[b] = a
                else:
                    twins[a] = -2 - b
                    twins[b] = -2 - a
                    same[0] = 1
            i = j


@kernel
def _turn_faces(faces, twins, flipped):
    # Flood each component from its lowest face; the majority keeps its winding.
    count = faces.shape[0]
    seen = np.zeros(count, np.bool_)
    queue = np.empty(count, np.int32)
    for seed in range(count):
        if seen[seed]:
            continue
        seen[seed] = True
        queue[0] = seed
        head, tail, turned = 0, 1, 0
        while head < tail:
            f = queue[head]
            head += 1
            for k in range(3):
                t = twins[3 * f + k]
                if t == -1:
                    continue
                against = t < -1
                if against:
                    t = -2 - t
                g = t // 3
                if not seen[g]:
                    seen[g] = True
                    flipped[g] = flipped[f] != against
                    turned += flipped[g]
                    queue[tail] = g
                    tail += 1
        if 2 * turned > tail:
            for i in range(tail):
                flipped[queue[i]] = not flipped[queue[i]]
    for f in range(count):
        if flipped[f]:
            faces[f, 1], faces[f, 2] = faces[f, 2], faces[f, 1]
    twins[:] = -1


@kernel
def _lead_corners(start, stop, corner_start, corners, signal, leaders):
    # The first corner at the same vertex with the same values leads.
    for v in range(start, stop):
        for i in range(corner_start[v], corner_start[v + 1]):
            corner = corners[i]
            leaders[corner] = corner
            for k in range(corner_start[v], i):
                other = corners[k]
                same = True
                for j in range(signal.shape[1]):
                    if signal[other, j] != signal[corner, j]:
                        same = False
                        break
                if same:
                    leaders[corner] = leaders[other]
                    break


@kernel
def _count_ring(start, stop, faces, twins, corner_start, corners, ring_start):
    for v in range(start, stop):
        count = 0
        for i in range(corner_start[v], corner_start[v + 1]):
            f = corners[i] // 3
            k = corners[i] - 3 * f
            count += 1
            if twins[f, (k + 2) % 3] < 0:
                count += 1
        ring_start[v + 1] = count


@kernel
def _fill_ring(start, stop, faces, twins, corner_start, corners, ring_start, ring):
    for v in range(start, stop):
        place = ring_start[v]
        for i in range(corner_start[v], corner_start[v + 1]):
            f = corners[i] // 3
            k = corners[i] - 3 * f
            ring[place] = faces[f, (k + 1) % 3]
            place += 1
            if twins[f, (k + 2) % 3] < 0:
                ring[place] = faces[f, (k + 2) % 3]
                place += 1


@kernel
def _weigh_ring(start, stop, vertices, ring_start, ring, weights):
    for v in range(start, stop):
        for i in range(ring_start[v], ring_start[v + 1]):
            w = ring[i]
            x = vertices[w, 0] - vertices[v, 0]
            y = vertices[w, 1] - vertices[v, 1]
            z = vertices[w, 2] - vertices[v, 2]
            weights[i] = np.exp(-(x * x + y * y + z * z))


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
            if twins[f, k] < 3 * f + k:  # borders are -1: each edge once
                a, b = faces[f, k], faces[f, (k + 1) % 3]
                x = vertices[b, 0] - vertices[a, 0]
                y = vertices[b, 1] - vertices[a, 1]
                z = vertices[b, 2] - vertices[a, 2]
                total += np.sqrt(x * x + y * y + z * z)
                count += 1
    sums[start // _SUM_CHUNK, 0] = total
    sums[start // _SUM_CHUNK, 1] = count


@kernel
def _measure_faces(start, stop, vertices, faces, normals, areas):
    for f in range(start, stop):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ux = vertices[b, 0] - vertices[a, 0]
        uy = vertices[b, 1] - vertices[a, 1]
        uz = vertices[b, 2] - vertices[a, 2]
        vx = vertices[c, 0] - vertices[a, 0]
        vy = vertices[c, 1] - vertices[a, 1]
        vz = vertices[c, 2] - vertices[a, 2]
        x = uy * vz - uz * vy
        y = uz * vx - ux * vz
        z = ux * vy - uy * vx
        double = np.sqrt(x * x + y * y + z * z)
        wx, wy, wz = vx - ux, vy - uy, vz - uz
        longest = max(
            ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, wx * wx + wy * wy + wz * wz
        )
        # Flatter than this, the direction of the normal is rounding noise.
        if double > 1e-10 * longest and double > 1e-14:
            normals[f, 0] = x / double
            normals[f, 1] = y / double
            normals[f, 2] = z / double
            areas[f] = 0.5 * double
        else:
            normals[f] = 0.0
            areas[f] = 0.0
