# SPDX-License-Identifier: GPL-3.0-or-later
"""Symmetric positive definite sparse systems with several right sides at once.

Conjugate gradients over our own kernels, all columns together, so that the matrix is read once
an iteration for all of them. The preconditioner is the diagonal where that converges quickly,
and one V-cycle of smoothed-aggregation multigrid where it does not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse

from .errors import SolverError
from .mesh import Floats, Ints
from .parallel import Progress, kernel, run, thread_count

_CHUNK = 1 << 15


@dataclass(frozen=True)
class Matrix:
    """A symmetric sparse matrix: CSR without its diagonal, and the diagonal.

    Attributes
    ----------
    start : (n + 1,) int32
    columns, values : (k,) int32, float64
        Entries off the diagonal; several with the same place add up.
    diagonal : (n,) float64
        Positive.
    """

    start: Ints
    columns: Ints
    values: Floats
    diagonal: Floats

    def scipy(self) -> scipy.sparse.csr_matrix:
        """The same matrix as scipy's."""
        n = len(self.diagonal)
        off = scipy.sparse.csr_matrix((self.values, self.columns, self.start), shape=(n, n))
        return (off + scipy.sparse.diags(self.diagonal)).tocsr()


@dataclass(frozen=True)
class SolveReport:
    """How a solve went.

    Attributes
    ----------
    iterations : int
        Iterations of conjugate gradients.
    residual : float
        Largest of the columns' residual norms, relative to the right side's norm.
    multigrid : bool
        Whether the multilevel preconditioner was used.
    """

    iterations: int
    residual: float
    multigrid: bool


def solve(
    matrix: Matrix,
    right: Floats,
    tolerance: float,
    *,
    multigrid: bool,
    limit: int = 1000,
    progress: Progress | None = None,
) -> tuple[Floats, SolveReport]:
    """Solve ``matrix @ x = right`` from zero.

    Parameters
    ----------
    matrix : Matrix
    right : (n, d) float64
    tolerance : float
        Wanted residual norm of each column, relative to the largest column's right side.
    multigrid : bool
        Use the multilevel preconditioner instead of the diagonal.
    limit : int
        Most iterations.
    progress : Progress, optional

    Returns
    -------
    x : (n, d) float64
    report : SolveReport

    Raises
    ------
    SolverError
        If the matrix is not positive definite, or the tolerance is not reached within `limit`.
    """
    progress = progress or Progress(None)
    x = np.zeros_like(right)
    scale = float(np.sqrt((right**2).sum(axis=0).max()))
    if scale == 0:
        return x, SolveReport(0, 0.0, multigrid)
    if not np.isfinite(scale):
        raise SolverError("The right side of the linear system is not finite.")
    precondition: Callable[[Floats, Floats], None] | None = None
    if multigrid:
        precondition = Multigrid(matrix, progress).cycle
    n, d = right.shape
    chunks = -(-n // _CHUNK)
    sums = np.zeros((chunks, 2, d))
    inverse = 1.0 / matrix.diagonal
    r = right.copy()
    z = np.zeros_like(right)
    q = np.empty_like(right)
    p = np.zeros_like(right)
    before = np.ones(d)
    beta = np.zeros(d)
    minus_alpha = np.zeros(d)
    residual = 1.0
    for iteration in range(limit + 1):
        # The update of x and r by the last step is merged with the preconditioner.
        run(_update, n, minus_alpha, inverse, p, q, x, r, z, sums, chunk=_CHUNK)
        norms, products = sums.sum(axis=0)
        residual = float(np.sqrt(norms.max())) / scale
        if not np.isfinite(residual):
            raise SolverError("The linear solve broke down; the mesh is too badly shaped.")
        if residual <= tolerance:
            return x, SolveReport(iteration, residual, multigrid)
        # The residual falls roughly geometrically: progress is its logarithm.
        progress.update(min(0.1 + 0.9 * np.log(min(residual, 1.0)) / np.log(tolerance), 1.0))
        if precondition is not None:
            precondition(r, z)
            products = np.einsum("ij,ij->j", r, z)
        beta = np.where(before > 0, products / np.where(before > 0, before, 1.0), 0.0)
        if iteration == 0:
            beta[:] = 0.0
        before = products
        run(_direction, n, beta, z, p, chunk=_CHUNK)
        run(_apply, n, matrix.start, matrix.columns, matrix.values, matrix.diagonal, p, q, sums,
            chunk=_CHUNK)  # fmt: skip
        curvature = sums[:, 0].sum(axis=0)
        if (curvature < 0).any():
            raise SolverError("The linear system is not positive definite.")
        minus_alpha = -np.where(curvature > 0, products / np.where(curvature > 0, curvature, 1.0), 0)
    raise SolverError(
        f"The linear solve stopped at a relative residual of {residual:.1e} after {limit}"
        f" iterations; {tolerance:.1e} was asked for. Use a smaller screening radius."
    )


class Multigrid:
    """Smoothed-aggregation multigrid (Vanek, Mandel, Brezina 1996), as a preconditioner.

    Aggregates are whole neighbourhoods; the prolongation is smoothed by one Jacobi step; the
    smoother is one damped Jacobi sweep before and after; the coarsest level is solved densely.
    """

    def __init__(self, matrix: Matrix, progress: Progress | None = None) -> None:
        a = matrix.scipy()
        a.sum_duplicates()
        self._levels: list[_Level] = []
        while a.shape[0] > 400 and len(self._levels) < 20:
            if progress is not None:
                progress.update(min(0.02 * len(self._levels), 0.1))
            level, coarse = _coarsen(a)
            if coarse.shape[0] > 0.8 * a.shape[0]:
                break
            self._levels.append(level)
            a = coarse
        dense = a.toarray()
        self._coarsest = np.linalg.pinv(dense, hermitian=True)

    def cycle(self, right: Floats, out: Floats) -> None:
        """One V-cycle from zero: `out` becomes an approximate solution for `right`."""
        out[:] = self._solve(0, right)

    def _solve(self, depth: int, right: Floats) -> Floats:
        if depth == len(self._levels):
            return self._coarsest @ right
        level = self._levels[depth]
        x = level.smoother[:, None] * right
        residual = np.empty_like(right)
        run(_residual, len(right), *level.matrix, x, right, residual)
        coarse = np.empty((level.size, right.shape[1]))
        run(_multiply, level.size, *level.restriction, residual, coarse)
        coarse = self._solve(depth + 1, coarse)
        run(_multiply_add, len(right), *level.prolongation, coarse, x)
        run(_residual, len(right), *level.matrix, x, right, residual)
        x += level.smoother[:, None] * residual
        return x


Csr = tuple[Ints, Ints, Floats]


@dataclass(frozen=True)
class _Level:
    matrix: Csr
    prolongation: Csr
    restriction: Csr
    smoother: Floats  # damped inverse of the diagonal
    size: int  # of the next level


def _coarsen(a: scipy.sparse.csr_matrix) -> tuple[_Level, scipy.sparse.csr_matrix]:
    diagonal = a.diagonal()
    aggregates = np.full(a.shape[0], -1, dtype=np.int32)
    size = _aggregate(a.indptr, a.indices, a.data, diagonal, 0.0, aggregates)
    n = a.shape[0]
    tentative = scipy.sparse.csr_matrix(
        (np.ones(n), aggregates, np.arange(n + 1, dtype=np.int32)), shape=(n, size)
    )
    # Gershgorin bounds the spectrum of D^-1 A; 4/3 of its inverse is the usual damping.
    bound = float((abs(a).sum(axis=1).A1 / diagonal).max())
    scaled = scipy.sparse.diags((4.0 / 3.0 / bound) / diagonal)
    prolongation = (tentative - scaled @ (a @ tentative)).tocsr()
    restriction = prolongation.T.tocsr()
    coarse = (restriction @ (a @ prolongation)).tocsr()
    level = _Level(_arrays(a), _arrays(prolongation), _arrays(restriction),
                   4.0 / 3.0 / bound / diagonal, size)  # fmt: skip
    return level, coarse


def _arrays(a: scipy.sparse.csr_matrix) -> Csr:
    return a.indptr.astype(np.int32, copy=False), a.indices.astype(np.int32, copy=False), a.data


@kernel
def _update(start, stop, minus_alpha, inverse, p, q, x, r, z, sums):
    d = r.shape[1]
    place = start // _CHUNK
    sums[place] = 0.0
    for i in range(start, stop):
        for j in range(d):
            x[i, j] -= minus_alpha[j] * p[i, j]
            value = r[i, j] + minus_alpha[j] * q[i, j]
            r[i, j] = value
            z[i, j] = inverse[i] * value
            sums[place, 0, j] += value * value
            sums[place, 1, j] += value * value * inverse[i]


@kernel
def _direction(start, stop, beta, z, p):
    for i in range(start, stop):
        for j in range(p.shape[1]):
            p[i, j] = z[i, j] + beta[j] * p[i, j]


@kernel
def _apply(start, stop, row_start, columns, values, diagonal, p, q, sums):
    d = p.shape[1]
    place = start // _CHUNK
    sums[place] = 0.0
    for i in range(start, stop):
        for j in range(d):
            q[i, j] = diagonal[i] * p[i, j]
        for e in range(row_start[i], row_start[i + 1]):
            c = columns[e]
            for j in range(d):
                q[i, j] += values[e] * p[c, j]
        for j in range(d):
            sums[place, 0, j] += q[i, j] * p[i, j]


@kernel
def _residual(start, stop, row_start, columns, values, x, right, out):
    for i in range(start, stop):
        for j in range(x.shape[1]):
            out[i, j] = right[i, j]
        for e in range(row_start[i], row_start[i + 1]):
            for j in range(x.shape[1]):
                out[i, j] -= values[e] * x[columns[e], j]


@kernel
def _multiply(start, stop, row_start, columns, values, x, out):
    for i in range(start, stop):
        for j in range(x.shape[1]):
            out[i, j] = 0.0
        for e in range(row_start[i], row_start[i + 1]):
            for j in range(x.shape[1]):
                out[i, j] += values[e] * x[columns[e], j]


@kernel
def _multiply_add(start, stop, row_start, columns, values, x, out):
    for i in range(start, stop):
        for e in range(row_start[i], row_start[i + 1]):
            for j in range(x.shape[1]):
                out[i, j] += values[e] * x[columns[e], j]


@kernel
def _aggregate(row_start, columns, values, diagonal, strength, aggregates):
    # Whole neighbourhoods first; what is left joins the strongest neighbouring aggregate.
    n = diagonal.shape[0]
    size = 0
    for i in range(n):
        if aggregates[i] >= 0:
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
        if aggregates[i] >= 0:
            continue
        best = 0.0
        joined = -1
        for e in range(row_start[i], row_start[i + 1]):
            neighbour = aggregates[columns[e]]
            if 0 <= neighbour < whole and abs(values[e]) > best:
                best = abs(values[e])
                joined = neighbour
        if joined >= 0:
            aggregates[i] = -2 - joined  # joined, but not to be joined through
        else:
            aggregates[i] = size
            size += 1
    for i in range(n):
        if aggregates[i] < -1:
            aggregates[i] = -2 - aggregates[i]
    return size
