# SPDX-License-Identifier: GPL-3.0-or-later
"""Preconditioned conjugate gradients over our own kernels, for any number of columns.

All columns form one long vector: an iteration reads the matrix once for all of them, and rotating
three coordinates rotates the solution. The preconditioner is the diagonal where that converges
quickly, in single precision with the residual checked in double precision; elsewhere it is one
V-cycle of smoothed-aggregation multigrid, in double precision.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.checks import Floats
from ..base.parallel import chunk_size, kernel, run
from ..base.progress import aside, phase
from ..errors import SolverError
from .multigrid import Csr, Multigrid
from .sums import sum_by_halves
from .system import LinearSystem

PATIENCE = 400
"""Iterations with the diagonal after which multigrid takes over."""

PATIENCE_AT_HUBS = 100
"""The same for matrices with hubs (see `LinearSystem`), around which it may need thousands."""

LIMIT = 1000
"""Most iterations with multigrid."""

ALONE = 40_000
"""Most rows for which one thread iterates alone; two cores together are faster from 50,000 on."""

_AT_ONCE = 8
"""Iterations of one thread between two checks for cancelling."""


class SolveReport(NamedTuple):
    """Statistics of a solve.

    Attributes
    ----------
    iterations : int
        Iterations of conjugate gradients.
    residual : float
        Norm of the residual of all columns, relative to that of the right-hand side; each equation
        is divided by the root of its diagonal entry, so that units do not matter.
    multigrid : bool
        Whether the multilevel preconditioner was used.
    """

    iterations: int
    residual: float
    multigrid: bool


def solve(
    system: LinearSystem,
    rhs: Floats,
    tolerance: float,
    *,
    multigrid: bool = False,
    precise: bool = False,
    message: str = "Solving",
) -> tuple[Floats, SolveReport]:
    """Solve ``A x = rhs`` for all columns of the right-hand side at once.

    Parameters
    ----------
    system : LinearSystem
    rhs : (n,) or (n, k) float64
        Any number of columns. Rows of fixed unknowns do not count.
    tolerance : float
        Largest residual, relative as in `SolveReport`: scale columns that are much smaller than
        others, or solve for them separately.
    multigrid : bool
        Use the multilevel preconditioner from the start instead of the diagonal.
    precise : bool
        Iterate in double precision, which takes longer: for results whose rounding would grow.
    message : str
        What is being solved, shown to people.

    Returns
    -------
    x : array like `rhs`
        0 at fixed unknowns. In a connected part where neither screening nor a fixed unknown
        determines the constant, it is right up to a constant.
    report : SolveReport

    Raises
    ------
    SolverError
        If the system is not positive definite or finite, has no solution, or the tolerance is not
        reached within `PATIENCE` (at hubs `PATIENCE_AT_HUBS`) and then `LIMIT` iterations.

    Notes
    -----
    With values `known` at fixed unknowns, or an initial guess, solve for the correction:
    ``x = known + solve(system, system.residual(known, rhs), tolerance)[0]``.
    """
    columns = np.ascontiguousarray(rhs, dtype=np.float64)
    right = np.empty((len(columns), columns.size // max(len(columns), 1)))
    with aside(message):
        run(_scale, len(right), system.inverse_root, columns.reshape(right.shape), right)
        norm = _norm(right)
    if not np.isfinite(norm):
        raise SolverError("The right-hand side of the linear system is not finite.")
    # In scaled unknowns and equations, iterate until the residual is below tolerance * norm.
    y, residual = np.zeros(right.shape), right.copy()
    relative = 1.0 if norm > 0 else 0.0
    iterations, patience = 0, PATIENCE_AT_HUBS if system.has_hubs else PATIENCE
    if multigrid:
        patience = LIMIT
    hierarchy = None
    while relative > tolerance and patience > 0:
        with aside(message):
            matrix = system.double if multigrid or precise else system.single
        if multigrid:
            with phase(0.0, 0.3, "Coarsening"):
                hierarchy = system.hierarchy
        wanted = max(0.9 * tolerance / relative, 1e-4)  # single precision has few digits
        with phase(0.3 if multigrid else 0.0, 1.0, message):
            step, count, sound = _conjugate_gradients(
                matrix, residual, wanted, hierarchy, patience, message
            )
            iterations += count
            patience -= max(count, 1)
            if sound:
                y += step
                with aside(message):
                    system.scaled_residual(y, right, residual)
        with aside(message):
            before, relative = relative, _norm(residual) / norm
        if relative <= tolerance:
            break
        if not multigrid and (patience <= 0 or relative > 0.5 * before):
            multigrid, patience = True, LIMIT  # the diagonal does not converge
        elif multigrid and not sound:
            break
    if not relative <= tolerance:
        raise SolverError(
            "The linear solve stopped at a relative residual of {relative:.1e} after {iterations}"
            " iterations ({tolerance:.1e} is needed).",
            relative=relative,
            iterations=iterations,
            tolerance=tolerance,
        )
    with aside(message):
        run(_scale, len(y), system.inverse_root, y, y)
    return y.reshape(columns.shape), SolveReport(iterations, relative, multigrid)


def roughly(system: LinearSystem, rhs: Floats, iterations: int, message: str) -> Floats:
    """Solve ``A x = rhs`` by a fixed number of iterations, without a tolerance.

    Parameters and result are as in `solve`; serves as a preconditioner for matrices near `system`.
    """
    right = np.empty_like(rhs)
    run(_scale, len(rhs), system.inverse_root, rhs, right)
    step, _, _ = _conjugate_gradients(system.double, right, 0.0, None, iterations, message)
    out = np.empty_like(rhs)
    run(_scale, len(rhs), system.inverse_root, step, out)
    return out


def _norm(values: Floats) -> float:
    # Not numpy's norm, whose threads compete with ours.
    flat = values.reshape(-1)
    size = chunk_size(len(flat))
    sums = np.zeros(-(-len(flat) // size))
    run(_add_squares, len(flat), size, flat, sums, chunk=size)
    return float(np.sqrt(sums.sum()))


def _conjugate_gradients(
    matrix: Csr,
    residual: npt.NDArray[np.floating],
    tolerance: float,
    hierarchy: Multigrid | None,
    limit: int,
    message: str,
) -> tuple[npt.NDArray[np.floating], int, bool]:
    # In the precision of the matrix, from the initial guess zero. Returns the solution, the number
    # of iterations, and whether the matrix behaved like a positive definite one.
    n, columns = residual.shape
    r = residual.astype(matrix[2].dtype)
    kind = r.dtype.type
    # Not zeros_like, which writes the zeros now and in this thread.
    x, p, q = (np.zeros(r.shape, r.dtype) for _ in range(3))
    if hierarchy is None and n <= ALONE:
        return x, *_iterate_alone(matrix, r, x, p, q, tolerance, limit, message)
    flat = [array.reshape(-1) for array in (x, p, q, r)]
    size = chunk_size(n)
    wide = columns * size
    sums = np.zeros(-(-n // size))
    apply = _apply_three if columns == 3 else _apply
    alpha, before, scale, done = 0.0, 1.0, 0.0, 0.0
    for iteration in range(limit + 1):
        with phase(done, done, message):
            run(_reduce, columns * n, wide, kind(alpha), flat[2], flat[3], sums, chunk=wide)
            product = float(sums.sum())
            norm = float(np.sqrt(product))
            if iteration == 0:
                scale = norm
            if not np.isfinite(norm):
                return x, iteration, False
            z = flat[3]
            if hierarchy is not None:
                z = hierarchy.cycle(r).reshape(-1)
                product = float(np.vdot(r, z))
            beta = product / before if iteration else 0.0
            # Also adds the last step to x, while p is in the cache.
            run(_update_direction, columns * n, kind(alpha), kind(beta), z, flat[0], flat[1],
                chunk=wide)  # fmt: skip
            if norm <= tolerance * scale or iteration == limit:
                break
            run(apply, n, size, *matrix, p, q, sums, chunk=size)
        curvature = float(sums.sum())
        if not curvature > 0:
            return x, iteration, False
        alpha, before = product / curvature, product
        done = _progress(iteration / limit, norm / scale, tolerance)
    return x, iteration, True


def _iterate_alone(
    matrix: Csr,
    r: npt.NDArray[np.floating],
    x: npt.NDArray[np.floating],
    p: npt.NDArray[np.floating],
    q: npt.NDArray[np.floating],
    tolerance: float,
    limit: int,
    message: str,
) -> tuple[int, bool]:
    # The same in this thread, with several iterations a call: the same bits. Small systems take
    # longer to wake and to wait for other threads than to iterate.
    size = chunk_size(len(x))
    sums = np.zeros(-(-len(x) // size))
    state = np.array([0.0, 1.0, 0.0, 0.0])
    done = 0.0
    for first in range(0, limit + 1, _AT_ONCE):
        with phase(done, done, message):
            last = min(first + _AT_ONCE, limit + 1)
            iteration = _iterate(
                first, last, size, *matrix, x, p, q, r, sums, state, tolerance, limit
            )
        if iteration < 0:
            return -1 - iteration, False
        if iteration < last:
            break
        done = _progress(iteration / limit, state[3] / state[2], tolerance)
    return iteration, True


def _progress(done: float, residual: float, tolerance: float) -> float:
    # The residual falls roughly geometrically: progress is its logarithm.
    if tolerance > 0:
        done = max(done, min(float(np.log(residual) / np.log(tolerance)), 1.0))
    return done


@kernel
def _iterate(
    start, stop, chunk, row_start, columns, values, x, p, q, r, sums, state, tolerance, limit
):
    # Returns the iteration that is the last one; `stop` if there is none yet; -1 - the iteration
    # where the matrix is not positive definite. State: alpha, product, first and last residual.
    n, count = x.shape
    wide = chunk * count
    flat_x, flat_p = x.reshape(-1), p.reshape(-1)
    flat_q, flat_r = q.reshape(-1), r.reshape(-1)
    for iteration in range(start, stop):
        alpha = r.dtype.type(state[0])
        for first in range(0, n * count, wide):
            _reduce(first, min(first + wide, n * count), wide, alpha, flat_q, flat_r, sums)
        product = _total(sums)
        norm = np.sqrt(product)
        state[3] = norm
        if iteration == 0:
            state[2] = norm
        if not np.isfinite(norm):
            return -1 - iteration
        beta = r.dtype.type(product / state[1] if iteration else 0.0)
        for first in range(0, n * count, wide):
            last = min(first + wide, n * count)
            _update_direction(first, last, alpha, beta, flat_r, flat_x, flat_p)
        if norm <= tolerance * state[2] or iteration == limit:
            return iteration
        for first in range(0, n, chunk):
            last = min(first + chunk, n)
            if count == 3:
                _apply_three(first, last, chunk, row_start, columns, values, p, q, sums)
            else:
                _apply(first, last, chunk, row_start, columns, values, p, q, sums)
        curvature = _total(sums)
        if not curvature > 0:
            return -1 - iteration
        state[0], state[1] = product / curvature, product
    return stop


@kernel
def _total(values):
    # The sum of up to 128 numbers in numpy's order.
    n = len(values)
    if n < 8:
        total = 0.0
        for i in range(n):
            total += values[i]
        return total
    parts = values[:8].copy()
    whole = n - n % 8
    for i in range(8, whole):
        parts[i % 8] += values[i]
    total = (parts[0] + parts[1]) + (parts[2] + parts[3])
    total += (parts[4] + parts[5]) + (parts[6] + parts[7])
    for i in range(whole, n):
        total += values[i]
    return total


@kernel
def _scale(start, stop, scale, values, out):
    for i in range(start, stop):
        for j in range(values.shape[1]):
            out[i, j] = scale[i] * values[i, j]


@kernel
def _add_squares(start, stop, chunk, values, sums):
    values = values[start:stop]
    squares = np.empty(values.shape[0])
    for i in range(len(squares)):
        squares[i] = values[i] * values[i]
    sums[start // chunk] = sum_by_halves(squares)


@kernel
def _reduce(start, stop, chunk, alpha, q, r, sums):
    # r -= alpha q; sum of squares of r. Slices, so that the loop becomes vector instructions.
    q = q[start:stop]
    r = r[start:stop]
    squares = np.empty_like(r)
    for i in range(r.shape[0]):
        x = r[i] - alpha * q[i]
        r[i] = x
        squares[i] = x * x
    sums[start // chunk] = sum_by_halves(squares)


@kernel
def _update_direction(start, stop, alpha, beta, z, x, p):
    # x += alpha p; p = z + beta p
    z = z[start:stop]
    x = x[start:stop]
    p = p[start:stop]
    for i in range(p.shape[0]):
        old = p[i]
        x[i] += alpha * old
        p[i] = z[i] + beta * old


@kernel
def _apply_three(start, stop, chunk, row_start, columns, values, p, q, sums):
    # q = A p for a diagonal of ones, and the sum of p q. Unsigned columns spare a test for
    # negative indices; do not mix them with signed numbers.
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
def _apply(start, stop, chunk, row_start, columns, values, p, q, sums):
    # The same for any number of columns, in pairs, which takes half of the time.
    curvature = 0.0
    last = row_start[start]
    for i in range(start, stop):
        first = last
        last = row_start[i + 1]
        for j in range(0, p.shape[1], 2):
            k = min(j + 1, p.shape[1] - 1)
            x, y = p[i, j], p[i, k]
            a, b = x, y
            for e in range(first, last):
                column = columns[e]
                value = values[e]
                a += value * p[column, j]
                b += value * p[column, k]
            q[i, j], q[i, k] = a, b
            curvature += a * x if k == j else a * x + b * y
    sums[start // chunk] = curvature
