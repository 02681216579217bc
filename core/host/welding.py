# SPDX-License-Identifier: GPL-3.0-or-later
"""Preparation of a host program's surface: welded seams, loose parts, object scale.

The last surfaces are kept with the results that the core has cached for them, so that a redo with
other settings computes only what depends on these.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base.memo import equal
from ..base.progress import aside, ask
from ..mesh.triangle_mesh import TriangleMesh, check_finite
from ..mesh.weld import weld
from . import forgetting
from .inputs import Surface

_MOST_SURFACES = 2
_MOST_VERTICES = 1_200_000
"""Most vertices to keep; each needs 400 to 900 bytes, with all derived data."""


@dataclass(frozen=True)
class Welded:
    """The part of a surface that has faces, with vertices at the same place merged.

    Attributes
    ----------
    mesh : TriangleMesh
        In the world's lengths.
    mask : (k,) float64 or None
        The lowest mask of the merged vertices.
    used : (n,) bool
        Which vertices of the surface have faces.
    representatives : (k,) int
        One of the merged vertices for each vertex of `mesh`, as an index into the used ones.
    index : (number of used vertices,) int
        The vertex of `mesh` for each used vertex.
    """

    mesh: TriangleMesh
    mask: npt.NDArray[np.float64] | None
    used: npt.NDArray[np.bool_]
    representatives: npt.NDArray[np.intp]
    index: npt.NDArray[np.intp]


def welded(surface: Surface, weld: bool, colors: npt.NDArray[np.float32] | None = None) -> Welded:
    """Remove loose vertices, and merge vertices at exactly the same place.

    Returns the same object for the same surface. Safe on any thread.

    Parameters
    ----------
    surface : Surface
        Its arrays must not change from now on.
    weld : bool
        False keeps all vertices apart.
    colors : (n, 3) array of float, optional
        Vertices with different colors are not merged.

    Raises
    ------
    InvalidMesh, Cancelled
        See `TriangleMesh`.
    """
    key = surface.positions, surface.triangles, surface.mask, surface.to_world, weld, colors
    with _lock:
        entry = next((entry for entry in _recent if equal(entry[0], key)), None)
    if entry is None:
        entry = key, _welded(surface, weld, colors)
    with _lock:
        _recent[:] = [entry] + [other for other in _recent if other is not entry]
        del _recent[_MOST_SURFACES:]
        while sum(len(kept[0][0]) for kept in _recent) > _MOST_VERTICES:
            del _recent[-1]
    return entry[1]


@forgetting.with_file
def forget() -> None:
    """Drop all kept surfaces."""
    with _lock:
        _recent.clear()


_recent: list[tuple[tuple[Any, ...], Welded]] = []
_lock = threading.Lock()


def _welded(
    surface: Surface, at_same_place: bool, colors: npt.NDArray[np.float32] | None
) -> Welded:
    check_finite(surface.positions)  # of loose vertices, too, under the numbers that Blender shows
    with aside("Preparing the mesh"):
        used = np.zeros(len(surface.positions), dtype=bool)
        used[surface.triangles] = True
        points = surface.positions[used].astype(np.float64)
        ask()
        representatives = index = np.arange(len(points))
        if at_same_place:
            representatives, index = weld(points)
            if colors is not None:
                _, of_color = weld(colors[used])
                pairs = np.stack([index, of_color, np.zeros_like(index)], axis=1)
                representatives, index = weld(pairs)
        mask = None
        if surface.mask is not None:
            masks = surface.mask[used]
            mask = masks[representatives]
            copies = np.flatnonzero(representatives[index] != np.arange(len(masks)))
            np.minimum.at(mask, index[copies], masks[copies])
        vertices = surface.into_world(points[representatives])
        ask()
        places = np.zeros(len(used), dtype=np.int32)
        places[used] = index
        mesh = TriangleMesh(vertices, places[surface.triangles])
        return Welded(mesh, mask, used, representatives, index)
