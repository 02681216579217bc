# SPDX-License-Identifier: GPL-3.0-or-later
"""A surface as Blender keeps it, made ready for the core: seams, loose parts, object scale.

Needs no bpy. The last surfaces stay here with what the core has found out about them, so that a
redo with other settings computes only what depends on these.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ... import core
from . import forgetting

Progress = Callable[[float, str], bool]

_MOST_SURFACES = 2
_MOST_VERTICES = 1_200_000
"""How much is kept; a vertex takes 400 to 900 bytes with all that is derived from it."""


@dataclass(frozen=True)
class Surface:
    """A mesh object's geometry.

    Attributes
    ----------
    positions : (n, 3) float32
        Vertices in the object's space.
    triangles : (m, 3) int32
    mask : (n,) float64 or None
        1 sharpens fully, 0 leaves the vertex as it is.
    to_world : (3, 3) float64
        The object's scale, shear and rotation: lengths are measured after it.
    """

    positions: npt.NDArray[np.float32]
    triangles: npt.NDArray[np.int32]
    mask: npt.NDArray[np.float64] | None
    to_world: npt.NDArray[np.float64]

    @property
    def size(self) -> int:
        """How much work it is, beside others."""
        return len(self.positions)

    def into_world(self, vectors: npt.NDArray) -> npt.NDArray:
        """Turn vectors of the object's space, as rows, into those of the world."""
        return vectors if self._as_in_world() else vectors @ self.to_world.T

    def from_world(self, vectors: npt.NDArray) -> npt.NDArray:
        """Turn them back."""
        return vectors if self._as_in_world() else np.linalg.solve(self.to_world, vectors.T).T

    def _as_in_world(self) -> bool:
        return np.array_equal(self.to_world, np.identity(3))


@dataclass(frozen=True)
class Welded:
    """The part of a surface that has faces, vertices at the same place being one.

    Attributes
    ----------
    mesh : core.TriangleMesh
        In the world's lengths.
    mask : (k,) float64 or None
        Of welded vertices the most protected counts.
    used : (n,) bool
        Which vertices of the surface have faces.
    representatives : (k,) int
        For each vertex of `mesh` one of the used vertices that it stands for.
    index : (number of used vertices,) int
        The vertex of `mesh` that stands for each used vertex.
    """

    mesh: core.TriangleMesh
    mask: npt.NDArray[np.float64] | None
    used: npt.NDArray[np.bool_]
    representatives: npt.NDArray[np.intp]
    index: npt.NDArray[np.intp]


def welded(
    surface: Surface,
    weld: bool,
    progress: Progress | None = None,
    colors: npt.NDArray[np.float32] | None = None,
) -> Welded:
    """Leave out loose vertices and make vertices at exactly the same place one.

    Asked again about the same surface, it returns the same object. Safe on any thread.

    Parameters
    ----------
    surface : Surface
        Its arrays must not change from now on.
    weld : bool
        False keeps all vertices apart.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.
    colors : (n, 3) array of float, optional
        Vertices whose colors differ stay apart, too.

    Raises
    ------
    core.InvalidMesh, core.Cancelled
        See `core.TriangleMesh`.
    """
    from ..base.memo import equal

    key = surface.positions, surface.triangles, surface.mask, surface.to_world, weld, colors
    with _lock:
        entry = next((entry for entry in _recent if equal(entry[0], key)), None)
    if entry is None:
        entry = key, _welded(surface, weld, progress, colors)
    with _lock:
        _recent[:] = [entry] + [other for other in _recent if other is not entry]
        del _recent[_MOST_SURFACES:]
        while sum(len(kept[0][0]) for kept in _recent) > _MOST_VERTICES:
            del _recent[-1]
    return entry[1]


@forgetting.with_file
def forget() -> None:
    """Drop the surfaces that are kept."""
    with _lock:
        _recent.clear()


_recent: list[tuple[tuple[Any, ...], Welded]] = []
_lock = threading.Lock()


def _welded(
    surface: Surface,
    weld: bool,
    progress: Progress | None,
    colors: npt.NDArray[np.float32] | None,
) -> Welded:
    from ..base.parallel import Progress as Phases
    from ..mesh.triangle_mesh import check_finite

    check_finite(surface.positions)  # of loose vertices, too, under the numbers that Blender shows
    phase = Phases.of(progress).part(0.0, 0.0, "Preparing the mesh")
    used = np.zeros(len(surface.positions), dtype=bool)
    used[surface.triangles] = True
    points = surface.positions[used].astype(np.float64)
    phase.update(0.0)
    representatives = index = np.arange(len(points))
    if weld:
        representatives, index = core.weld(points, progress)
        if colors is not None:
            _, of_color = core.weld(colors[used], progress)
            pairs = np.stack([index, of_color, np.zeros_like(index)], axis=1)
            representatives, index = core.weld(pairs, progress)
    mask = None
    if surface.mask is not None:
        mask = _lowest(surface.mask[used], representatives, index)
    vertices = surface.into_world(points[representatives])
    phase.update(0.0)
    places = np.zeros(len(used), dtype=np.int32)
    places[used] = index
    triangles = places[surface.triangles]
    mesh = core.TriangleMesh(vertices, triangles, progress)
    return Welded(mesh, mask, used, representatives, index)


def _lowest(
    mask: npt.NDArray[np.float64], representatives: npt.NDArray, index: npt.NDArray
) -> npt.NDArray[np.float64]:
    lowest = mask[representatives]
    copies = np.flatnonzero(representatives[index] != np.arange(len(mask)))
    np.minimum.at(lowest, index[copies], mask[copies])
    return lowest
