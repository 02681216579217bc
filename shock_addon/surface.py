# SPDX-License-Identifier: GPL-3.0-or-later
"""A surface as Blender keeps it, made ready for the core: seams, loose parts, object scale.

Needs no bpy.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .. import core


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


def welded(surface: Surface, weld: bool, colors: npt.NDArray[np.float32] | None = None) -> Welded:
    """Leave out loose vertices and make vertices at exactly the same place one.

    Parameters
    ----------
    surface : Surface
    weld : bool
        False keeps all vertices apart.
    colors : (n, 3) array of float, optional
        Vertices whose colors differ stay apart, too.

    Raises
    ------
    core.InvalidMesh
        See `core.TriangleMesh`.
    """
    used = np.zeros(len(surface.positions), dtype=bool)
    used[surface.triangles] = True
    points = surface.positions[used].astype(np.float64)
    triangles = (np.cumsum(used, dtype=np.int32) - 1)[surface.triangles]
    representatives = index = np.arange(len(points))
    if weld:
        representatives, index = core.weld(points)
        if colors is not None:
            _, of_color = core.weld(colors[used])
            pairs = np.stack([index, of_color, np.zeros_like(index)], axis=1)
            representatives, index = core.weld(pairs)
    mask = None
    if surface.mask is not None:
        mask = _lowest(surface.mask[used], representatives, index)
    vertices = points[representatives] @ surface.to_world.T
    mesh = core.TriangleMesh(vertices, index[triangles])
    return Welded(mesh, mask, used, representatives, index)


def _lowest(
    mask: npt.NDArray[np.float64], representatives: npt.NDArray, index: npt.NDArray
) -> npt.NDArray[np.float64]:
    lowest = mask[representatives]
    copies = np.flatnonzero(representatives[index] != np.arange(len(mask)))
    np.minimum.at(lowest, index[copies], mask[copies])
    return lowest
