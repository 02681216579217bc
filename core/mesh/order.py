# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory order: sort a mesh along a space-filling curve, so that neighbours are close in memory.

On large meshes whose vertices and faces are in random order, every kernel waits for memory;
sorting first makes kernels several times faster.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from ..base.memo import kept
from ..base.progress import aside, ask
from .adjacency import count_sort
from .triangle_mesh import Floats, TriangleMesh

_SMALL = 100_000
"""Meshes of fewer faces fit into the processor's caches anyway."""

_RUN, _BLOCK = 256, 16
"""Lengths of runs of consecutive faces, and of blocks of vertices that are fetched together."""


def is_scattered(mesh: TriangleMesh) -> bool:
    """Tell whether consecutive faces of a large mesh have vertices scattered over memory.

    It looks at long runs: in a subdivided mesh the children of a face are consecutive, whatever
    the order of the whole.
    """
    if mesh.face_count < _SMALL:
        return False
    vertices = blocks = 0
    for first in np.linspace(0, mesh.face_count - _RUN, 40).astype(np.int64):
        used = np.unique(mesh.faces[first : first + _RUN])
        vertices += len(used)
        blocks += len(np.unique(used // _BLOCK))
    return blocks > 0.45 * vertices


def in_good_order(
    mesh: TriangleMesh, function: Callable[..., Floats], weights: Floats | None
) -> Floats:
    """Call a function on a mesh, which is sorted along a curve first if it is scattered.

    Parameters
    ----------
    mesh : TriangleMesh
    function : callable
        ``function(mesh, weights)`` returns a row per vertex (n, d).
    weights : (n,) float64 or None
        Weights of the vertices.

    Returns
    -------
    (n, d) float64
        The rows, in the order of `mesh`.
    """
    if not is_scattered(mesh):
        return function(mesh, weights)
    ordered, order, _ = kept(mesh, "order", (), lambda: sorted_along_curve(mesh))
    rows = function(ordered, None if weights is None else weights[order])
    back = np.empty_like(rows)
    back[order] = rows
    return back


def sorted_along_curve(
    mesh: TriangleMesh,
) -> tuple[TriangleMesh, npt.NDArray[np.intp], npt.NDArray[np.int32]]:
    """Sort vertices along a Morton curve, and faces by their lowest vertex.

    Returns
    -------
    ordered : TriangleMesh
        The same surface; ``ordered.vertices == mesh.vertices[vertex_order]``, and its face i is
        face ``face_order[i]`` of `mesh`.
    vertex_order : (n,) int
    face_order : (m,) int32
    """
    with aside("Sorting"):
        codes = morton_codes(mesh)
        ask()
        vertex_order = np.argsort(codes, kind="stable")
        ask()
        rank = np.empty(mesh.vertex_count, dtype=np.int32)
        rank[vertex_order] = np.arange(mesh.vertex_count, dtype=np.int32)
        faces = rank[mesh.faces]
        ask()
        lowest = np.minimum(np.minimum(faces[:, 0], faces[:, 1]), faces[:, 2])
        _, face_order = count_sort(lowest, mesh.vertex_count)
        vertices, faces = mesh.vertices[vertex_order], faces[face_order]
    return TriangleMesh(vertices, faces), vertex_order, face_order


def morton_codes(mesh: TriangleMesh) -> npt.NDArray[np.uint64]:
    """Return where the vertices are on a Morton curve: 21 bits per coordinate, interleaved.

    Distant loose vertices are clipped to the border.
    """
    low, high = mesh.box
    size = float((high - low).max())
    codes = np.zeros(mesh.vertex_count, dtype=np.uint64)
    for axis in range(3):
        share = np.clip((mesh.vertices[:, axis] - low[axis]) / size, 0.0, 1.0)
        bits = (share * (2**21 - 1)).astype(np.uint64)
        for shift, mask in (
            (32, 0x1F00000000FFFF),
            (16, 0x1F0000FF0000FF),
            (8, 0x100F00F00F00F00F),
            (4, 0x10C30C30C30C30C3),
            (2, 0x1249249249249249),
        ):
            bits = (bits | (bits << np.uint64(shift))) & np.uint64(mask)
        codes |= bits << np.uint64(axis)
    return codes
