# SPDX-License-Identifier: GPL-3.0-or-later
"""Averages over a grid of cells, for surroundings wider than a few rings of neighbours."""

from __future__ import annotations

from itertools import product

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run, run_in_order
from ..base.progress import ask

Floats = npt.NDArray[np.float64]

_CORNERS = np.array(list(product((0, 1), repeat=3)))
"""Corners of a cell; the last axis changes fastest."""

_MOST_CELLS = 5e5
"""Most cells along an axis, from the origin, so that a 64-bit number can index them all."""


class MeansAround:
    """Weighted averages of values around points, at a cost that does not depend on the radius.

    Each value is added to the eight corners of its cell by trilinear weights. Two passes of
    (1, 2, 1) / 4 along each axis smooth these sums, and a trilinear lookup reads them. So the
    weights are nearly isotropic, although the grid is aligned with the axes and the origin.

    Parameters
    ----------
    places : (n, 3) float64
        The points.
    values : (n, d) float64
    size : float
        Width of two cells, in the unit of the points. The weights have a standard deviation of
        0.58 times this along each axis. Cells are larger if the points lie very far apart.
    """

    def __init__(self, places: Floats, values: Floats, size: float) -> None:
        self._places = places
        # Column by column, which is faster than along axis 0.
        least, most = np.array([(column.min(), column.max()) for column in places.T]).T
        farthest = float(np.abs([least, most]).max())
        self._size = size = max(0.5 * size, farthest / _MOST_CELLS)
        self._low = low = np.floor(least / size) * size
        span = np.floor((most - low) / size).astype(np.int64) + 3
        keys = np.empty(len(places), dtype=np.int64)
        run(_number, len(places), places, low, size, span, keys)
        used, self._cell = _numbered(keys)
        ask()
        lengths = np.array([span[1] * span[2], span[2], 1])
        around = used[:, None] + _CORNERS @ lengths
        corners, index = _numbered(around.reshape(-1))
        self._index = index.reshape(around.shape).astype(np.int32)
        ask()
        sums = np.zeros((len(corners), values.shape[1] + 1))
        run_in_order(_add_up, len(places), places, low, size, self._index, self._cell, values,
                     sums)  # fmt: skip
        beside = [_beside(corners, length) for length in lengths]
        for _ in range(2):
            for axis in range(3):
                smooth = np.empty_like(sums)
                run(_smooth, len(sums), beside[axis], sums, smooth)
                sums = smooth
        self._sums = sums

    def at(self, rows: npt.NDArray[np.integer]) -> Floats:
        """Return the averages around some of the points, by index: (k, d)."""
        out = np.empty((len(rows), self._sums.shape[1] - 1))
        run(_read, len(rows), rows, self._places, self._low, self._size, self._index, self._cell,
            self._sums, out)  # fmt: skip
        return out


def _beside(corners: npt.NDArray[np.int64], step: int) -> npt.NDArray[np.int32]:
    # The indices of the corners before and after each one along an axis; -1 if there is none.
    found = np.empty((len(corners), 2), dtype=np.int32)
    for k, way in enumerate((-step, step)):
        at = np.minimum(np.searchsorted(corners, corners + way), len(corners) - 1)
        found[:, k] = np.where(corners[at] == corners + way, at, -1)
    return found


def _numbered(keys: npt.NDArray[np.int64]) -> tuple[npt.NDArray[np.int64], npt.NDArray]:
    # The unique keys, sorted, and the index of each key among them.
    most = int(keys.max()) + 1
    if most > 16 * len(keys) + 4096:
        return np.unique(keys, return_inverse=True)
    found = np.zeros(most, dtype=np.bool_)
    found[keys] = True
    used = np.flatnonzero(found)
    number = np.empty(most, dtype=np.int32)
    number[used] = np.arange(len(used), dtype=np.int32)
    return used, number[keys]


@kernel
def _number(start, stop, places, low, size, span, keys):
    for v in range(start, stop):
        x = int((places[v, 0] - low[0]) / size)
        y = int((places[v, 1] - low[1]) / size)
        z = int((places[v, 2] - low[2]) / size)
        keys[v] = (x * span[1] + y) * span[2] + z


@kernel
def _within_cell(v, places, low, size):
    # The place of a point in its cell, from 0 to 1 along each axis.
    x = (places[v, 0] - low[0]) / size
    y = (places[v, 1] - low[1]) / size
    z = (places[v, 2] - low[2]) / size
    return x - int(x), y - int(y), z - int(z)


@kernel
def _share(c, place):
    # The trilinear weight, for a point, of corner c of its cell.
    x = place[0] if c & 4 else 1.0 - place[0]
    y = place[1] if c & 2 else 1.0 - place[1]
    z = place[2] if c & 1 else 1.0 - place[2]
    return x * y * z


@kernel
def _add_up(start, stop, places, low, size, index, cell, values, sums):
    count = values.shape[1]
    for v in range(start, stop):
        place = _within_cell(v, places, low, size)
        for c in range(8):
            share = _share(c, place)
            total = sums[index[cell[v], c]]
            for i in range(count):
                total[i] += share * values[v, i]
            total[count] += share


@kernel
def _smooth(start, stop, beside, sums, smooth):
    for c in range(start, stop):
        for i in range(sums.shape[1]):
            smooth[c, i] = 0.5 * sums[c, i]
        for k in range(2):
            o = beside[c, k]
            if o >= 0:
                for i in range(sums.shape[1]):
                    smooth[c, i] += 0.25 * sums[o, i]


@kernel
def _read(start, stop, rows, places, low, size, index, cell, sums, out):
    count = out.shape[1]
    for r in range(start, stop):
        v = rows[r]
        place, weight = _within_cell(v, places, low, size), 0.0
        for i in range(count):
            out[r, i] = 0.0
        for c in range(8):
            share = _share(c, place)
            total = sums[index[cell[v], c]]
            weight += share * total[count]
            for i in range(count):
                out[r, i] += share * total[i]
        for i in range(count):
            out[r, i] /= weight
