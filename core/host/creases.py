# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the creases of a surface as a host program keeps it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..base.progress import ProgressCallback, phase, reporting
from ..settings import GeometrySettings
from ..shape.crease_lines import CreaseLine, closing_creases, find_creases, standing_out
from .edge_marks import CreaseEdges
from .inputs import MirroredSurface
from .welding import Welded, welded

_LEAST, _MOST = 5.0, 170.0
"""Smallest and largest angle of creases, in degrees."""


@dataclass(frozen=True)
class FoundCreases:
    """The creases of a surface.

    Attributes
    ----------
    lines : list of CreaseLine
        Through vertices of the surface.
    edges : CreaseEdges
        The edges of all lines.
    owners : (k,) int
        The line of each pair of `edges`.
    """

    lines: list[CreaseLine]
    edges: CreaseEdges
    owners: npt.NDArray[np.intp]


def creases_of(
    surface: MirroredSurface,
    settings: GeometrySettings,
    weld: bool,
    progress: ProgressCallback | None = None,
) -> FoundCreases:
    """Find the creases of a surface; parameters are those of `geometry.filter_shape`."""
    with reporting(progress):
        part = welded(surface, weld)
        with phase(0.0, 1.0, "Finding creases"):
            found = lines_of(surface, part, settings, surface.sharp_angle)
    counts = [len(line.edges) for line in found]
    pairs = np.concatenate([np.zeros((0, 2), dtype=np.intp), *(line.edges for line in found)])
    own = np.flatnonzero(part.used)[part.representatives]
    lines = [replace(line, vertices=own[line.vertices]) for line in found]
    owners = np.repeat(np.arange(len(lines)), counts)
    return FoundCreases(lines, CreaseEdges(places_of(part), pairs), owners)


def lines_of(
    surface: MirroredSurface,
    part: Welded,
    settings: GeometrySettings,
    angle: float | None,
    with_left: bool = True,
) -> list[CreaseLine]:
    """Find the creases of a welded part whose strength is at least an angle, in degrees.

    Creases that stay are left out on request, and so are those of rough surfaces.
    """
    angle = _LEAST if angle is None else angle
    edges = None if surface.edges is None else places_of(part)[surface.edges]
    if edges is not None:
        edges = edges[(edges >= 0).all(axis=1)]
    least = min(max(angle, _LEAST), _MOST)
    if with_left:
        lines = find_creases(part.mesh, settings, angle=least, edges=edges)
    else:
        lines = closing_creases(part.mesh, settings, least, edges)
        lines = standing_out(part.mesh, lines, least)
    return [line for line in lines if line.strength > angle]


def places_of(part: Welded) -> npt.NDArray[np.intp]:
    """Return the welded vertex of each vertex of the surface; -1 for none."""
    places = np.full(len(part.used), -1, dtype=np.intp)
    places[part.used] = part.index
    return places
