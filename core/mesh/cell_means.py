# SPDX-License-Identifier: GPL-3.0-or-later
"""Means over wide surroundings of vertices.

Vertices are gathered in cells of a grid in space, with edges of 4 and of 16 units of length: see
`spreading`. Parts in one cell that are not connected there are separate cells, so that means do not
pass through thin walls. Means are smoothed from cell to cell, and interpolated between the centres
of cells.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run, run_in_order
from ..base.progress import ask
from ..sparse.matrix import Sparse, added, from_triples, in_order, product
from .spreading import FASTEST, Graph, graph_of
from .triangle_mesh import Floats, Ints, TriangleMesh

Singles = npt.NDArray[np.float32]

FINE, RATIO = 4.0, 4
"""Edge of a small cell, in units, and that of a large cell in small ones."""

WIDE, REGION = 8.0, 32.0
"""Standard deviations of the two smoothings, in units."""

_AWAY = 0.37
"""Offset of the cells, so that the vertices of regular grids do not lie on their borders."""

_READ = 1.5
"""Means are interpolated from cells whose centres are within this distance, in edges of a cell."""

_BITS = 19


class CellMeans:
    """Means over the surroundings of the vertices of a mesh.

    Means of k energies in n cells are (k, 1, n) float32.

    Parameters
    ----------
    mesh : TriangleMesh
    units : (n,) float64
        Squared units of length.
    weights : (k,) float64
        Cotangent weights of ``mesh.neighbours``.
    masses : (n,) float64
        Areas of the vertices.
    message : str
    """

    def __init__(
        self, mesh: TriangleMesh, units: Floats, weights: Floats, masses: Floats, message: str
    ) -> None:
        self._message = message
        self._places, self._units, self._masses = mesh.scaled_vertices, units, masses
        keys = np.empty((mesh.vertex_count, 2), np.int64)
        run(_find_keys, mesh.vertex_count, mesh.scaled_vertices, units, keys)
        start, ring = mesh.neighbours
        self._fine, count = _parts(start, ring, np.ascontiguousarray(keys[:, 0]))
        ask()
        self._held = _summed(self._fine, masses, count)
        lengths = np.empty(len(ring))
        run(_measure, mesh.vertex_count, mesh.scaled_vertices, start, ring, weights, lengths)
        self._middles = _averaged(self._fine, masses, self._held, mesh.scaled_vertices)
        ask()
        owners = np.repeat(self._fine, np.diff(start))
        contacts = _contacts(owners, self._fine[ring], lengths, count)
        ask()
        own = _summed(self._fine, masses / units, count)  # areas in local units
        self._walk = _cell_graph(contacts, self._middles, own, FINE)
        coarse_keys = np.empty(count, np.int64)
        coarse_keys[self._fine] = keys[:, 1]
        self._parents, coarse_count = _parts(contacts.start, contacts.columns, coarse_keys)
        ask()
        self._coarse_held = _summed(self._parents, self._held, coarse_count)
        middles = _averaged(self._parents, self._held, self._coarse_held, self._middles)
        owners = np.repeat(self._parents, np.diff(contacts.start))
        coarse = _contacts(owners, self._parents[contacts.columns], contacts.values, coarse_count)
        self._coarse_walk = _cell_graph(
            coarse, middles, _summed(self._parents, own, coarse_count), RATIO * FINE
        )
        near = contacts._replace(values=np.ones(len(contacts.values)))
        self._near = in_order(added(product(near, near), near))[:2]

    def means(self, energies: Singles) -> Singles:
        """Average energies of vertices over the small cells: (k, n) -> (k, 1, cells)."""
        out = np.empty((len(energies), 1, len(self._held)), np.float32)
        for row, energy in zip(out, energies, strict=True):
            ask()
            row[0] = _divided(
                _summed(self._fine, energy * self._masses, len(self._held)), self._held
            )
        return out

    def smoothed(self, means: Singles) -> Singles:
        """Smooth means with a standard deviation of 8 units."""
        return self._spread(self._walk, means[:, 0], WIDE**2)[:, None]

    def of_region(self, means: Singles) -> Singles:
        """Smooth means with a standard deviation of 32 units."""
        sums = self._region_sums(means[:, 0] * self._held)
        rows = _divided(sums, self._coarse_held).astype(np.float32)
        rows = self._spread(self._coarse_walk, rows, REGION**2 - WIDE**2)
        return self._spread(self._walk, rows[:, self._parents], WIDE**2)[:, None]

    def _region_sums(self, rows: npt.NDArray) -> Floats:
        # Adds up values of small cells in the large ones: (k, n) -> (k, m).
        count = len(self._coarse_held)
        return np.stack([_summed(self._parents, row, count) for row in rows])

    def of_large_cells(self, values: npt.NDArray) -> tuple[Floats, Floats]:
        """Average values of vertices, (n,), over the large cells; returns means and areas."""
        fine = _summed(self._fine, values * self._masses, len(self._held))
        (sums,) = self._region_sums(fine[None])
        held = self._coarse_held
        return sums[held > 0] / held[held > 0], held[held > 0]

    def read(self, means: Singles, first: int, out: Singles) -> None:
        """Interpolate means at the vertices from `first` on, into `out` (k, n)."""
        stop = min(first + out.shape[1], len(self._fine))
        _read(first, stop, self._places, self._units, self._fine, *self._near, self._middles,
              np.ascontiguousarray(means[:, 0].T), out)  # fmt: skip

    def _spread(self, graph: Graph, rows: Singles, variance: float) -> Singles:
        spread = graph.spread(np.ascontiguousarray(rows.T), variance, self._message)
        return np.ascontiguousarray(np.maximum(spread, 0).T)


def _parts(start: Ints, others: Ints, keys: npt.NDArray[np.int64]) -> tuple[Ints, int]:
    count = len(keys)
    part, number = np.full(count, -1, np.int32), np.zeros(1, np.int32)
    run_in_order(_flood, count, start, others, keys, part, number, np.empty(count, np.int32))
    return part, int(number[0])


def _summed(groups: Ints, rows: npt.NDArray, count: int) -> Floats:
    return np.bincount(groups, rows, count).astype(np.float64)


def _averaged(groups: Ints, masses: Floats, held: Floats, places: Floats) -> Floats:
    # Vertices without mass have equal weights.
    alike = _summed(groups, np.ones(len(groups)), len(held))
    out = np.empty((len(held), places.shape[1]))
    for x in range(places.shape[1]):
        plain = _summed(groups, places[:, x], len(held)) / np.maximum(alike, 1)
        sums = _summed(groups, masses * places[:, x], len(held))
        out[:, x] = np.where(held > 0, sums / np.where(held > 0, held, 1), plain)
    return out


def _divided(sums: Floats, held: Floats) -> Floats:
    return np.where(held > 0, sums / np.where(held > 0, held, 1), 0.0)


def _contacts(one: Ints, other: Ints, weights: Floats, count: int) -> Sparse:
    apart = one != other
    return from_triples(one[apart], other[apart], weights[apart], (count, count))


def _cell_graph(contacts: Sparse, middles: Floats, held: Floats, side: float) -> Graph:
    weights = np.empty(len(contacts.values))
    run(_conduct, len(held), *contacts[:3], middles, weights)
    return graph_of(contacts.start, contacts.columns, weights, held, FASTEST / side**2)


@kernel
def _find_keys(start, stop, vertices, units, keys):
    # The level of a vertex, by the size of its unit, and its cell: small and large.
    for v in range(start, stop):
        level = int(np.floor(0.5 * np.log2(units[v]) + 0.5))
        side = FINE * 2.0**level
        fine, coarse = np.int64(level & 63), np.int64(level & 63)
        for x in range(3):
            place = np.int64(np.floor(vertices[v, x] / side + _AWAY))
            large = place // RATIO
            fine = (fine << _BITS) | (place & ((1 << _BITS) - 1))
            coarse = (coarse << _BITS) | (large & ((1 << _BITS) - 1))
        keys[v, 0], keys[v, 1] = fine, coarse


@kernel
def _flood(start, stop, begin, others, keys, part, number, queue):
    for seed in range(start, stop):
        if part[seed] >= 0:
            continue
        part[seed] = number[0]
        queue[0] = seed
        head, tail = 0, 1
        while head < tail:
            v = queue[head]
            head += 1
            for i in range(begin[v], begin[v + 1]):
                u = others[i]
                if part[u] < 0 and keys[u] == keys[v]:
                    part[u] = number[0]
                    queue[tail] = u
                    tail += 1
        number[0] += 1


@kernel
def _measure(start, stop, vertices, ring_start, ring, weights, lengths):
    # The conductance of each edge times its length.
    for v in range(start, stop):
        for i in range(ring_start[v], ring_start[v + 1]):
            total = 0.0
            for x in range(3):
                total += (vertices[ring[i], x] - vertices[v, x]) ** 2
            lengths[i] = weights[i] * np.sqrt(total)


@kernel
def _conduct(start, stop, begin, others, lengths, middles, weights):
    for a in range(start, stop):
        for i in range(begin[a], begin[a + 1]):
            total = 0.0
            for x in range(3):
                total += (middles[others[i], x] - middles[a, x]) ** 2
            weights[i] = lengths[i] / max(np.sqrt(total), 1e-12)


@kernel
def _read(first, last, places, units, owners, begin, others, middles, means, out):
    # Used for as many vertices as the caller takes between two checks for cancelling.
    count = means.shape[1]
    sums = np.empty(count, np.float32)
    for v in range(first, last):
        own = owners[v]
        # Means reach zero weight where their cells' middles are too far away.
        scale = 1.0 / (_READ * FINE) ** 2 / units[v]
        total = 0.0
        sums[:] = 0
        for i in range(begin[own] - 1, begin[own + 1]):
            cell = own if i < begin[own] else others[i]
            if i >= begin[own] and cell == own:
                continue
            square = 0.0
            for x in range(3):
                square += (middles[cell, x] - places[v, x]) ** 2
            weight = max(1.0 - scale * square, 0.0) ** 2
            if i < begin[own]:
                weight += 1e-3
            if weight > 0:
                total += weight
                w = np.float32(weight)
                for k in range(count):
                    sums[k] += w * means[cell, k]
        inverse = np.float32(1.0 / total)
        for k in range(count):
            out[k, v - first] = inverse * sums[k]
