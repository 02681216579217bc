# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpen a surface as Blender keeps it: seams, loose parts, object scale, mirror. Needs no bpy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .. import core
from .symmetry import mirror_pairs, symmetrise


@dataclass(frozen=True)
class Surface:
    """A mesh object's geometry.

    Attributes
    ----------
    positions : (n, 3) float32
        Vertices in the object's space.
    triangles : (m, 3) int32
    mask : (n,) float64 or None
        1 sharpens fully, 0 leaves the vertex in place.
    to_world : (3, 3) float64
        The object's scale, shear and rotation: lengths are measured after it.
    mirror : tuple of three bool
        Axes of the object along which a symmetric surface stays symmetric.
    """

    positions: npt.NDArray[np.float32]
    triangles: npt.NDArray[np.int32]
    mask: npt.NDArray[np.float64] | None
    to_world: npt.NDArray[np.float64]
    mirror: tuple[bool, bool, bool]


@dataclass(frozen=True)
class Sharpened:
    """New positions, how many vertices moved, and the largest move in mean edge lengths."""

    positions: npt.NDArray[np.float32]
    moved: int
    largest_move: float


def sharpen(
    surface: Surface,
    settings: core.GeometrySettings,
    weld: bool,
    progress: Callable[[float, str], bool] | None,
) -> Sharpened:
    """Sharpen the surface; vertices without faces stay in place.

    Parameters
    ----------
    surface : Surface
    settings : core.GeometrySettings
    weld : bool
        Vertices at exactly the same place move together, as the most protected of them.
    progress : callable or None
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    Sharpened
        Vertices that do not move keep their coordinates bit for bit.

    Raises
    ------
    core.ShockError
        See `core.TriangleMesh` and `core.sharpen_geometry`.
    """
    used = np.zeros(len(surface.positions), dtype=bool)
    used[surface.triangles] = True
    old = surface.positions[used].astype(np.float64)
    triangles = (np.cumsum(used, dtype=np.int32) - 1)[surface.triangles]
    mask = None if surface.mask is None else surface.mask[used]
    everything = np.arange(len(old))
    representatives, index = core.weld(old) if weld else (everything, everything)
    if mask is not None:
        mask = _lowest(mask, representatives, index)

    points = old[representatives]
    mesh = core.TriangleMesh(points @ surface.to_world.T, index[triangles])
    moves = core.sharpen_geometry(mesh, settings, mask, progress) - mesh.vertices
    moves = np.linalg.solve(surface.to_world, moves.T).T
    for axis in np.flatnonzero(surface.mirror):
        moves = symmetrise(moves, mirror_pairs(points, mesh.faces, mask, axis), axis)

    new = surface.positions.copy()
    stays = moves == 0.0
    new[used] = np.where(stays[index], surface.positions[used], old + moves[index])
    lengths = np.linalg.norm(moves @ surface.to_world.T, axis=1)
    return Sharpened(
        positions=new,
        moved=int(np.count_nonzero((new != surface.positions).any(axis=1))),
        largest_move=float(lengths.max() / mesh.mean_edge_length),
    )


def _lowest(
    mask: npt.NDArray[np.float64], representatives: npt.NDArray, index: npt.NDArray
) -> npt.NDArray[np.float64]:
    lowest = mask[representatives]
    copies = np.flatnonzero(representatives[index] != np.arange(len(mask)))
    np.minimum.at(lowest, index[copies], mask[copies])
    return lowest
