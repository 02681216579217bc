# SPDX-License-Identifier: GPL-3.0-or-later
"""The flow of the filters of shapes and colors, on the surface of a host program."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..base.progress import ProgressCallback, reporting
from ..color.signals import luminance, to_own_corners
from ..flow.potential import flow_field
from ..host.colors import check_colors, light_of
from ..host.inputs import ColoredSurface, Surface
from ..host.welding import Welded, welded
from ..mesh.weld import split_at_jumps
from ..settings import GeometrySettings, ShockSettings
from ..shape.sharpening import geometry_flow


@dataclass(frozen=True)
class Flow:
    """The potential at the vertices and the flow in the triangles.

    Attributes
    ----------
    potential : (n,) float32
        See `geometry_flow` and `flow_field`; 0 at vertices without faces.
    flow : (m, 3) float32
        In the object's space and unit of length, per unit of flow time.
    """

    potential: npt.NDArray[np.float32]
    flow: npt.NDArray[np.float32]


def flow_of_shape(
    surface: Surface, settings: GeometrySettings, weld: bool, progress: ProgressCallback | None
) -> Flow:
    """Compute the flow of normals; parameters are those of `geometry.filter_shape`."""
    with reporting(progress):
        part = welded(surface, weld)
        potential, flow = geometry_flow(part.mesh, settings)
        return _brought_back(surface, part, potential, flow)


def flow_of_colors(
    surface: ColoredSurface, settings: ShockSettings, weld: bool, progress: ProgressCallback | None
) -> Flow:
    """Compute the flow of colors; parameters are those of `colors.filter_colors`.

    For independent channels, it is the flow of all channels together. Where corners at a vertex
    differ, the result has the highest of their potentials.
    """
    check_colors(surface)
    with reporting(progress):
        if surface.corners is None:
            part = welded(surface, weld, surface.colors)
            cut = part.mesh
            values = light_of(surface)[part.used][part.representatives].astype(np.float64)
        else:
            part = welded(surface, weld)
            corners = to_own_corners(part.mesh, light_of(surface)[surface.corners])
            cut, values = split_at_jumps(part.mesh, corners)
        if settings.channels == "luminance":
            values = luminance(values)
        potential, flow = flow_field(cut, values, settings)
        if cut is not part.mesh:
            highest = np.zeros(part.mesh.vertex_count)
            own = cut.own_corners(cut.faces)  # as in part.mesh: cutting can turn a face
            np.maximum.at(highest, part.mesh.faces.reshape(-1), potential[own.reshape(-1)])
            potential = highest
        return _brought_back(surface, part, potential, flow)


def _brought_back(
    surface: Surface, part: Welded, potential: npt.NDArray, flow: npt.NDArray
) -> Flow:
    at_vertices = np.zeros(len(surface.positions), dtype=np.float32)
    at_vertices[part.used] = potential[part.index]
    vectors = surface.from_world(part.mesh.mean_edge_length * flow)
    return Flow(at_vertices, vectors.astype(np.float32))
