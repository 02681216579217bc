# SPDX-License-Identifier: GPL-3.0-or-later
"""Channels of a signal at the vertices of a mesh as planes, for the learned recipe for images.

Vertices are stored in rows, in their order; their neighbours are those of the mesh. Lengths are in
a local unit at each vertex: see `core.mesh.spreading`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..base.progress import aside, phase
from ..base.vectors import after, cross, dot, edge
from ..flow.advect import average_corners, read_points
from ..flow.potential import squared_gradient
from ..flow.trace import corner_offsets, trace
from ..grid.part import Part
from ..mesh.calculus import lumped_mass, smooth_vertices
from ..mesh.cell_means import CellMeans
from ..mesh.spreading import squared_units, vertex_graph
from ..mesh.triangle_mesh import TriangleMesh
from ..mesh.windows import widened, windows_of
from .learned.planes import NONE, Plan, WholePlanes, variance_of
from .learned.surroundings import Singles

_MESSAGE = "Sharpening"

_ROW = 64
"""Number of vertices per row."""

_PASS = 0.2977
"""Variance of one smoothing pass on the flow of images, along each axis."""

_NEAR = 3.24
"""Variance of the smoothing of `Vertices.unevenness`."""

_LEAST, _MOST = 1 / 4096, 4096.0
"""Bounds of the fourth power of the local unit, which is the factor of a vertex's flow time."""


class Vertices:
    """Data of one mesh that its planes share.

    Parameters
    ----------
    mesh : TriangleMesh

    Attributes
    ----------
    units : (n,) float64
        Squared local units of length, in squared mean edge lengths.
    masses : (n,) float64
        Areas of the vertices.
    trust : (m,) float64
        Weights of the gradients of faces: their areas, but less for slivers.
    """

    def __init__(self, mesh: TriangleMesh) -> None:
        self.mesh = mesh
        with aside(_MESSAGE):
            self.units = squared_units(mesh)
            self.masses = lumped_mass(mesh)
            self.graph, self._weights = vertex_graph(mesh, self.masses, self.units)
            self.windows = windows_of(mesh, self.units)
            self.trust = np.empty(mesh.face_count)
            run(_trust, mesh.face_count, mesh.scaled_vertices, mesh.faces, mesh.areas, self.trust)
        self.rows = max(-(-mesh.vertex_count // _ROW), 2)

    @cached_property
    def typical_unit(self) -> float:
        """The mean local unit of length, weighted by area, in mean edge lengths."""
        return float(np.average(np.sqrt(self.units), weights=self.masses))

    @cached_property
    def means(self) -> CellMeans:
        """Means over wide surroundings."""
        with aside(_MESSAGE):
            return CellMeans(self.mesh, self.units, self._weights, self.masses, _MESSAGE)

    @cached_property
    def unevenness(self) -> Singles:
        """RMS move of near vertices by a smoothing pass, in local units: (n, 1); 0 if even."""
        places = self.mesh.scaled_vertices
        with aside(_MESSAGE):
            moves = smooth_vertices(self.mesh, places, 1) - places
        squares = (moves**2).sum(axis=1, keepdims=True) / self.units[:, None]
        return np.sqrt(np.maximum(self.spread(squares.astype(np.float32), _NEAR), 0))

    @cached_property
    def inside(self) -> npt.NDArray[np.bool_]:
        """Whether each place of the rows holds a vertex: (rows * columns,)."""
        return np.arange(self.rows * _ROW) < self.mesh.vertex_count

    def planes_of(self, values: npt.NDArray) -> Singles:
        """Put values of vertices into rows: (n, k) -> (k, rows, columns)."""
        out = np.zeros((values.shape[1], self.rows * _ROW), np.float32)
        out[:, : len(values)] = values.T
        return out.reshape(len(out), self.rows, _ROW)

    def values_of(self, planes: Singles) -> Singles:
        """Take values of vertices from rows: (k, rows, columns) -> (n, k)."""
        return np.ascontiguousarray(planes.reshape(len(planes), -1)[:, : self.mesh.vertex_count].T)

    def spread(self, values: Singles, variance: float) -> Singles:
        """Smooth values (n, k)."""
        return self.graph.spread(values, variance, _MESSAGE)


@dataclass(frozen=True)
class VertexPlanes(WholePlanes):
    """Channels of a signal at vertices, without opacity.

    Attributes
    ----------
    values, opacity
        As in `Planes`; (c, rows, columns), and empty.
    vertices : Vertices
    """

    vertices: Vertices = field(kw_only=True)

    @classmethod
    def of_vertices(cls, vertices: Vertices, values: npt.NDArray) -> VertexPlanes:
        """Take all channels (n, c)."""
        return cls(vertices.planes_of(values), NONE, vertices=vertices)

    def with_values(self, values: Singles) -> VertexPlanes:
        """Return other values."""
        return replace(self, values=values)

    def columns(self, start: int, stop: int) -> npt.NDArray[np.bool_]:
        """Return which places of some rows, flattened, hold vertices."""
        return self.vertices.inside[start * _ROW : stop * _ROW]

    def told(self, start: int, stop: int) -> Singles:
        """Return the additional feature of some rows: how uneven the mesh is."""
        return self._told[:, start:stop]

    @cached_property
    def _told(self) -> Singles:
        return self.vertices.planes_of(self.vertices.unevenness)

    def surroundings(self) -> _Means:
        """Return an object that computes means over wide surroundings."""
        return _Means(self.vertices)

    def premultiplied(self) -> VertexPlanes:
        """Return itself: there is no opacity."""
        return self

    def averaged(
        self, energies: Singles, first: int, sigma: float, top: int, bottom: int
    ) -> Singles:
        """Smooth energies: (k, rows, columns)."""
        values = self.vertices.spread(self.vertices.values_of(energies), variance_of(sigma))
        return self.vertices.planes_of(np.maximum(values, 0, out=values))

    def _smoothed(self, sigmas: tuple[float, ...]) -> Singles:
        out = np.empty((len(sigmas), *self.values.shape), np.float32)
        smooth, variance = self.vertices.values_of(self.values), 0.0
        for number, (target, sigma) in enumerate(zip(out, sigmas, strict=True)):
            with phase((number / len(out)) ** 2, ((number + 1) / len(out)) ** 2, _MESSAGE):
                smooth = self.vertices.spread(smooth, variance_of(sigma) - variance)
            variance = variance_of(sigma)
            target[:] = self.vertices.planes_of(smooth)
        return out

    def slopes(self, smooth: Singles) -> Singles:
        """Measure four times the squared gradient of values, averaged over channels."""
        vertices, mesh = self.vertices, self.vertices.mesh
        values, out = vertices.values_of(smooth), np.zeros(smooth[0].size, np.float32)
        with aside(_MESSAGE):
            run(_slopes, mesh.vertex_count, mesh.scaled_vertices, mesh.faces, mesh.normals,
                mesh.areas, vertices.trust, *mesh.corners, vertices.units, values, out)  # fmt: skip
        return out.reshape(smooth.shape[1:])

    def _found_ranges(self, reaches: tuple[int, ...]) -> tuple[Singles, Singles]:
        vertices = self.vertices
        values = vertices.values_of(self.values)
        both = np.ascontiguousarray(np.stack([values, values], axis=1))
        low, high = (np.zeros((len(reaches), *self.values.shape), np.float32) for _ in range(2))
        done = 0
        for r, reach in enumerate(reaches):
            with phase(done / reaches[-1], reach / reaches[-1], _MESSAGE):
                both = widened(vertices.windows, both, reach - done, _MESSAGE)
            low[r], high[r] = vertices.planes_of(both[:, 0]), vertices.planes_of(both[:, 1])
            done = reach
        return low, high

    def flowed(
        self,
        plan: Plan,
        brightness: Singles,
        passes: int,
        nearest: bool,
        part: Part | None,
    ) -> VertexPlanes:
        """Advect the values; each vertex gets the mean of its corners."""
        vertices, mesh = self.vertices, self.vertices.mesh
        values = vertices.values_of(self.values)
        with phase(0.0, 0.3, "Computing the flow"):
            guide = values @ brightness[:, None] if brightness.size else values
            potential = self._potential(guide, passes)
            wide = vertices.spread(potential, plan.passes * _PASS)
            shares = vertices.values_of(plan.shares[None])
            mixed = (potential + shares * (wide - potential))[:, 0].astype(np.float64)
        fourth = np.clip(vertices.units**2, _LEAST, _MOST)
        times = vertices.values_of(plan.times[None])[:, 0] * fourth
        with phase(0.3, 1.0, "Tracing flow-lines"):
            points, coordinates = corner_offsets(mesh)
            trace(mesh, mixed, times[mesh.faces.reshape(-1)], points, coordinates)
            given = values.astype(np.float64)
            ends = read_points(mesh, given, points, coordinates, nearest)
            moved = average_corners(mesh, ends, given)
        return self.with_values(vertices.planes_of(moved))

    def _potential(self, guide: Singles, passes: int) -> Singles:
        # The potential P of the smoothed guide, smoothed again: (n, 1).
        vertices, mesh = self.vertices, self.vertices.mesh
        smooth = vertices.spread(guide, passes * _PASS)
        potential = np.zeros((mesh.vertex_count, 1), np.float32)
        with aside("Computing the flow"):
            run(_potential, mesh.vertex_count, mesh.scaled_vertices, mesh.faces, mesh.areas,
                vertices.trust, *mesh.corners, smooth, potential)  # fmt: skip
        return vertices.spread(potential, passes * _PASS)


class _Means:
    # Implements `Surroundings` for vertices.

    def __init__(self, vertices: Vertices) -> None:
        self._vertices, self._means = vertices, vertices.means

    def means(self, count: int, energies: Callable[[int, int], Singles]) -> Singles:
        found = energies(0, self._vertices.rows)
        with aside(_MESSAGE):
            flat = found.reshape(len(found), -1)[:, : self._vertices.mesh.vertex_count]
            return self._means.means(flat)

    def smoothed(self, means: Singles, weighted: bool) -> Singles:
        with aside(_MESSAGE):
            return self._means.smoothed(means)

    def of_region(self, means: Singles, weighted: bool) -> Singles:
        with aside(_MESSAGE):
            return self._means.of_region(means)

    def rows(self, means: Singles, start: int, stop: int) -> Singles:
        out = np.zeros((len(means), (stop - start) * _ROW), np.float32)
        self._means.read(means, start * _ROW, out)
        return out.reshape(len(means), stop - start, _ROW)


@kernel
def _trust(start, stop, vertices, faces, areas, out):
    # Areas times 4 sqrt(3) area / (sum of squared sides), which is 1 for equilateral faces.
    for f in range(start, stop):
        squares = 0.0
        for k in range(3):
            e = edge(vertices, faces[f, k], faces[f, after(k)])
            squares += dot(e, e)
        out[f] = 4.0 * np.sqrt(3.0) * areas[f] * areas[f] / max(squares, 1e-300)


@kernel
def _slopes(start, stop, vertices, faces, normals, areas, trust, corner_start, corners, units,
            values, out):  # fmt: skip
    # Four times the square of the mean gradient of the faces around.
    c = values.shape[1]
    for v in range(start, stop):
        held = 0.0
        for i in range(corner_start[v], corner_start[v + 1]):
            held += trust[corners[i] // 3]
        out[v] = 0.0
        if held == 0:
            continue
        for j in range(c):
            x = y = z = 0.0
            for i in range(corner_start[v], corner_start[v + 1]):
                f = corners[i] // 3
                k = corners[i] - 3 * f
                a, b = faces[f, after(k)], faces[f, after(after(k))]
                if areas[f] == 0:
                    continue
                # Twice the gradient times the area is normal x w.
                p, q = values[a, j] - values[v, j], values[b, j] - values[v, j]
                s, t = edge(vertices, b, v), edge(vertices, v, a)
                w = (p * s[0] + q * t[0], p * s[1] + q * t[1], p * s[2] + q * t[2])
                g = cross(normals[f], w)
                share = trust[f] / areas[f]
                x += share * g[0]
                y += share * g[1]
                z += share * g[2]
            out[v] += (x * x + y * y + z * z) * units[v] / (held * held * c)


@kernel
def _potential(start, stop, vertices, faces, areas, trust, corner_start, corners, values, out):
    # The mean squared gradient of the faces around.
    for v in range(start, stop):
        held = total = 0.0
        for i in range(corner_start[v], corner_start[v + 1]):
            f = corners[i] // 3
            held += trust[f]
            total += trust[f] * squared_gradient(f, vertices, faces, areas, values)
        out[v, 0] = total / held if held > 0 else 0.0
