# SPDX-License-Identifier: GPL-3.0-or-later
"""Windows of vertices: those within one step, like the 3 x 3 window of a pixel."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..base.progress import phase
from ..base.vectors import after, dot, edge
from .triangle_mesh import Floats, Ints, TriangleMesh

REACH = 1.5
"""Distance, in local units, within which vertices across the edges around a vertex are in its
window: on a grid of squares, diagonal neighbours."""


def windows_of(mesh: TriangleMesh, units: Floats) -> tuple[Ints, Ints]:
    """Find the neighbours of each vertex, and near vertices across the edges around it.

    Parameters
    ----------
    mesh : TriangleMesh
    units : (n,) float64
        Squared units of length.

    Returns
    -------
    start, others : (n + 1,) int32, (k,) int32
        As in ``mesh.neighbours``.
    """
    given = mesh.scaled_vertices, mesh.faces, mesh.twins, *mesh.corners, *mesh.neighbours, units
    start, nothing = np.zeros(mesh.vertex_count + 1, np.int32), np.empty(0, np.int32)
    run(_find, mesh.vertex_count, *given, start, nothing)
    np.cumsum(start, out=start)
    others = np.empty(start[-1], np.int32)
    run(_find, mesh.vertex_count, *given, start, others)
    return start, others


def widened(
    windows: tuple[Ints, Ints],
    ranges: npt.NDArray[np.float32],
    steps: int,
    message: str,
) -> npt.NDArray[np.float32]:
    """Take the least and greatest values within some steps: (n, 2, k) -> (n, 2, k)."""
    spare = None
    for step in range(steps):
        out = np.empty_like(ranges) if spare is None else spare
        with phase(step / steps, (step + 1) / steps, message):
            run(_widen, len(ranges), windows[0], windows[1].view(np.uint32), ranges, out)
        spare = ranges if step else None  # the caller's array is never written to
        ranges = out
    return ranges


@kernel
def _find(start, stop, vertices, faces, twins, corner_start, corners, ring_start, ring, units,
          begin, others):  # fmt: skip
    # Counts them, or puts them into their places if there are any.
    for v in range(start, stop):
        found = ring_start[v + 1] - ring_start[v]
        if others.size > 0:
            for i in range(found):
                others[begin[v] + i] = ring[ring_start[v] + i]
        for i in range(corner_start[v], corner_start[v + 1]):
            f = corners[i] // 3
            t = twins[f, after(corners[i] - 3 * f)]
            if t < 0:
                continue
            u = faces[t // 3, after(after(t - 3 * (t // 3)))]
            e = edge(vertices, v, u)
            if dot(e, e) < 0.5 * REACH**2 * (units[u] + units[v]):
                if others.size > 0:
                    others[begin[v] + found] = u
                found += 1
        if others.size == 0:
            begin[v + 1] = found


@kernel
def _widen(start, stop, begin, others, ranges, out):
    k = ranges.shape[2]
    for v in range(start, stop):
        low, high = out[v, 0], out[v, 1]
        for j in range(k):
            low[j], high[j] = ranges[v, 0, j], ranges[v, 1, j]
        for i in range(begin[v], begin[v + 1]):
            u = others[i]
            for j in range(k):
                low[j] = min(low[j], ranges[u, 0, j])
                high[j] = max(high[j], ranges[u, 1, j])
