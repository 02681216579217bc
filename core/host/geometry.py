# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpen the geometry of a surface as Blender keeps it. Needs no bpy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ... import core
from .symmetry import MirrorPlane, mirror_pairs, symmetrise
from .welding import Surface, Welded, welded

_VISIBLE = 0.02
"""A move, in mean edge lengths, that people see."""


@dataclass(frozen=True)
class MirroredSurface(Surface):
    """A mesh object's geometry, and what keeps it symmetric.

    Attributes
    ----------
    mirror : (bool, bool, bool)
        Along which axes a symmetric surface stays symmetric.
    planes : tuple of MirrorPlane
        Where modifiers join the surface with its mirror image.
    """

    mirror: tuple[bool, bool, bool]
    planes: tuple[MirrorPlane, ...]


@dataclass(frozen=True)
class Sharpened:
    """New positions, how many vertices moved visibly, and the largest move in mean edge lengths."""

    positions: npt.NDArray[np.float32]
    moved: int
    largest_move: float


def sharpen(
    surface: MirroredSurface,
    settings: core.GeometrySettings,
    weld: bool,
    progress: Callable[[float, str], bool] | None,
) -> Sharpened:
    """Sharpen the surface; vertices without faces stay in place.

    Parameters
    ----------
    surface : MirroredSurface
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
    part = welded(surface, weld, progress)
    positions = core.sharpen_geometry(part.mesh, settings, part.mask, progress)
    return placed(surface, part, positions, progress)


def placed(
    surface: MirroredSurface,
    part: Welded,
    positions: npt.NDArray,
    progress: Callable[[float, str], bool] | None,
) -> Sharpened:
    """Bring a welded part's new positions, which may be mirrored, back to the surface."""
    from ..base.parallel import Progress

    phase = Progress.of(progress).part(1.0, 1.0, "Placing vertices")
    mesh = part.mesh
    moves = surface.from_world(positions - mesh.vertices)
    old = surface.positions[part.used]
    points = old[part.representatives].astype(np.float64)
    phase.update(1.0)
    for axis in np.flatnonzero(surface.mirror):
        moves = symmetrise(moves, _pairs(part, points, axis, progress), axis)
        phase.update(1.0)
    for plane in surface.planes:
        moves = plane.hold(moves, points)
        phase.update(1.0)

    new = surface.positions.copy()
    stays = moves == 0.0
    new[part.used] = np.where(stays[part.index], old, old + moves[part.index])
    phase.update(1.0)
    lengths = np.linalg.norm(surface.into_world(moves), axis=1) / mesh.mean_edge_length
    return Sharpened(
        positions=new,
        moved=int(np.count_nonzero(lengths[part.index] > _VISIBLE)),
        largest_move=float(lengths.max()),
    )


def _pairs(
    part: Welded,
    points: npt.NDArray,
    axis: np.intp,
    progress: Callable[[float, str], bool] | None,
) -> npt.NDArray[np.intp]:
    from ..base.memo import kept

    def find() -> npt.NDArray[np.intp]:
        return mirror_pairs(points, part.mesh.faces, part.mask, axis, progress)

    return kept(part.mesh, f"mirror {axis}", (points, part.mask), find)
