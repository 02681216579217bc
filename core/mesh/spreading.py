# SPDX-License-Identifier: GPL-3.0-or-later
"""Smoothing by the flow of heat on graphs: vertices of a mesh, or cells of these.

Not in the papers. Lengths are in units of each vertex's own surroundings: the square root of the
area that it has there, so that the vertices of a grid of unit squares lie one unit apart. Heat
flows along edges by their cotangent weights; after a time of half a variance it has spread by that
variance, along each direction, however the vertices lie. Long times take far fewer steps than plain
ones would, by Legendre polynomials (Meyer, Balsara and Aslam, 2014: super-time-stepping).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..base.progress import phase
from ..base.vectors import dot, edge
from .calculus import cotangents, lumped_mass, stiffness_weights
from .triangle_mesh import Floats, Ints, TriangleMesh

Singles = npt.NDArray[np.float32]

FASTEST = 12.0
"""The most heat per time that a vertex exchanges: 3 times as much as on a grid of squares. Needles
would need many more steps; their edges conduct less."""

_PLAIN = 4
"""Up to so many plain steps are taken."""

_ROUNDS = 3
"""Rounds of many steps: the kernel of a single one is a ring, not a Gaussian."""

_EVEN = 3
"""Passes that even out the area of vertices."""


@dataclass(frozen=True)
class Graph:
    """What exchanges heat with what.

    Attributes
    ----------
    start : (n + 1,) int32
    others : (k,) int32
        Neighbours of each: ``others[start[i]:start[i + 1]]``.
    rates : (k,) float32
        The share of the difference to each that flows in a unit of time.
    most, fastest : float
        The most that the sum of the rates of one may be, and the greatest there is.
    """

    start: Ints
    others: Ints
    rates: Singles
    most: float
    fastest: float

    def spread(self, values: Singles, variance: float, message: str) -> Singles:
        """Smooth values (n, k) by a variance; constants stay bit for bit."""
        if self.fastest == 0 or not values.size:
            return values
        time = 0.5 * variance
        plain = math.ceil(time * self.most)
        # Few plain steps fade what varies from vertex to vertex as sampled Gaussians do.
        rounds, work = (plain, 1) if plain <= _PLAIN else (_ROUNDS, time * self.fastest / _ROUNDS)
        steps = max(math.ceil(math.sqrt(2.0 * work + 0.25) - 0.5), 1)
        share = time / rounds * 2 / (steps * steps + steps)
        total, spare = rounds * steps, None
        newest = older = values
        for done in range(total):
            step = done % steps + 1
            if step == 1:
                older = newest
            out = np.empty_like(values) if spare is None else spare
            with phase(done / total, (done + 1) / total, message):
                run(_step, len(values), self.start, self.others.view(np.uint32), self.rates,
                    np.float32(share), np.float32(2 - 1 / step), newest, older, out)  # fmt: skip
            free = older is not values and older is not newest
            spare = older if free else None  # the caller's array is never written to
            older, newest = newest, out
        return newest


def graph_of(
    start: Ints, others: Ints, weights: Floats, masses: Floats, most: float = FASTEST
) -> Graph:
    """Make a graph of symmetric weights and of masses; none exchanges more than `most`."""
    count = len(masses)
    limits, rates = np.empty(count), np.empty(len(others), np.float32)
    run(_limit, count, start, weights, masses, most, limits)
    run(_rate, count, start, others, weights, masses, limits, rates)
    sums = np.empty(count)
    run(_sum, count, start, rates, sums)
    return Graph(start, others, rates, most, float(sums.max(initial=0.0)))


def squared_units(mesh: TriangleMesh) -> Floats:
    """Measure the area that a vertex has, in squared mean edge lengths: (n,), 1 without faces.

    Twice the mean area of the faces around: a mesh has two faces for each vertex.
    """
    values = np.empty(mesh.vertex_count)
    areas = mesh.areas
    for number in range(_EVEN):
        run(_mean_area, mesh.vertex_count, *mesh.corners, areas, values)
        if number + 1 < _EVEN:
            areas = np.empty(mesh.face_count)
            run(_area_of_corners, mesh.face_count, mesh.faces, mesh.areas, values, areas)
    values *= 2
    values[values == 0] = 1.0
    return values


def vertex_graph(mesh: TriangleMesh, units: Floats) -> tuple[Graph, Floats]:
    """Return the graph of the vertices, and what each edge conducts, beside its neighbours.

    Parameters
    ----------
    mesh : TriangleMesh
    units : (n,) float64
        Squared units of length.
    """
    start, others, weights, _ = stiffness_weights(
        mesh, cotangents(mesh), np.zeros(mesh.vertex_count)
    )
    run(_conduct, mesh.vertex_count, start, others, units, weights)
    return graph_of(start, others, weights, lumped_mass(mesh)), weights


@kernel
def _mean_area(start, stop, corner_start, corners, areas, out):
    for v in range(start, stop):
        total, count = 0.0, 0
        for i in range(corner_start[v], corner_start[v + 1]):
            area = areas[corners[i] // 3]
            total += area
            count += area > 0
        out[v] = total / max(count, 1)


@kernel
def _area_of_corners(start, stop, faces, areas, values, out):
    for f in range(start, stop):
        out[f] = 0.0
        if areas[f] > 0:
            out[f] = (values[faces[f, 0]] + values[faces[f, 1]] + values[faces[f, 2]]) / 3.0


@kernel
def _conduct(start, stop, ring_start, ring, units, weights):
    for v in range(start, stop):
        for i in range(ring_start[v], ring_start[v + 1]):
            weights[i] = max(weights[i], 0.0) * 0.5 * (units[v] + units[ring[i]])


@kernel
def _limit(start, stop, ring_start, weights, masses, most, limits):
    # What each takes of its weights.
    for v in range(start, stop):
        total = 0.0
        for i in range(ring_start[v], ring_start[v + 1]):
            total += weights[i]
        limits[v] = min(most * masses[v] / max(total, 1e-300), 1.0)


@kernel
def _rate(start, stop, ring_start, ring, weights, masses, limits, rates):
    for v in range(start, stop):
        for i in range(ring_start[v], ring_start[v + 1]):
            limit = min(limits[v], limits[ring[i]])
            rates[i] = limit * weights[i] / max(masses[v], 1e-300)


@kernel
def _sum(start, stop, ring_start, rates, sums):
    for v in range(start, stop):
        sums[v] = 0.0
        for i in range(ring_start[v], ring_start[v + 1]):
            sums[v] += rates[i]


@kernel
def _step(start, stop, ring_start, ring, rates, time, factor, newest, older, out):
    # The next of the polynomials P_k(A), A = 1 + time * (exchange), from the last two.
    k = newest.shape[1]
    less = np.float32(1) - factor
    total = np.empty(k, np.float32)
    for v in range(start, stop):
        own = newest[v]
        total[:] = 0
        for i in range(ring_start[v], ring_start[v + 1]):
            other, rate = newest[ring[i]], rates[i]
            for j in range(k):
                total[j] += rate * (other[j] - own[j])
        for j in range(k):
            change = factor * time * total[j] - less * (own[j] - older[v, j])
            out[v, j] = own[j] + change
