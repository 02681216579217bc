# SPDX-License-Identifier: GPL-3.0-or-later
"""Filter the geometry of a surface, as a host program stores it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base.memo import kept
from ..base.progress import ProgressCallback, aside, ask, reporting
from ..registry import find
from ..settings import GeometrySettings
from ..shape.crease_lines import edges_of
from .creases import lines_of, places_of
from .edge_marks import CreaseEdges
from .inputs import MirroredSurface
from .symmetry import mirror_pairs, symmetrise
from .welding import Welded, welded

_VISIBLE = 0.02
"""Least visible move, in mean edge lengths."""


@dataclass(frozen=True)
class Reshaped:
    """The result of a filter on a surface.

    Attributes
    ----------
    positions : (n, 3) float32
    moved : int
        Number of vertices that moved visibly.
    largest_move : float
        In mean edge lengths.
    edge_length : float
        The mean edge length, as lengths are measured.
    creases : CreaseEdges or None
        Edges of creases: those that were closed and those that were sharp before; None where these
        are not requested, or not searched.
    """

    positions: npt.NDArray[np.float32]
    moved: int
    largest_move: float
    edge_length: float
    creases: CreaseEdges | None = None


def filter_shape(
    surface: MirroredSurface,
    name: str,
    settings: Any,
    weld: bool,
    progress: ProgressCallback | None = None,
) -> Reshaped:
    """Filter the positions of a surface; vertices without faces stay in place.

    Parameters
    ----------
    surface : MirroredSurface
    name : str
        Name of the filter in the registry.
    settings : object
        Settings of the filter; a `Denoising` if a sharpening may follow.
    weld : bool
        Whether vertices at the same place move together, with the lowest of their masks.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    Reshaped
        Vertices that do not move keep their coordinates bit for bit.

    Raises
    ------
    ShockError
        See `TriangleMesh` and the filter.
    """
    row = find(name)
    function = row.function(settings.sharpen_time)
    with reporting(progress):
        part = welded(surface, weld)
        positions = function(part.mesh, settings=settings.kernel, mask=part.mask)
        shape = placed(surface, part, positions)
        if not row.closes_creases or surface.sharp_angle is None:
            return shape
        with aside("Finding creases"):
            return replace(shape, creases=_creases(surface, part, settings))


def _creases(surface: MirroredSurface, part: Welded, settings: GeometrySettings) -> CreaseEdges:
    places, pairs = places_of(part), np.zeros((0, 2), dtype=np.intp)
    if settings.where == "creases" and not settings.is_neutral:
        lines = lines_of(surface, part, settings, surface.sharp_angle, with_left=False)
        pairs = edges_of(lines)
        for axis in (axis for axis in range(3) if surface.mirror[axis]):
            mirrored = _pairs(surface, part, axis)[pairs]
            pairs = np.concatenate([pairs, mirrored[(mirrored >= 0).all(axis=1)]])
    return CreaseEdges(places, pairs)


def _pairs(surface: MirroredSurface, part: Welded, axis: int) -> npt.NDArray[np.intp]:
    # Which welded vertices mirror each other; see `mirror_pairs`.
    points = surface.positions[part.used][part.representatives].astype(np.float64)
    find = partial(mirror_pairs, points, part.mesh.faces, part.mask, axis)
    return kept(part.mesh, f"mirror {axis}", (points, part.mask), find)


def placed(surface: MirroredSurface, part: Welded, positions: npt.NDArray) -> Reshaped:
    """Return new positions of a surface from those of its welded part, with symmetry."""
    with aside("Placing vertices"):
        mesh = part.mesh
        moves = surface.from_world(positions - mesh.vertices)
        old = surface.positions[part.used]
        points = old[part.representatives].astype(np.float64)
        for axis in (axis for axis in range(3) if surface.mirror[axis]):
            ask()
            moves = symmetrise(moves, _pairs(surface, part, axis), axis)
        for plane in surface.planes:
            ask()
            moves = plane.hold(moves, points)
        ask()
        new = surface.positions.copy()
        stays = moves == 0.0
        new[part.used] = np.where(stays[part.index], old, old + moves[part.index])
        ask()
        lengths = np.linalg.norm(surface.into_world(moves), axis=1) / mesh.mean_edge_length
        return Reshaped(
            positions=new,
            moved=int(np.count_nonzero(lengths[part.index] > _VISIBLE)),
            largest_move=float(lengths.max()),
            edge_length=mesh.mean_edge_length,
        )
