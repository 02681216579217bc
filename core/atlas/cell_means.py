# SPDX-License-Identifier: GPL-3.0-or-later
"""Means over wide surroundings on a sheet of texels, across seams.

The nodes of each chart are gathered in squares of 4, and of 16, texels. Means over the squares are
smoothed along their contacts: pairs of neighbouring nodes of two squares, also those across seams.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..base.progress import ask
from ..mesh.triangle_mesh import Ints
from ..sparse.matrix import Sparse, added, applied, diagonal_matrix, from_triples, row_sums
from .atlas import TextureAtlas
from .ghosts import chart_of, nearest_nodes
from .sheet import NOTHING, ROWS, Sheet

Singles = npt.NDArray[np.float32]

FINE, COARSE = 4, 16
"""Sides of the squares, in texels."""

_PASSES = 10
"""Smoothing passes, with a weight of 1/5 for a square and each full neighbour: the variance is 4
squares."""

_INJECTED = 5
"""Passes over the fine squares, after means of the coarse squares are copied to them."""


@dataclass(frozen=True)
class Squares:
    """Squares of texels, each of one chart.

    Attributes
    ----------
    side : int
    starts : (places + 1,) int32
        The first square at each place of the sheet, row by row. Each chart has squares at all
        places that its nodes and ghosts touch, and at the places next to these.
    labels : (n,) int32
        The chart of each square.
    owners : (rows, columns) int32
        The square of each node inside a chart; elsewhere `NOTHING`.
    counts : (n,) int64
        Nodes in each square.
    """

    side: int
    starts: Ints
    labels: Ints
    owners: Ints
    counts: npt.NDArray[np.int64]


class CellMeans:
    """Means over the surroundings of the nodes of an atlas.

    Means of k energies at the n squares are (k, 1, n) float32.
    """

    def __init__(self, atlas: TextureAtlas) -> None:
        sheet = atlas.sheet
        labels = atlas.charts.labels
        nearest = nearest_nodes(sheet, atlas.sources)
        self._sheet = sheet
        self._fine = _squares(sheet, labels, FINE)
        ask()
        coarse = _squares(sheet, labels, COARSE)
        ask()
        self._fine_walk = _walk(self._fine, sheet, nearest)
        self._coarse_walk = _walk(coarse, sheet, nearest)
        self._parents = _parents(self._fine, coarse)
        self._coarse_count = len(coarse.labels)
        # Squares without nodes hold the means beyond the seam, at the ghosts near them.
        beyond = nearest[sheet.ghosts]
        ghosts = np.flatnonzero(beyond >= 0)
        beyond = self._fine.owners.reshape(-1)[beyond[ghosts]]
        near = np.empty((len(ghosts), 9), np.int32)
        run(_near_ghosts, len(ghosts), ghosts, sheet, labels, FINE, self._fine.starts,
            self._fine.labels, near)  # fmt: skip
        empty = (near >= 0) & (self._fine.counts[near] == 0)
        self._filled = near[empty]
        self._sources = np.broadcast_to(beyond[:, None], near.shape)[empty]
        self._times_filled = np.bincount(self._filled, minlength=len(self._fine.labels))
        nowhere = (self._fine.counts == 0) & (self._times_filled == 0)
        self._fine.labels[nowhere] = NOTHING  # nothing is read where the surface ends

    def means(self, energies: Singles) -> Singles:
        """Average energies of nodes over the fine squares: (k, rows, columns) -> (k, 1, n)."""
        owners = self._fine.owners.reshape(-1)
        out = np.empty((len(energies), 1, len(self._fine.labels)), np.float32)
        run(_average, len(energies), energies.reshape(len(energies), -1), owners,
            self._fine.counts, out[:, 0], chunk=1)  # fmt: skip
        return out

    def smoothed(self, means: Singles) -> Singles:
        """Smooth means over about 8 texels in each direction, as a standard deviation."""
        return self._filled_in(_walked(self._fine_walk, means[:, 0], _PASSES))[:, None]

    def of_region(self, means: Singles) -> Singles:
        """Smooth means over about 32 texels."""
        counts = self._fine.counts
        sums = np.stack([
            np.bincount(self._parents, row * counts, self._coarse_count) for row in means[:, 0]
        ])  # fmt: skip
        held = np.bincount(self._parents, counts, self._coarse_count)
        coarse = np.divide(sums, held, out=np.zeros_like(sums), where=held > 0)
        coarse = _walked(self._coarse_walk, coarse.astype(np.float32), _PASSES)
        return self._filled_in(_walked(self._fine_walk, coarse[:, self._parents], _INJECTED))[
            :, None
        ]

    def rows(self, means: Singles, start: int, stop: int) -> Singles:
        """Interpolate means between centres of squares: (k, rows, columns); 0 outside charts."""
        out = np.zeros((len(means), stop - start, self._sheet.nodes.shape[1]), np.float32)
        fine = self._fine
        _read(start, stop, self._sheet, fine.starts, fine.labels, fine.owners, means[:, 0], out)
        return out

    def _filled_in(self, values: Singles) -> Singles:
        counts = self._times_filled
        for row in values:
            sums = np.bincount(self._filled, row[self._sources], len(counts))
            np.divide(sums, counts, out=row, where=counts > 0, casting="unsafe")
        return values


def _squares(sheet: Sheet, labels: Ints, side: int) -> Squares:
    shape = sheet.nodes.shape
    down, across = (-(-n // side) for n in shape)
    numbers = np.zeros(down * across + 1, np.int32)
    nothing = np.empty(0, np.int32)
    run(_find_squares, down, sheet, labels, side, numbers, nothing, chunk=8)
    starts = np.cumsum(numbers, dtype=np.int64).astype(np.int32)
    found = np.empty(starts[-1], np.int32)
    run(_find_squares, down, sheet, labels, side, starts, found, chunk=8)
    owners = np.empty(shape, np.int32)
    run(_own, shape[0], sheet, labels, side, starts, found, owners, chunk=ROWS)
    inside = owners.reshape(-1)
    counts = np.bincount(inside[inside >= 0], minlength=len(found))
    return Squares(side, starts, found, owners, counts)


def _walk(squares: Squares, sheet: Sheet, nearest: Ints) -> Sparse:
    """The share that each square gives itself and others in a pass; rows add up to 1."""
    owners = squares.owners
    beyond = np.where(nearest >= 0, owners.reshape(-1)[nearest], NOTHING).reshape(owners.shape)
    one, other = _contacts(owners, beyond)
    n = len(squares.labels)
    contacts = from_triples(one, other, np.full(len(one), float(squares.side)), (n, n))
    walk = added(contacts, diagonal_matrix(np.maximum(squares.counts, 1).astype(np.float64)))
    shares = walk.values / np.repeat(row_sums(walk), np.diff(walk.start))
    return walk._replace(values=shares.astype(np.float32))


def _walked(walk: Sparse, values: Singles, passes: int) -> Singles:
    each = np.ascontiguousarray(values.T)
    for number in range(passes):
        ask(number / passes)
        each = applied(walk, each)
    return np.ascontiguousarray(each.T)


def _parents(fine: Squares, coarse: Squares) -> Ints:
    # The coarse square of each fine one.
    across = -(-fine.owners.shape[1] // fine.side)
    wide = -(-coarse.owners.shape[1] // coarse.side)
    parents = np.empty(len(fine.labels), np.int32)
    _find_parents(fine.starts, fine.labels, coarse.starts, coarse.labels, across, wide,
                  coarse.side // fine.side, parents)  # fmt: skip
    return parents


@kernel
def _find_squares(start, stop, sheet, labels, side, starts, found):
    # Writes how many squares there are at each place, or their charts if these fit into `found`.
    rows, columns = sheet.nodes.shape
    across = -(-columns // side)
    here = np.empty(9 * side * side, np.int32)
    for b in range(start, stop):
        for a in range(across):
            count = 0
            for y in range(max((b - 1) * side, 0), min((b + 2) * side, rows)):
                last = NOTHING
                for x in range(max((a - 1) * side, 0), min((a + 2) * side, columns)):
                    label = chart_of(sheet, labels, y, x)
                    if label == last or label == NOTHING:
                        continue
                    last = label
                    known = False
                    for i in range(count):
                        if here[i] == label:
                            known = True
                            break
                    if not known:
                        here[count] = label
                        count += 1
            place = b * across + a
            if found.size == 0:
                starts[place + 1] = count
                continue
            for i in range(count):
                found[starts[place] + i] = here[i]


@kernel
def _square_at(starts, found, place, label):
    for square in range(starts[place], starts[place + 1]):
        if found[square] == label:
            return square
    return NOTHING


@kernel
def _own(start, stop, sheet, labels, side, starts, found, owners):
    across = -(-sheet.nodes.shape[1] // side)
    for y in range(start, stop):
        for x in range(sheet.nodes.shape[1]):
            face = sheet.nodes[y, x]
            owners[y, x] = NOTHING
            if face >= 0:
                place = y // side * across + x // side
                owners[y, x] = _square_at(starts, found, place, labels[face])


@kernel
def _near_ghosts(start, stop, ghosts, sheet, labels, side, starts, found, out):
    rows, columns = sheet.nodes.shape
    down, across = -(-rows // side), -(-columns // side)
    for i in range(start, stop):
        y, x = divmod(sheet.ghosts[ghosts[i]], columns)
        label = chart_of(sheet, labels, y, x)
        for n in range(9):
            b, a = y // side + n // 3 - 1, x // side + n % 3 - 1
            out[i, n] = NOTHING
            if label != NOTHING and 0 <= b < down and 0 <= a < across:
                out[i, n] = _square_at(starts, found, b * across + a, label)


@kernel
def _find_parents(starts, labels, coarse_starts, coarse_labels, across, wide, ratio, parents):
    for place in range(len(starts) - 1):
        b, a = divmod(place, across)
        coarse = b // ratio * wide + a // ratio
        for square in range(starts[place], starts[place + 1]):
            parents[square] = _square_at(coarse_starts, coarse_labels, coarse, labels[square])


@kernel
def _contacts(owners, beyond):
    # Pairs of squares whose nodes are adjacent; a ghost stands for the node across the seam.
    rows, columns = owners.shape
    count = 0
    for once in range(2):
        if once == 1:
            one, other = np.empty(count, np.int32), np.empty(count, np.int32)
            count = 0
        for y in range(rows):
            for x in range(columns):
                own = owners[y, x]
                if own < 0:
                    continue
                for k in range(4):
                    b, a = y + (k == 0) - (k == 1), x + (k == 2) - (k == 3)
                    its = beyond[b, a]
                    if its >= 0 and its != own:
                        if once == 1:
                            one[count], other[count] = own, its
                        count += 1
    return one, other


@kernel
def _average(start, stop, energies, owners, counts, out):
    sums = np.empty(len(counts))
    for k in range(start, stop):
        sums[:] = 0
        for i in range(len(owners)):
            if owners[i] >= 0:
                sums[owners[i]] += energies[k, i]
        for n in range(len(counts)):
            out[k, n] = sums[n] / max(counts[n], 1)


@kernel
def _read(start, stop, sheet, starts, found, owners, means, out):
    columns = sheet.nodes.shape[1]
    across = -(-columns // FINE)
    last = -(-sheet.nodes.shape[0] // FINE) - 1
    half = np.float32(0.5)
    squares, weights = np.zeros((4, columns), np.int32), np.empty((4, columns), np.float32)
    for y in range(start, stop):
        down = (y + half) / np.float32(FINE) - half
        top = int(np.floor(down))
        down -= np.float32(top)
        weights[:] = 0
        for x in range(columns):
            own = owners[y, x]
            if own < 0:
                continue
            right = (x + half) / np.float32(FINE) - half
            left = int(np.floor(right))
            right -= np.float32(left)
            for n in range(4):
                b, a = top + n // 2, left + n % 2
                squares[n, x] = own
                if 0 <= b <= last and 0 <= a < across:
                    there = _square_at(starts, found, b * across + a, found[own])
                    squares[n, x] = there if there >= 0 else own
                weight = down if n >= 2 else np.float32(1) - down
                weights[n, x] = weight * (right if n % 2 == 1 else np.float32(1) - right)
        for k in range(len(means)):
            row, values = out[k, y - start], means[k]
            for n in range(4):
                square, weight = squares[n], weights[n]
                for x in range(columns):
                    row[x] += weight[x] * values[square[x]]
