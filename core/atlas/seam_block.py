# SPDX-License-Identifier: GPL-3.0-or-later
"""The exact solve for the unknowns of a sheet's block, a thin strip along the ends of charts.

Paper B's domain decomposition (section 6.2): smoothing alone leaves the error at seams.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from ..base.checks import Floats
from ..base.parallel import kernel, run
from ..base.progress import ask
from .sheet_matrix import BlockRows, Singles, require_positive


class SeamBlock:
    """The factored matrix of the block.

    Parameters
    ----------
    rows : BlockRows
    """

    def __init__(self, rows: BlockRows) -> None:
        self.rows = rows
        n = len(rows.unknowns)
        inner = rows.number[rows.columns]
        entries = np.flatnonzero(inner >= 0)
        of = np.repeat(np.arange(n), np.diff(rows.start))[entries]
        diagonal = np.arange(n)
        matrix = scipy.sparse.csc_matrix(
            (
                np.concatenate([rows.values[entries], rows.diagonal]),
                (np.concatenate([of, diagonal]), np.concatenate([inner[entries], diagonal])),
            ),
            shape=(n, n),
        )
        ask()
        self._factors = None
        if n:
            try:
                self._factors = scipy.sparse.linalg.splu(
                    matrix,
                    permc_spec="MMD_AT_PLUS_A",
                    diag_pivot_thresh=0.0,
                    options={"SymmetricMode": True},
                )
            except RuntimeError:  # exactly singular
                require_positive(np.zeros(1))

    def solve(self, b: Singles, x: Singles) -> None:
        """Solve for the block's unknowns in `x`, all others held: (n, c)."""
        if self._factors is None:
            return
        rhs: Floats = np.empty((len(self.rows.unknowns), x.shape[1]))
        run(_rhs, len(rhs), self.rows, b, x, rhs)
        x[self.rows.unknowns] = self._factors.solve(rhs)


@kernel
def _rhs(start, stop, rows, b, x, rhs):
    for p in range(start, stop):
        for j in range(x.shape[1]):
            total = np.float64(b[rows.unknowns[p], j])
            for e in range(rows.middle[p], rows.start[p + 1]):
                total -= rows.values[e] * x[rows.columns[e], j]
            rhs[p, j] = total
