# SPDX-License-Identifier: GPL-3.0-or-later
"""A symmetric linear system, set up once and solved for many right-hand sides."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base.checks import Floats
from ..base.parallel import kernel, run
from ..errors import SolverError
from ..sparse.matrix import (
    Sparse,
    absolute,
    added,
    diagonal_matrix,
    diagonal_of,
    row_sums,
    transposed,
)
from .multigrid import HUB, Csr, Multigrid

_ROUNDING = 8 * np.finfo(np.float64).eps


class LinearSystem:
    """A symmetric matrix with some unknowns fixed.

    Row i of A x is screen_i x_i + sum over j of weight_ij (x_i - x_j). It is stored as these
    differences, so that constants stay exact under rounded weights. What `solve` derives from the
    matrix is kept with it for further right-hand sides. See `from_csr` for other matrices.

    Parameters
    ----------
    start : (n + 1,) int32
        Row i has the entries from ``start[i]`` to ``start[i + 1]``.
    columns, weights : (k,) int32, float64
        The symmetric off-diagonal part, negated; repeated entries add up.
    screen : (n,) float64
        Screening: the row sums of the matrix; 0 for a pure Laplacian.
    diagonal : (n,) float64
        Screening plus sum of weights, above 0 where unknowns are free.
    fixed : (n,) bool, optional
        Unknowns that stay 0; none if left out. See `solve` for other fixed values.

    Raises
    ------
    SolverError
        If a free unknown's diagonal entry is not above 0.
    """

    def __init__(
        self,
        start: npt.NDArray[np.int32],
        columns: npt.NDArray[np.int32],
        weights: Floats,
        screen: Floats,
        diagonal: Floats,
        fixed: npt.NDArray[np.bool_] | None = None,
    ) -> None:
        self.start, self.columns, self.weights = start, columns, weights
        self.screen, self.diagonal = screen, diagonal
        self.fixed = np.zeros(len(screen), dtype=bool) if fixed is None else fixed
        bad = ~((diagonal > 0) & np.isfinite(diagonal) | self.fixed)
        if bad.any():
            raise SolverError(
                "Row {row} of the matrix has {value:g} on its diagonal; a positive number is"
                " needed. Fix that unknown, or leave it out.",
                row=int(np.argmax(bad)),
                value=float(diagonal[np.argmax(bad)]),
            )

    @classmethod
    def from_csr(cls, matrix: Any, fixed: npt.NDArray[np.bool_] | None = None) -> LinearSystem:
        """Make a system of a symmetric matrix, of scipy or `Sparse`: ``mass + time * stiffness``.

        Raises
        ------
        SolverError
            If the matrix is not square, finite and symmetric; or see the class.
        """
        matrix = matrix if isinstance(matrix, Sparse) else _of_scipy(matrix)
        sizes = absolute(matrix)
        largest = sizes.values.max(initial=0.0)
        if matrix.shape[0] != matrix.shape[1] or not np.isfinite(largest):
            raise SolverError("The matrix is not square and finite.")
        differences = absolute(added(matrix, transposed(matrix), -1.0)).values
        if differences.max(initial=0.0) > 1e-9 * largest:
            raise SolverError("The matrix is not symmetric.")
        diagonal = diagonal_of(matrix)
        off = added(matrix, diagonal_matrix(diagonal), -1.0)
        screen = diagonal + row_sums(off)
        screen[abs(screen) <= _ROUNDING * row_sums(sizes)] = 0.0
        return cls(off.start, off.columns, -off.values, screen, diagonal, fixed)

    def part(self, rows: npt.NDArray[np.integer]) -> LinearSystem:
        """Make the system of some unknowns, in the order given, while all others stay 0."""
        number = np.full(len(self.screen), -1, dtype=np.int32)
        number[rows] = np.arange(len(rows), dtype=np.int32)
        start = np.zeros(len(rows) + 1, dtype=np.int32)
        run(_count_inside, len(rows), rows, self.start, self.columns, number, start[1:])
        np.cumsum(start, out=start)
        columns = np.empty(start[-1], dtype=np.int32)
        weights = np.empty(start[-1])
        diagonal, screen = self.diagonal[rows], np.empty(len(rows))
        run(_take_inside, len(rows), rows, self.start, self.columns, self.weights, number, start,
            diagonal, columns, weights, screen)  # fmt: skip
        return LinearSystem(start, columns, weights, screen, diagonal, self.fixed[rows])

    @cached_property
    def inverse_root(self) -> Floats:
        """Inverse square root of the diagonal, 0 at fixed unknowns: (n,).

        Scaled by it, unknowns and equations have a diagonal of ones, which need not be read.
        """
        return np.where(self.fixed, 0.0, 1.0 / np.sqrt(np.where(self.fixed, 1.0, self.diagonal)))

    @cached_property
    def has_hubs(self) -> bool:
        """Whether some unknown is coupled with more than `HUB` others."""
        return bool(np.diff(self.start).max(initial=0) > HUB)

    @cached_property
    def single(self) -> Csr:
        """The scaled matrix without its diagonal, in single precision."""
        return self._scaled(np.float32)

    @cached_property
    def double(self) -> Csr:
        """The scaled matrix without its diagonal, in double precision."""
        return self._scaled(np.float64)

    def _scaled(self, precision: type) -> Csr:
        values: npt.NDArray[np.floating] = np.empty(len(self.weights), dtype=precision)
        run(_scale_weights, len(self.screen), self.start, self.columns, self.weights,
            self.inverse_root, values)  # fmt: skip
        return self.start, self.columns.view(np.uint32), values

    @cached_property
    def hierarchy(self) -> Multigrid:
        """The multilevel preconditioner of the scaled matrix."""
        return Multigrid(self.double, self.inverse_root)

    def residual(self, x: Floats, rhs: Floats) -> Floats:
        """Compute ``rhs - A x`` (n, k); rows of fixed unknowns are meaningless."""
        out = np.empty_like(rhs)
        run(_residual, len(x), self.start, self.columns, self.weights, self.screen,
            np.ones(len(x)), x, rhs, out)  # fmt: skip
        return out

    def scaled_residual(self, y: Floats, rhs: Floats, out: Floats) -> None:
        """Write ``rhs - D A D y`` to `out`, D the inverse root; skips rows of fixed unknowns."""
        run(_residual, len(y), self.start, self.columns, self.weights, self.screen,
            self.inverse_root, y, rhs, out)  # fmt: skip


def _of_scipy(matrix: Any) -> Sparse:
    from scipy.sparse import csr_matrix  # whoever has such a matrix has scipy

    csr = csr_matrix(matrix, dtype=np.float64)
    start, columns = (each.astype(np.int32) for each in (csr.indptr, csr.indices))
    return Sparse(start, columns, csr.data, csr.shape)


@kernel
def _count_inside(start, stop, rows, row_start, columns, number, counts):
    for i in range(start, stop):
        row = rows[i]
        for e in range(row_start[row], row_start[row + 1]):
            counts[i] += number[columns[e]] >= 0


@kernel
def _take_inside(
    start, stop, rows, row_start, columns, weights, number, begin, diagonal, inside, taken, screen
):
    for i in range(start, stop):
        row, place, total = rows[i], begin[i], 0.0
        for e in range(row_start[row], row_start[row + 1]):
            column = number[columns[e]]
            if column >= 0:
                inside[place] = column
                taken[place] = weights[e]
                total += weights[e]
                place += 1
        screen[i] = diagonal[i] - total


@kernel
def _scale_weights(start, stop, row_start, columns, weights, inverse_root, values):
    for i in range(start, stop):
        for e in range(row_start[i], row_start[i + 1]):
            values[e] = -weights[e] * inverse_root[i] * inverse_root[columns[e]]


@kernel
def _residual(start, stop, row_start, columns, weights, screen, scale, y, rhs, out):
    for i in range(start, stop):
        if scale[i] == 0:
            continue
        for j in range(y.shape[1]):
            x = scale[i] * y[i, j]
            total = screen[i] * x
            for e in range(row_start[i], row_start[i + 1]):
                c = columns[e]
                total += weights[e] * (x - scale[c] * y[c, j])
            out[i, j] = rhs[i, j] - scale[i] * total
