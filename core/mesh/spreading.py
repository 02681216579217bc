# SPDX-License-Identifier: GPL-3.0-or-later
"""Smoothing by heat diffusion on graphs, of the vertices of a mesh or of cells of vertices.

Not in the papers. Lengths are in a local unit at each vertex: the square root of the area per
vertex, so that the vertices of a grid of unit squares are one unit apart. Heat flows along edges by
their cotangent weights; after a time of half a variance, it has spread by that variance in each
direction, however the vertices lie. Long times take far fewer steps than explicit ones would, by
Legendre polynomials (Meyer, Balsara and Aslam, 2014: super-time-stepping).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..base.progress import phase
from ..base.vectors import dot, edge
from .calculus import cotangents, stiffness_weights
from .triangle_mesh import Floats, Ints, TriangleMesh

Singles = npt.NDArray[np.float32]

FASTEST = 12.0
"""Largest sum of the rates of a vertex: 3 times that on a grid of squares. Needle-like faces would
exceed it and need many more steps, so their vertices exchange less."""

MOST_SPREAD = 8.0
"""Largest variance per time by one edge: its rate times its squared length. On an even mesh the sum
over the edges of a vertex is 4; with needle-like faces it would be hundreds and more."""

_PLAIN = 4
"""Most explicit steps; longer times use Legendre polynomials."""

_ROUNDS = 3
"""Rounds of these: the kernel of a single one is a ring, not a Gaussian."""

_EVEN = 3
"""Smoothing passes over the areas of vertices."""


@dataclass(frozen=True)
class Graph:
    """The rates of heat exchange between neighbours.

    Attributes
    ----------
    start : (n + 1,) int32
    others : (k,) int32
        Neighbours of each: ``others[start[i]:start[i + 1]]``.
    rates : (k,) float32
        Share of the difference to each neighbour that flows in a unit of time.
    most, fastest : float
        Upper limit of the sum of rates of a vertex, and the largest sum there is.
    """

    start: Ints
    others: Ints
    rates: Singles
    most: float
    fastest: float

    def spread(self, values: Singles, variance: float, message: str) -> Singles:
        """Smooth values (n, k) by a variance; constants stay bit for bit."""
        if self.fastest == 0 or variance == 0 or not values.size:
            return values
        time = 0.5 * variance
        plain = math.ceil(time * self.most)
        # A few explicit steps damp variations between vertices as sampled Gaussians do.
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
    """Make a graph of symmetric weights and masses, with more mass where rates exceed `most`.

    Changing masses and not weights keeps linear functions unchanged wherever the weights do.
    """
    count = len(masses)
    rates, sums = np.empty(len(others), np.float32), np.empty(count)
    run(_rate, count, start, weights, masses, most, rates, sums)
    return Graph(start, others, rates, most, float(sums.max(initial=0.0)))


def squared_units(mesh: TriangleMesh) -> Floats:
    """Measure the area per vertex, in squared mean edge lengths: (n,), 1 without faces.

    It is twice the mean area of the faces around, because a mesh has two faces for each vertex.
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


def vertex_graph(mesh: TriangleMesh, areas: Floats, units: Floats) -> tuple[Graph, Floats]:
    """Return the graph of the vertices, and the weights of ``mesh.neighbours``.

    Negative cotangent weights become 0, so that results stay in the range of the input. Weights are
    limited by the squared length of the edge: in needle-like faces, heat would flow from one end to
    the other.

    Parameters
    ----------
    mesh : TriangleMesh
    areas : (n,) float64
        Areas of the vertices, in squared mean edge lengths.
    units : (n,) float64
        Squared units of length, as from `squared_units`.
    """
    start, others, weights, _ = stiffness_weights(
        mesh, cotangents(mesh), np.zeros(mesh.vertex_count)
    )
    run(_limit, mesh.vertex_count, mesh.scaled_vertices, start, others, areas, weights)
    return graph_of(start, others, weights, areas / units), weights


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
def _limit(start, stop, vertices, ring_start, ring, areas, weights):
    for v in range(start, stop):
        for i in range(ring_start[v], ring_start[v + 1]):
            e = edge(vertices, v, ring[i])
            most = MOST_SPREAD * min(areas[v], areas[ring[i]]) / max(dot(e, e), 1e-300)
            weights[i] = min(max(weights[i], 0.0), most)


@kernel
def _rate(start, stop, ring_start, weights, masses, most, rates, sums):
    for v in range(start, stop):
        total = 0.0
        for i in range(ring_start[v], ring_start[v + 1]):
            total += weights[i]
        mass = max(masses[v], total / most, 1e-300)
        for i in range(ring_start[v], ring_start[v + 1]):
            rates[i] = weights[i] / mass
        sums[v] = total / mass


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
