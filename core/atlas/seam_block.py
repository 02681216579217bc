# SPDX-License-Identifier: GPL-3.0-or-later
"""The exact solve for the unknowns of a sheet's block, a thin strip along the ends of charts.

Paper B's domain decomposition (section 6.2): smoothing alone leaves the error at seams.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from ..base.checks import Floats
from ..base.parallel import kernel, run, sum_kernel
from ..base.progress import ask
from ..mesh.triangle_mesh import Ints
from .sheet_matrix import BlockRows, Singles, require_positive

_CHUNK = 1 << 13


class SeamBlock:
    """The factored matrix of the block, ``L D L^T``.

    Parameters
    ----------
    rows : BlockRows
    number : (n,) int32
        As `block_rows` returns both.

    Raises
    ------
    SolverError
        If the matrix is not positive definite.
    """

    def __init__(self, rows: BlockRows, number: Ints) -> None:
        self._rows = rows
        n = len(rows.unknowns)
        if n == 0:
            return
        inner = number[rows.columns]
        entries = np.flatnonzero(inner >= 0)
        of = np.repeat(np.arange(n), np.diff(rows.start))[entries]
        places = np.arange(n)
        matrix = scipy.sparse.csc_matrix(
            (
                np.concatenate([rows.values[entries], rows.diagonal]),
                (np.concatenate([of, places]), np.concatenate([inner[entries], places])),
            ),
            shape=(n, n),
        )
        ask()
        try:
            factors = scipy.sparse.linalg.splu(
                matrix,
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError:  # it is singular
            require_positive(np.zeros(1))
        # Its own solve takes four times as long as ours, on one core.
        lower = factors.L
        of = np.repeat(places, np.diff(lower.indptr))
        entries = np.flatnonzero(lower.indices != of)
        self._start = np.searchsorted(entries, lower.indptr).astype(np.int32)
        self._below, self._values = lower.indices[entries], lower.data[entries]
        self._diagonal = factors.U.diagonal()
        self._place = factors.perm_r
        if not (self._place == factors.perm_c).all():
            self._diagonal[:] = -1.0  # a diagonal entry was 0 on the way
        require_positive(self._diagonal)

    def solve(self, b: Singles, x: Singles) -> None:
        """Solve for the block's unknowns in `x`, all others held: (c, n)."""
        n = len(self._rows.unknowns)
        if n == 0:
            return
        y: Floats = np.empty((n, len(x)))
        run(_subtract_regular, n, self._rows, self._place, b, x, y, chunk=_CHUNK)
        channels = (0.0,) * len(x)
        _substitute(self._start, self._below, self._values, self._diagonal, y, channels)
        run(_scatter, n, self._rows.unknowns, self._place, y, x, chunk=_CHUNK)


@kernel
def _subtract_regular(start, stop, rows, place, b, x, y):
    for p in range(start, stop):
        for j in range(len(x)):
            total = np.float64(b[j, rows.unknowns[p]])
            for e in range(rows.middle[p], rows.start[p + 1]):
                total -= rows.values[e] * x[j, rows.columns[e]]
            y[place[p], j] = total


@sum_kernel
def _substitute(start, below, values, diagonal, y, channels):
    # L comes by columns, without its ones. As many channels as a tuple is long: known to the
    # compiler, which takes half of the time.
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
