# SPDX-License-Identifier: GPL-3.0-or-later
"""Smoothed-aggregation multigrid (Vanek, Mandel, Brezina 1996), as a preconditioner.

It is our own, because pyamg solves for one right-hand side at a time, and would be one more wheel
to ship.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.checks import Floats
from ..base.parallel import kernel, run
from ..base.progress import ask, phase
from ..sparse.matrix import (
    Sparse,
    absolute,
    added,
    applied,
    diagonal_matrix,
    diagonal_of,
    from_triples,
    product,
    row_sums,
    rows_of,
    transposed,
    with_entries,
)

Csr = tuple[npt.NDArray, npt.NDArray, npt.NDArray]
"""Starts of rows, columns and values of a sparse matrix."""

_DENSE = 400
"""Most unknowns of a level that is solved by a dense matrix."""

HUB = 100
"""Most couplings of an unknown that is aggregated with its neighbours.

A hub has more, each of them weak; all its neighbours would become one aggregate.
"""

_NOTHING = 1e-14
"""Diagonal entries of coarse levels, and eigenvalues of the coarsest one, that count as 0.

The finest diagonal is 1. Only the null space of the matrix comes so low, up to rounding: the
constants of a part that hardly any screening holds, which the right-hand side does not contain.
"""


class Multigrid:
    """A hierarchy of coarser and coarser matrices, and the V-cycle over it.

    Aggregates are whole neighbourhoods; one Jacobi step smooths the prolongation; the smoother is
    one damped Jacobi sweep before and after, which also solves for unknowns that are coupled to no
    other (fixed ones, and small components on coarse levels); a small coarsest level is solved
    by a dense matrix.

    Parameters
    ----------
    matrix : Csr
        Scaled to a diagonal of ones, and without this diagonal.
    inverse_root : (n,) float64
        Inverse square root of the diagonal before it was scaled; 0 at fixed unknowns.
    """

    def __init__(self, matrix: Csr, inverse_root: Floats) -> None:
        # In scaled unknowns, the null space of a Laplacian is not the constant but D^(1/2); 1
        # at fixed unknowns.
        start, columns, values = matrix
        n = len(inverse_root)
        off = Sparse(start, columns.view(np.int32), values, (n, n))
        a = added(off, diagonal_matrix(np.ones(n)))
        free = inverse_root > 0
        smooth = np.where(free, 1.0 / np.where(free, inverse_root, 1.0), 1.0)
        hubs = np.flatnonzero(np.diff(a.start) > HUB)
        self._levels: list[_Level] = []
        while a.shape[0] > _DENSE and len(self._levels) < 20:
            done = min(0.2 * len(self._levels), 1.0)
            with phase(done, done, "Coarsening"):
                level, coarse, smooth, hubs = _coarsen(a, smooth, hubs)
            if coarse.shape[0] > 0.8 * a.shape[0]:
                break
            self._levels.append(level)
            a = coarse
        self._inverse = None
        if 0 < a.shape[0] <= _DENSE:
            dense = np.zeros(a.shape)
            np.add.at(dense, (rows_of(a), a.columns), a.values)
            self._inverse = np.linalg.pinv(dense, rcond=_NOTHING, hermitian=True)
        self._diagonal = _divisors(diagonal_of(a))[:, None]

    def cycle(self, rhs: Floats, depth: int = 0) -> Floats:
        """Solve approximately for `rhs` by one V-cycle from this level down, from zero."""
        if depth == len(self._levels):
            if self._inverse is None:
                return rhs / self._diagonal
            return self._inverse @ rhs
        matrix, prolongation, restriction, smoother = self._levels[depth]
        n, size = len(rhs), len(restriction[0]) - 1
        x = smoother[:, None] * rhs
        residual = np.empty_like(rhs)
        run(_add_product, n, -1.0, *matrix, x, rhs, residual)
        coarse = np.zeros((size, rhs.shape[1]))
        run(_add_product, size, 1.0, *restriction, residual, coarse, coarse)
        coarse = self.cycle(coarse, depth + 1)
        run(_add_product, n, 1.0, *prolongation, coarse, x, x)
        run(_add_product, n, -1.0, *matrix, x, rhs, residual)
        x += smoother[:, None] * residual
        return x


class _Level(NamedTuple):
    matrix: Csr
    prolongation: Csr
    restriction: Csr
    smoother: Floats  # damped inverse of the diagonal


def _divisors(diagonal: Floats) -> Floats:
    return np.where(diagonal > _NOTHING, diagonal, np.inf)


def _coarsen(
    a: Sparse, smooth: Floats, hubs: npt.NDArray
) -> tuple[_Level, Sparse, Floats, npt.NDArray]:
    # `smooth` is the near-null-space vector that coarse levels must represent.
    n = a.shape[0]
    aggregates = np.full(n, -1, dtype=np.int32)
    strong = _without_hubs(a, smooth, hubs) if len(hubs) else a
    size = _aggregate(*strong[:3], aggregates)
    aggregates[hubs] = np.arange(size, size + len(hubs))
    size += len(hubs)
    coupled = np.flatnonzero(aggregates >= 0)
    members = aggregates[coupled]
    norms = np.sqrt(np.bincount(members, weights=smooth[coupled] ** 2, minlength=size))
    tentative = from_triples(coupled, members, smooth[coupled] / norms[members], (n, size))
    # Gershgorin bounds the spectrum of D^-1 A; 4/3 of its inverse is the usual damping.
    ask()
    # With hubs, one row may be far off the others: M, the row sums, bounds that of M^-1 A by 1.
    if len(hubs):
        damping = 4.0 / 3.0 / _divisors(applied(absolute(a), smooth) / smooth)
    else:
        diagonal = _divisors(diagonal_of(a))
        bound = max(float((row_sums(absolute(a)) / diagonal).max()), 1.0)
        damping = 4.0 / 3.0 / bound / diagonal
    step = product(diagonal_matrix(damping), product(strong, tentative))
    prolongation = added(tentative, step, -1.0)
    restriction = transposed(prolongation)
    coarse = product(restriction, product(a, prolongation))
    level = _Level(a[:3], prolongation[:3], restriction[:3], damping)
    hubs = aggregates[hubs]
    return level, coarse, norms, hubs[np.diff(coarse.start)[hubs] > HUB]


def _without_hubs(a: Sparse, smooth: Floats, hubs: npt.NDArray) -> Sparse:
    # Drops the couplings to hubs; adds them to the diagonal as if both ends were as smooth.
    is_hub = np.zeros(a.shape[0], dtype=bool)
    is_hub[hubs] = True
    rows = rows_of(a)
    weak = (is_hub[rows] | is_hub[a.columns]) & (rows != a.columns)
    lost = np.bincount(rows[weak], (a.values * smooth[a.columns])[weak], a.shape[0]) / smooth
    return added(with_entries(a, ~weak), diagonal_matrix(lost))


@kernel
def _add_product(start, stop, factor, row_start, columns, values, x, before, out):
    # out = before + factor * matrix x; `before` and `out` may be the same array.
    for i in range(start, stop):
        for j in range(x.shape[1]):
            out[i, j] = before[i, j]
        for e in range(row_start[i], row_start[i + 1]):
            value = factor * values[e]
            for j in range(x.shape[1]):
                out[i, j] += value * x[columns[e], j]


@kernel
def _aggregate(row_start, columns, values, aggregates):
    # First whole neighbourhoods; each remaining row joins its most strongly coupled aggregate.
    # Rows with only a diagonal belong to none.
    n = aggregates.shape[0]
    size = 0
    for i in range(n):
        if aggregates[i] >= 0 or row_start[i + 1] - row_start[i] < 2:
            continue
        free = True
        for e in range(row_start[i], row_start[i + 1]):
            if aggregates[columns[e]] >= 0:
                free = False
                break
        if free:
            for e in range(row_start[i], row_start[i + 1]):
                aggregates[columns[e]] = size
            aggregates[i] = size
            size += 1
    whole = size
    for i in range(n):
        if aggregates[i] >= 0 or row_start[i + 1] - row_start[i] < 2:
            continue
        best = 0.0
        joined = -1
        for e in range(row_start[i], row_start[i + 1]):
            neighbour = aggregates[columns[e]]
            if 0 <= neighbour < whole and abs(values[e]) > best:
                best = abs(values[e])
                joined = neighbour
        if joined >= 0:
            aggregates[i] = -2 - joined  # others must not join through this one
        else:
            aggregates[i] = size
            size += 1
    for i in range(n):
        if aggregates[i] < -1:
            aggregates[i] = -2 - aggregates[i]
    return size
