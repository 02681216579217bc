# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the filters will pull a surface as Blender keeps it, or its colors. Needs no bpy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ... import core
from .colors import ColoredSurface, check_colors
from .welding import Progress as Callback
from .welding import Surface, Welded, welded


@dataclass(frozen=True)
class Flow:
    """The potential at the vertices and the flow in the triangles.

    Attributes
    ----------
    potential : (n,) float32
        See `core.geometry_flow` and `core.flow_field`; 0 at vertices without faces.
    flow : (m, 3) float32
        In the object's space and unit of length, per unit of flow time.
    """

    potential: npt.NDArray[np.float32]
    flow: npt.NDArray[np.float32]


def flow_of_shape(
    surface: Surface, settings: core.GeometrySettings, weld: bool, progress: Callback | None
) -> Flow:
    """Compute where normals will be pulled; parameters are those of `sharpening.sharpen`."""
    part = welded(surface, weld, progress)
    potential, flow = core.geometry_flow(part.mesh, settings, progress)
    return _brought_back(surface, part, potential, flow)


def flow_of_colors(
    surface: ColoredSurface, settings: core.ShockSettings, weld: bool, progress: Callback | None
) -> Flow:
    """Compute where colors will be pulled; parameters are those of `coloring.sharpen_colors`.

    With independent channels, this is the flow of all of them together. Where corners at a
    vertex differ, the highest potential counts.
    """
    from ..base.parallel import Progress
    from ..filters.signals import luminance, to_own_corners
    from ..mesh.triangle_mesh import split_at_jumps

    check_colors(surface)
    if surface.corners is None:
        part = welded(surface, weld, progress, surface.colors)
        cut, values = part.mesh, surface.colors[part.used][part.representatives]
    else:
        part = welded(surface, weld, progress)
        corners = to_own_corners(part.mesh, surface.colors[surface.corners])
        cut, values = split_at_jumps(part.mesh, corners, Progress.of(progress))
    if settings.channels == "luminance":
        values = luminance(values)
    highest, flow = core.flow_field(cut, values, settings, progress)
    if cut is part.mesh:
        potential = highest
    else:
        potential = np.zeros(part.mesh.vertex_count)
        own = cut.own_corners(cut.faces)  # as in part.mesh: cutting can turn a face
        np.maximum.at(potential, part.mesh.faces.reshape(-1), highest[own.reshape(-1)])
    return _brought_back(surface, part, potential, flow)


def _brought_back(
    surface: Surface, part: Welded, potential: npt.NDArray, flow: npt.NDArray
) -> Flow:
    at_vertices = np.zeros(len(surface.positions), dtype=np.float32)
    at_vertices[part.used] = potential[part.index]
    vectors = surface.from_world(part.mesh.mean_edge_length * flow)
    return Flow(at_vertices, vectors.astype(np.float32))
