# SPDX-License-Identifier: GPL-3.0-or-later
"""The vertices of a mesh as a domain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ...flow.advect import average_corners, read_points
from ...flow.borders import diffused, local_contrast, nearby_range
from ...flow.potential import flow_potential
from ...flow.trace import corner_offsets, trace
from ...mesh.triangle_mesh import Floats, TriangleMesh
from ..signals import luminance
from .domain import Domain, Nearby


@dataclass(frozen=True)
class MeshDomain(Domain):
    """Vertices of a mesh, (n, d) float64, all of whose channels are filtered.

    Attributes
    ----------
    mesh : TriangleMesh
    brightness : bool
        Whether the brightness, and not each channel, guides the flow.
    nearest : bool
        Whether the nearest corner is read at the ends of flow-lines.
    at_corners : bool
        Whether results have a row for each corner of ``mesh.faces``, (3 m, d), with the value at
        the end of its own flow-line; otherwise each vertex has the mean of its corners.
    """

    mesh: TriangleMesh
    brightness: bool
    nearest: bool
    at_corners: bool

    def each_nearby(
        self,
        values: Floats,
        sigma: float,
        distance: float,
        use: Callable[[Any, Nearby], None],
    ) -> None:
        """Call `use` once, for all vertices."""
        smooth = diffused(self.mesh, values, sigma)
        low, high = nearby_range(self.mesh, values, distance)
        use(slice(None), Nearby(values, smooth, low, high))

    def contrasts(self, values: Floats, presmooth: float, reach: float) -> Floats:
        """Measure contrasts: (n,)."""
        return local_contrast(self.mesh, self._guide(values), presmooth, reach)

    def potential(self, values: Floats, passes: int) -> Floats:
        """Compute P: (n,)."""
        return flow_potential(self.mesh, self._guide(values), passes)

    def advect(
        self, values: Floats, potential: Floats, times: float | npt.NDArray, out: Floats
    ) -> None:
        """Advect the signal to the corners, and average at vertices unless `at_corners`."""
        points, coordinates = corner_offsets(self.mesh)
        if isinstance(times, np.ndarray):
            times = self._of_corners(times)
        trace(self.mesh, potential, times, points, coordinates)
        read = read_points(self.mesh, values, points, coordinates, self.nearest)
        out[...] = read if self.at_corners else average_corners(self.mesh, read, values)

    def as_result(self, values: Floats) -> Floats:
        """Return the values at the vertices or, with `at_corners`, copied to the corners."""
        return self._of_corners(values) if self.at_corners else values

    def _of_corners(self, values: Floats) -> Floats:
        return values[self.mesh.faces.reshape(-1)]

    def _guide(self, values: Floats) -> Floats:
        return luminance(values) if self.brightness else values
