# SPDX-License-Identifier: GPL-3.0-or-later
"""Welding: join vertices at the same place; and cut a mesh open where a signal jumps."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.checks import by_keyword
from ..base.parallel import kernel, run, run_in_order
from ..base.progress import ProgressCallback, aside, ask, reporting
from .adjacency import Ints
from .triangle_mesh import HUB, Floats, TriangleMesh, checked_vertices


@by_keyword
def weld(
    vertices: npt.ArrayLike, *, progress: ProgressCallback | None = None
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Find vertices at exactly the same position.

    Files split vertices along UV seams, where filtering would open cracks. Filter
    ``vertices[representatives]`` with ``index[faces]`` instead, and take ``result[index]``.

    Parameters
    ----------
    vertices : (n, 3) array of float
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    representatives : (k,) int
        The first vertex at each position, in the order of the input.
    index : (n,) int
        The index into `representatives` of each vertex.

    Raises
    ------
    InvalidMesh
        If `vertices` is not an (n, 3) array of finite numbers.
    Cancelled
        If `progress` returned False.

    Examples
    --------
    >>> from shock_filter import core
    >>> core.weld([[0, 0, 0], [1, 0, 0], [0, 0, 0]])
    (array([0, 1]), array([0, 1, 0]))
    """
    points = checked_vertices(vertices) + 0.0  # -0.0 and 0.0 are the same place
    bits = points.view(np.uint64)
    count, places = len(points), np.zeros(1, dtype=np.int64)
    table = np.full(1 << (2 * count - 1).bit_length(), -1, dtype=np.int64)
    first = np.empty(count, dtype=np.intp)
    index = np.empty(count, dtype=np.intp)
    with reporting(progress), aside("Finding vertices at the same place"):
        run_in_order(_number_places, count, bits, table, places, first, index)
    return first[: places[0]].copy(), index


@by_keyword
def weld_borders(
    vertices: npt.ArrayLike,
    faces: npt.ArrayLike,
    *,
    progress: ProgressCallback | None = None,
) -> Ints:
    """Join a surface along the seams where it was split, and nowhere else.

    Vertices at exactly the same position are merged if they lie on borders of the surface. Of
    sheets that lie on each other, such as the two sides of a leaf, only the rims are merged.

    Parameters
    ----------
    vertices : (n, 3) array of float
    faces : (m, 3) array of int
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    (m, 3) int32
        The faces, with each merged vertex replaced by the first one at its position.

    Raises
    ------
    InvalidMesh, Cancelled
        See `TriangleMesh`.

    Examples
    --------
    Two triangles side by side, whose vertices are apart:

    >>> from shock_filter import core
    >>> vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    >>> core.weld_borders(vertices, [[0, 1, 2], [3, 4, 5]]).tolist()
    [[0, 1, 2], [1, 4, 2]]
    """
    with reporting(progress):
        mesh = TriangleMesh(vertices, faces)
        face, side = np.nonzero(mesh.twins < 0)
        on_border = np.zeros(mesh.vertex_count, dtype=bool)
        on_border[mesh.faces[face, side]] = True
        on_border[mesh.faces[face, (side + 1) % 3]] = True
        places = np.flatnonzero(on_border)
        index = np.arange(mesh.vertex_count, dtype=np.int32)
        if len(places):
            representatives, welded = weld(mesh.vertices[places])
            index[places] = places[representatives[welded]]
        return index[np.asarray(faces)]


def split_at_jumps(mesh: TriangleMesh, signal: Floats) -> tuple[TriangleMesh, Floats]:
    """Cut a mesh open where the values of a corner signal jump.

    Corners at one vertex with the same value share a vertex; others become vertices of their own,
    so that edges between faces that disagree become borders.

    Parameters
    ----------
    mesh : TriangleMesh
    signal : (3 m, d) float64
        Values at the corners, in the order of ``mesh.faces``.

    Returns
    -------
    cut : TriangleMesh
        The faces of `mesh` in their order, with possibly more vertices.
    values : (n', d) float64
        The values at the vertices of `cut`.
    """
    leaders = np.empty(3 * mesh.face_count, dtype=np.int32)
    with aside("Finding jumps"):
        run(_lead_corners, mesh.vertex_count, *mesh.corners, signal, leaders)
        leads = leaders == np.arange(len(leaders), dtype=np.int32)
        first = np.flatnonzero(leads)
        ask()
        index = (np.cumsum(leads, dtype=np.int32) - 1)[leaders]
        ask()
        vertices = mesh.vertices[mesh.faces.reshape(-1)[first]]
        values = signal[first]
    return TriangleMesh(vertices, index.reshape(-1, 3)), values


@kernel
def _number_places(start, stop, bits, table, places, first, index):
    # A hash table with linear probing; it holds the number of each place.
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
def _lead_corners(start, stop, corner_start, corners, signal, leaders):
    # The first corner at the same vertex with the same values is the leader.
    keys = np.empty(0)
    for v in range(start, stop):
        around = corners[corner_start[v] : corner_start[v + 1]]
        is_hub = len(around) > HUB
        if is_hub:  # sort equal values together, stably
            keys = _keys(signal, around)
            order = np.argsort(keys, kind="mergesort")
            around, keys = around[order], keys[order]
        for i in range(len(around)):
            corner = around[i]
            leaders[corner] = corner
            for k in range(i - 1, -1, -1):
                if is_hub and keys[k] != keys[i]:
                    break
                other = around[k]
                same = True
                for j in range(signal.shape[1]):
                    if signal[other, j] != signal[corner, j]:
                        same = False
                        break
                if same:
                    leaders[corner] = leaders[other]
                    break


@kernel
def _keys(signal, rows):
    # A hash of each row: equal for equal values.
    keys = np.zeros(len(rows))
    for i in range(len(rows)):
        for j in range(signal.shape[1]):
            keys[i] = 0.6180339887 * keys[i] + signal[rows[i], j]
    return keys
