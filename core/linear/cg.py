# SPDX-License-Identifier: GPL-3.0-or-later
"""Screened Laplace systems with three right sides at once.

Conjugate gradients over our own kernels, on all columns as one long vector: the matrix is read
once an iteration for all three, and turning the axes turns the solution. The preconditioner is
the diagonal where that converges quickly, in single precision with a residual checked in double,
and one V-cycle of smoothed-aggregation multigrid, in double precision, where it does not.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import scipy.sparse

from ..base.parallel import Progress, blocks, chunk_size, kernel, run, sum_kernel
from ..errors import SolverError
from ..mesh.triangle_mesh import Floats, Ints


@dataclass(frozen=True)
class ScreenedLaplacian:
    """The matrix: row i of A x is screen_i x_i + sum over j of weight_ij (x_i - x_j).

    Kept as differences, so that rounded weights still leave constants alone. What `solve` derives
    from the matrix stays with it, so that further right sides cost less.

    Attributes
    ----------
    start : (n + 1,) int32
    columns, weights : (k,) int32, float64
        Neighbours of each vertex and their symmetric weights; repeated neighbours add up.
    screen : (n,) float64
        Weight of staying; where it is 0, the unknown is fixed at 0.
    diagonal : (n,) float64
        Screen plus sum of weights.
    """

    start: Ints
    columns: Ints
    weights: Floats
    screen: Floats
    diagonal: Floats

    def scipy(self) -> scipy.sparse.csr_matrix:
        """The same matrix as scipy's; fixed rows and columns are the identity's."""
        n = len(self.screen)
        fixed = self.screen == 0
        values = -self.weights
        values[fixed[self.columns] | np.repeat(fixed, np.diff(self.start))] = 0.0
        off = scipy.sparse.csr_matrix((values, self.columns, self.start), shape=(n, n))
        matrix = (off + scipy.sparse.diags(np.where(fixed, 1.0, self.diagonal))).tocsr()
        matrix.eliminate_zeros()
        return matrix

    @cached_property
    def roots(self) -> Floats:
        """One by the root of the diagonal, 0 at fixed unknowns: (n,).

        With unknowns and equations scaled by it, the diagonal is 1 and needs no reading.
        """
        free = self.screen > 0
        return np.where(free, 1.0 / np.sqrt(np.where(free, self.diagonal, 1.0)), 0.0)

    @cached_property
    def single(self) -> Csr:
        """The scaled matrix without its diagonal, in single precision."""
        return _scaled(self, np.float32)

    @cached_property
    def double(self) -> Csr:
        """The same in double precision."""
        return _scaled(self, np.float64)

    def hierarchy(self, progress: Progress = Progress(None)) -> Multigrid:
        """The multilevel preconditioner of the scaled matrix, made when first asked for."""
        made = self.__dict__.get("_hierarchy")
        if made is None:
            made = Multigrid(self.double, self.roots, progress)
            self.__dict__["_hierarchy"] = made
        return made


PATIENCE = 400
"""Iterations with the diagonal after which multigrid takes over."""

Csr = tuple[npt.NDArray, npt.NDArray, npt.NDArray]


@dataclass(frozen=True)
class SolveReport:
    """How a solve went.

    Attributes
    ----------
    iterations : int
        Iterations of conjugate gradients.
    residual : float
        Norm of the residual of all columns, relative to the right side's; each equation counts
        divided by the root of its diagonal entry, so that sizes of faces do not matter.
    multigrid : bool
        Whether the multilevel preconditioner was used.
    """

    iterations: int
    residual: float
    multigrid: bool


def solve(
    matrix: ScreenedLaplacian,
    right: Floats,
    tolerance: float,
    *,
    multigrid: bool,
    limit: int = 1000,
    progress: Progress | None = None,
) -> tuple[Floats, SolveReport]:
    """Solve ``A x = right``, starting from zero.

    Parameters
    ----------
    matrix : ScreenedLaplacian
    right : (n, 3) float64
        Zero at fixed unknowns.
    tolerance : float
        Wanted residual, relative as in `SolveReport`.
    multigrid : bool
        Use the multilevel preconditioner instead of the diagonal.
    limit : int
        Most iterations with the multilevel preconditioner.
    progress : Progress, optional

    Returns
    -------
    x : (n, 3) float64
    report : SolveReport

    Raises
    ------
    SolverError
        If the system is not positive definite or finite, or the tolerance is not reached within
        `limit` iterations.
    """
    progress = progress or Progress(None)
    roots = matrix.roots
    right = right * roots[:, None]
    scale = _norm(right)
    progress.update(0.0)
    y = np.zeros_like(right)
    if scale == 0:
        return y, SolveReport(0, 0.0, multigrid)
    if not np.isfinite(scale):
        raise SolverError("The right side of the linear system is not finite; check the mesh.")
    rest = right.copy()
    hierarchy = None
    iterations, relative, patience = 0, 1.0, PATIENCE
    while patience > 0:
        if multigrid and hierarchy is None:
            hierarchy = matrix.hierarchy(progress.part(0.0, 0.3, "Coarsening"))
            patience = limit
        scaled = matrix.double if multigrid else matrix.single
        descent = progress.part(0.3 if multigrid else 0.0, 1.0, "Fitting the surface")
        wanted = max(0.9 * tolerance / relative, 1e-4)  # single precision has few digits
        step, count, sound = _conjugate_gradients(
            scaled, rest.astype(scaled[2].dtype), wanted, hierarchy, patience, descent
        )
        iterations += count
        patience -= max(count, 1)
        if sound:
            y += step
            run(_true_residual, len(y), matrix.start, matrix.columns, matrix.weights,
                matrix.screen, roots, y, right, rest, progress=descent)  # fmt: skip
        before, relative = relative, _norm(rest) / scale
        if relative <= tolerance:
            y *= roots[:, None]
            return y, SolveReport(iterations, relative, multigrid)
        if not multigrid and (patience <= 0 or relative > 0.5 * before):
            multigrid, patience = True, limit  # the diagonal does not get there
        elif multigrid and (not sound or not np.isfinite(relative)):
            break
    raise SolverError(
        "The linear solve stopped at a relative residual of {relative:.1e} after {iterations}"
        " iterations ({tolerance:.1e} is needed). Repair needle-like faces and vertices with"
        " thousands of faces, or try a smaller radius of the fit.",
        relative=relative,
        iterations=iterations,
        tolerance=tolerance,
    )


def _norm(values: Floats) -> float:
    # Not numpy's, whose threads get into the way of ours.
    return float(np.sqrt(np.square(values).sum()))


def _scaled(matrix: ScreenedLaplacian, precision: type) -> Csr:
    values: npt.NDArray[np.floating] = np.empty(len(matrix.weights), dtype=precision)
    run(_scale_weights, len(matrix.screen), matrix.start, matrix.columns, matrix.weights,
        matrix.roots, values)  # fmt: skip
    return matrix.start, matrix.columns.view(np.uint32), values


def _conjugate_gradients(
    matrix: Csr,
    r: npt.NDArray[np.floating],
    tolerance: float,
    hierarchy: Multigrid | None,
    limit: int,
    progress: Progress = Progress(None),
) -> tuple[npt.NDArray[np.floating], int, bool]:
    # Overwrites r, from which it starts, with the residual that is left. Returns the solution,
    # the number of iterations, and whether the matrix behaved as a positive definite one.
    n = len(r)
    kind = r.dtype.type
    x, p, q = np.zeros_like(r), np.zeros_like(r), np.zeros_like(r)
    z = np.empty_like(r) if hierarchy else r
    flat = [array.reshape(-1) for array in (x, p, q, r, z)]
    chunk = chunk_size(n)
    sums = np.zeros(-(-n // chunk))
    alpha, before, scale = 0.0, 1.0, 0.0
    progress.update(0.0)
    for iteration in range(limit + 1):
        run(_reduce, 3 * n, 3 * chunk, kind(alpha), flat[2], flat[3], sums, chunk=3 * chunk)
        product = float(sums.sum())
        norm = float(np.sqrt(product))
        if iteration == 0:
            scale = norm
        if not np.isfinite(norm):
            return x, iteration, False
        if hierarchy is not None:
            hierarchy.cycle(r, z)
            product = float(np.vdot(r, z))
        beta = product / before if iteration else 0.0
        # Adds the last step to x, too, while p is at hand.
        run(_direct, 3 * n, kind(alpha), kind(beta), flat[4], flat[0], flat[1], chunk=3 * chunk)
        if norm <= tolerance * scale or iteration == limit:
            break
        # The residual falls roughly geometrically: progress is its logarithm.
        progress.update(min(float(np.log(norm / scale) / np.log(tolerance)), 1.0))
        run(_apply, n, chunk, *matrix, p, q, sums, chunk=chunk)
        curvature = float(sums.sum())
        if not curvature > 0:
            return x, iteration, False
        alpha, before = product / curvature, product
    return x, iteration, True


class Multigrid:
    """Smoothed-aggregation multigrid (Vanek, Mandel, Brezina 1996), as a preconditioner.

    Aggregates are whole neighbourhoods; the prolongation is smoothed by one Jacobi step; the
    smoother is one damped Jacobi sweep before and after, which also serves unknowns that are
    coupled to no other (fixed ones, and what small components shrink to); a small coarsest level
    is solved densely.
    """

    def __init__(self, matrix: Csr, roots: Floats, progress: Progress = Progress(None)) -> None:
        # `matrix` lacks its diagonal of ones. In scaled unknowns, what the Laplacian leaves
        # alone is not the constant but D^(1/2), and 1 at fixed unknowns.
        start, columns, values = matrix
        n = len(roots)
        off = scipy.sparse.csr_matrix((values, columns.view(np.int32), start), shape=(n, n))
        a = (off + scipy.sparse.identity(n)).tocsr()
        a.eliminate_zeros()
        smooth = np.where(roots > 0, 1.0 / np.where(roots > 0, roots, 1.0), 1.0)
        self._levels: list[_Level] = []
        while a.shape[0] > _DENSE and len(self._levels) < 20:
            still = min(0.2 * len(self._levels), 1.0)
            level, coarse, smooth = _coarsen(a, smooth, progress.part(still, still, "Coarsening"))
            if coarse.shape[0] > 0.8 * a.shape[0]:
                break
            self._levels.append(level)
            a = coarse
        self._inverse = None
        if 0 < a.shape[0] <= _DENSE:
            self._inverse = np.linalg.pinv(a.toarray(), hermitian=True)
        self._diagonal = a.diagonal()[:, None]

    def cycle(self, right: Floats, out: Floats) -> None:
        """One V-cycle from zero: `out` becomes an approximate solution for `right`."""
        out[:] = self._solve(0, right)

    def _solve(self, depth: int, right: Floats) -> Floats:
        if depth == len(self._levels):
            if self._inverse is None:
                return right / self._diagonal
            return self._inverse @ right
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


@dataclass(frozen=True)
class _Level:
    matrix: Csr
    prolongation: Csr
    restriction: Csr
    smoother: Floats  # damped inverse of the diagonal
    size: int  # of the next level


def _coarsen(
    a: scipy.sparse.csr_matrix, smooth: Floats, progress: Progress = Progress(None)
) -> tuple[_Level, scipy.sparse.csr_matrix, Floats]:
    # `smooth` is the vector that coarse levels must be able to represent.
    n = a.shape[0]
    diagonal = a.diagonal()
    aggregates = np.full(n, -1, dtype=np.int32)
    size = _aggregate(a.indptr, a.indices, a.data, aggregates)
    coupled = np.flatnonzero(aggregates >= 0)
    members = aggregates[coupled]
    norms = np.sqrt(np.bincount(members, weights=smooth[coupled] ** 2, minlength=size))
    tentative = scipy.sparse.csr_matrix(
        (smooth[coupled] / norms[members], (coupled, members)), shape=(n, size)
    )
    # Gershgorin bounds the spectrum of D^-1 A; 4/3 of its inverse is the usual damping.
    progress.update(0.0)
    bound = float((abs(a).sum(axis=1).A1 / diagonal).max())
    damping = 4.0 / 3.0 / bound / diagonal
    step = scipy.sparse.diags(damping) @ _product(a, tentative, progress)
    progress.update(0.0)
    prolongation = (tentative - step).tocsr()
    progress.update(0.0)
    restriction = prolongation.T.tocsr()
    coarse = _product(restriction, _product(a, prolongation, progress), progress)
    level = _Level(_arrays(a), _arrays(prolongation), _arrays(restriction), damping, size)
    return level, coarse, norms


def _product(
    a: scipy.sparse.csr_matrix, b: scipy.sparse.csr_matrix, progress: Progress = Progress(None)
) -> scipy.sparse.csr_matrix:
    if a.shape[0] <= _ROWS:  # also none at all
        return a @ b
    parts = [a[rows] @ b for rows in blocks(a.shape[0], _ROWS, progress)]
    return scipy.sparse.vstack(parts, format="csr")


def _arrays(a: scipy.sparse.csr_matrix) -> Csr:
    return a.indptr.astype(np.int32, copy=False), a.indices.astype(np.int32, copy=False), a.data


_ROWS = 1 << 16
"""Rows of a matrix that scipy gets at once."""

_DENSE = 400
"""Most unknowns of a level that is solved densely."""


@kernel
def _scale_weights(start, stop, row_start, columns, weights, roots, values):
    for i in range(start, stop):
        for e in range(row_start[i], row_start[i + 1]):
            values[e] = -weights[e] * roots[i] * roots[columns[e]]


@sum_kernel
def _reduce(start, stop, chunk, alpha, q, r, sums):
    # r -= alpha q; sum of squares of r. Slices, so that the loop becomes vector instructions.
    q = q[start:stop]
    r = r[start:stop]
    total = alpha * 0
    for i in range(r.shape[0]):
        x = r[i] - alpha * q[i]
        r[i] = x
        total += x * x
    sums[start // chunk] = total


@kernel
def _direct(start, stop, alpha, beta, z, x, p):
    # x += alpha p; p = z + beta p
    z = z[start:stop]
    x = x[start:stop]
    p = p[start:stop]
    for i in range(p.shape[0]):
        old = p[i]
        x[i] += alpha * old
        p[i] = z[i] + beta * old


@kernel
def _apply(start, stop, chunk, row_start, columns, values, p, q, sums):
    # q = A p with a diagonal of ones, and the sum of p q. Columns are unsigned, which spares a
    # test for negative indices; they must not be mixed with signed numbers.
    curvature = 0.0
    last = row_start[start]
    for i in range(start, stop):
        first = last
        last = row_start[i + 1]
        x, y, z = p[i, 0], p[i, 1], p[i, 2]
        a, b, c = x, y, z
        for e in range(first, last):
            column = columns[e]
            value = values[e]
            a += value * p[column, 0]
            b += value * p[column, 1]
            c += value * p[column, 2]
        q[i, 0], q[i, 1], q[i, 2] = a, b, c
        curvature += a * x + b * y + c * z
    sums[start // chunk] = curvature


@kernel
def _true_residual(start, stop, row_start, columns, weights, screen, roots, y, right, out):
    for i in range(start, stop):
        if screen[i] == 0:
            continue
        for j in range(3):
            x = roots[i] * y[i, j]
            total = screen[i] * x
            for e in range(row_start[i], row_start[i + 1]):
                c = columns[e]
                total += weights[e] * (x - roots[c] * y[c, j])
            out[i, j] = right[i, j] - roots[i] * total


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
def _aggregate(row_start, columns, values, aggregates):
    # Whole neighbourhoods first; what is left joins the strongest neighbouring aggregate. Rows
    # with nothing but their diagonal belong to none.
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
            aggregates[i] = -2 - joined  # joined, but not to be joined through
        else:
            aggregates[i] = size
            size += 1
    for i in range(n):
        if aggregates[i] < -1:
            aggregates[i] = -2 - aggregates[i]
    return size
