# SPDX-License-Identifier: GPL-3.0-or-later
"""Exact solves for the unknowns of a sheet's block, a thin strip along chart outlines.

This is the domain decomposition of paper B (section 6.2): smoothing alone leaves error at seams.
"""

from __future__ import annotations

import numpy as np

from ..base.checks import Floats
from ..base.parallel import kernel, run
from ..errors import SolverError
from ..linear.multigrid import Multigrid
from ..mesh.triangle_mesh import Ints
from ..sparse.factors import Factors, factored
from ..sparse.matrix import Sparse, added, diagonal_matrix, from_triples
from ..sparse.ordering import TooDense
from .sheet_matrix import BlockRows, Singles, require_positive

MOST = 1 << 25
"""Most entries of the factor, of 12 bytes each.

Their number, not that of unknowns, is what factoring costs: strips along the seams of large charts
have a few entries for each unknown, blocks that fill the sheet dozens.
"""

_CHUNK = 1 << 15

_LIFT = 1e-12
"""Share of the diagonal that is added where rounding takes away more."""


class SeamBlock:
    """The matrix of the block, factored as ``L D L^T``.

    A block whose factor would hold more than `MOST` entries is not factored: a V-cycle of algebraic
    multigrid approximates its inverse. The preconditioner is still symmetric and positive definite,
    but needs more iterations, and far more where texels are stretched.

    Parameters
    ----------
    rows : BlockRows
    number : (n,) int32
        The results of `block_rows`.

    Raises
    ------
    SolverError
        If the matrix is not positive definite.
    """

    def __init__(self, rows: BlockRows, number: Ints) -> None:
        self._rows = rows
        self._place = np.arange(len(rows.unknowns), dtype=np.int32)
        self._factors: Factors | None = None
        self._hierarchy: Multigrid | None = None
        if not len(rows.unknowns):
            return
        inner = _inner(rows, number)
        try:
            self._factors, self._place = _factored(inner, rows.diagonal)
        except TooDense:
            self._inverse_root = 1.0 / np.sqrt(rows.diagonal)
            matrix = _inner(rows, number, self._inverse_root)
            csr = matrix.start, matrix.columns.view(np.uint32), matrix.values
            self._hierarchy = Multigrid(csr, self._inverse_root)
        except SolverError:  # rounding, at charts far smaller than a texel
            self._factors, self._place = _factored(inner, (1.0 + _LIFT) * rows.diagonal)

    def solve(self, b: Singles, x: Singles) -> None:
        """Solve for the block's unknowns in `x` while all others are fixed: (c, n)."""
        n = len(self._rows.unknowns)
        y: Floats = np.empty((n, len(x)))
        # A tuple tells the compiler the number of channels, which takes half of the time.
        channels = (0.0,) * len(x)
        run(_subtract_regular, n, self._rows, self._place, b, x, y, channels, chunk=_CHUNK)
        if self._factors is not None:
            _substitute(*self._factors, y, channels)
        elif self._hierarchy is not None:
            scale = self._inverse_root[:, None]
            y = scale * self._hierarchy.cycle(scale * y)
        run(_scatter, n, self._rows.unknowns, self._place, y, x, chunk=_CHUNK)


def _factored(inner: Sparse, diagonal: Floats) -> tuple[Factors, Ints]:
    factors, place = factored(added(inner, diagonal_matrix(diagonal)), MOST)
    require_positive(factors.diagonal)
    return factors, place


def _inner(rows: BlockRows, number: Ints, scale: Floats | None = None) -> Sparse:
    # The couplings within the block as a matrix, optionally scaled from both sides.
    n = len(rows.unknowns)
    to = number[rows.columns]
    entries = np.flatnonzero(to >= 0)
    of = np.repeat(np.arange(n, dtype=np.int32), np.diff(rows.start))[entries]
    to, values = to[entries], rows.values[entries]
    if scale is not None:
        values = values * scale[of] * scale[to]
    return from_triples(of, to, values, (n, n))


@kernel
def _subtract_regular(start, stop, rows, place, b, x, y, channels):
    total = np.empty(len(channels))
    for p in range(start, stop):
        for j in range(len(channels)):
            total[j] = b[j, rows.unknowns[p]]
        for e in range(rows.middle[p], rows.start[p + 1]):
            i = rows.columns[e]
            value = rows.values[e]
            for j in range(len(channels)):
                total[j] -= value * x[j, i]
        for j in range(len(channels)):
            y[place[p], j] = total[j]


@kernel
def _substitute(start, below, values, diagonal, y, channels):
    # L is stored by columns, without its diagonal of ones.
    n = len(diagonal)
    part = np.empty(len(channels))
    for k in range(n):
        for j in range(len(channels)):
            part[j] = y[k, j]
        for e in range(start[k], start[k + 1]):
            i = below[e]
            value = values[e]
            for j in range(len(channels)):
                y[i, j] -= value * part[j]
    for k in range(n - 1, -1, -1):
        for j in range(len(channels)):
            part[j] = y[k, j] / diagonal[k]
        for e in range(start[k], start[k + 1]):
            i = below[e]
            value = values[e]
            for j in range(len(channels)):
                part[j] -= value * y[i, j]
        for j in range(len(channels)):
            y[k, j] = part[j]


@kernel
def _scatter(start, stop, unknowns, place, y, x):
    for p in range(start, stop):
        for j in range(len(x)):
            x[j, unknowns[p]] = y[place[p], j]
