# SPDX-License-Identifier: GPL-3.0-or-later
"""Geometric multigrid on a sheet, with an exact solve along the seams (paper B, section 6).

Every second node in both directions is a node of the next level. One sweep of Gauss-Seidel on the
regular nodes, even rows, then odd ones (rows of one parity do not touch, so they run on all
cores), and the exact solve of the block smooth the error; on the way up they come in reverse, so
that the cycle is symmetric and conjugate gradients may use it. After an exact solve the block has
no residual, and its values are about to be replaced by the next: only regular nodes take part in
what goes between levels.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import chunk_size, run, sum_kernel
from ..base.progress import aside, phase
from ..errors import SolverError
from ..linear.cg import SolveReport
from .coarsening import coarsened, prolong, restrict
from .seam_block import SeamBlock
from .sheet import ROWS
from .sheet_matrix import (
    BlockRows,
    Runs,
    SheetMatrix,
    Singles,
    add_block,
    add_regular,
    block_rows,
    inverse_diagonal,
    kinds_of,
    runs_of,
)

DIRECT = 1500
"""Most unknowns of a level that is solved directly as a whole."""

LIMIT = 200
"""Most iterations of conjugate gradients."""

_ROUNDING = float(np.finfo(np.float32).eps)
"""Residuals below this share of the solution come from its rounding: no solution is better."""

_PAIRS = 16
"""Rows of one parity that a sweep gets at once."""


class _Level(NamedTuple):
    matrix: SheetMatrix
    rows: BlockRows
    block: SeamBlock
    runs: Runs
    inverse: Singles  # of the diagonal, 0 where there is no unknown
    spans: npt.NDArray[np.int32]  # first and last column of the unknowns in each row

    @property
    def coarsest(self) -> bool:
        return len(self.runs.columns) == 0


class _Vectors(NamedTuple):
    x: Singles
    b: Singles
    r: Singles


class SheetSolver:
    """A matrix on a sheet with all that solving needs, for any number of right-hand sides.

    Parameters
    ----------
    matrix : SheetMatrix

    Raises
    ------
    SolverError
        If the matrix is not positive definite.
    """

    def __init__(self, matrix: SheetMatrix) -> None:
        self._levels: list[_Level] = []
        self._vectors: dict[int, list[_Vectors]] = {}
        while True:
            done = min(0.2 * len(self._levels), 1.0)
            with phase(done, done, "Coarsening"):
                whole = int((matrix.labels >= 0).sum()) <= DIRECT
                kinds = kinds_of(matrix, whole)
                rows = block_rows(matrix, kinds)
                level = _Level(
                    matrix, rows, SeamBlock(rows), runs_of(kinds),
                    inverse_diagonal(matrix, kinds, rows), _spans(matrix.labels),
                )  # fmt: skip
                self._levels.append(level)
                if level.coarsest:
                    return
                matrix = coarsened(matrix, kinds, rows)

    def apply(self, x: Singles, out: Singles) -> None:
        """Put ``A x`` (n, c) into `out`; where there is no unknown, that stays as it is."""
        self._add_product(1.0, x, np.broadcast_to(np.float32(0), x.shape), out)

    def solve(
        self,
        rhs: Singles,
        x: Singles,
        tolerance: float = 1e-3,
        limit: int = LIMIT,
        message: str = "Solving",
    ) -> SolveReport:
        """Solve ``A x = rhs`` by conjugate gradients, all channels as one vector.

        Parameters
        ----------
        rhs : (n, c) float32
        x : (n, c) float32
            Where to start, 0 where there is no unknown; it is replaced by the solution.
        tolerance : float
            Wanted residual relative to the right-hand side, where each equation counts divided
            by the root of its diagonal entry.
        limit : int
            Most iterations.
        message : str
            What is being solved, for people.

        Returns
        -------
        report : SolveReport

        Raises
        ------
        SolverError
            If the matrix is not positive definite, the right-hand side is not finite, or the
            tolerance is not reached within `limit` iterations, though single precision could.
        """
        r = np.zeros_like(x)
        with aside(message):
            scale = self._norm(rhs)
            self._add_product(-1.0, x, rhs, r)
            relative = self._norm(r) / scale if scale > 0 else 0.0
        if not np.isfinite(scale):
            raise SolverError("The right-hand side of the linear system is not finite.")
        if scale == 0:
            x[:] = 0.0
        iterations = 0
        reachable = 0.0
        while relative > max(tolerance, reachable) and iterations < limit:
            wanted = max(0.9 * tolerance / relative, 1e-7)
            with phase(0.0, 1.0, message):
                count, sound = self._conjugate_gradients(r, x, wanted, limit - iterations, message)
            iterations += count
            with aside(message):
                self._add_product(-1.0, x, rhs, r)
                before, relative = relative, self._norm(r) / scale
                reachable = _ROUNDING * self._norm(x, solution=True) / scale
            if not sound or not relative <= 0.5 * before:
                break
        if not relative <= max(tolerance, reachable):
            raise SolverError(
                "The linear solve stopped at a relative residual of {relative:.1e} after"
                " {iterations} iterations ({tolerance:.1e} is needed).",
                relative=relative,
                iterations=iterations,
                tolerance=tolerance,
            )
        return SolveReport(iterations, relative, True)

    def cycle(self, b: Singles, x: Singles) -> None:
        """Solve ``A x = b`` (n, c) approximately by one V-cycle from zero."""
        self._cycle(0, b, x, self._buffers(x.shape[1]))

    def _conjugate_gradients(
        self, r: Singles, x: Singles, tolerance: float, limit: int, message: str
    ) -> tuple[int, bool]:
        # Returns the number of iterations, and whether the matrix behaved as a positive one.
        z, p, q = (np.zeros_like(x) for _ in range(3))
        first = self._norm(r)
        size = chunk_size(len(x))
        sums = np.zeros(-(-len(x) // size))
        before, done = 1.0, 0.0
        for iteration in range(limit):
            with phase(done, done, message):
                self.cycle(r, z)
                run(_multiply, len(x), size, r, z, sums, chunk=size)
                product = float(sums.sum())
                beta = np.float32(product / before if iteration else 0.0)
                run(_direct, len(x), beta, z, p, chunk=size)
                self.apply(p, q)
                run(_multiply, len(x), size, p, q, sums, chunk=size)
                curvature = float(sums.sum())
                if not (curvature > 0 and product > 0):
                    return iteration, False
                run(_step, len(x), np.float32(product / curvature), p, q, x, r, chunk=size)
                norm = self._norm(r)
                if not np.isfinite(norm):
                    return iteration + 1, False
            before = product
            if norm <= tolerance * first:
                break
            done = max(
                done, (iteration + 1) / limit, float(np.log(norm / first) / np.log(tolerance))
            )
            done = min(done, 1.0)
        return iteration + 1, True

    def _cycle(self, depth: int, b: Singles, x: Singles, vectors: list[_Vectors]) -> None:
        level = self._levels[depth]
        if level.coarsest:
            level.block.solve(b, x)
            return
        channels = (np.float32(0),) * x.shape[1]
        height, width = level.matrix.labels.shape
        half = (height + 1) // 2
        smoother = level.runs, level.matrix.stencil, level.inverse, b, x, channels
        x[:] = 0.0
        run(_sweep, half, 0, False, *smoother, chunk=_PAIRS)
        run(_sweep, half, 1, False, *smoother, chunk=_PAIRS)
        level.block.solve(b, x)
        r = vectors[depth].r
        run(add_regular, height, np.float32(-1), level.matrix.stencil, level.matrix.screen,
            level.runs, x, b, r, channels, chunk=ROWS)  # fmt: skip
        below, coarse = self._levels[depth + 1], vectors[depth + 1]
        rows, columns = below.matrix.labels.shape
        run(restrict, rows, r, width, coarse.b, columns, below.spans, channels, chunk=ROWS)
        self._cycle(depth + 1, coarse.b, coarse.x, vectors)
        run(prolong, height, level.runs, coarse.x, columns, x, width, channels, chunk=ROWS)
        level.block.solve(b, x)
        run(_sweep, half, 1, True, *smoother, chunk=_PAIRS)
        run(_sweep, half, 0, True, *smoother, chunk=_PAIRS)

    def _add_product(self, factor: float, x: Singles, b: npt.NDArray, out: Singles) -> None:
        # b + factor * A x
        matrix, rows, _, runs, _, _ = self._levels[0]
        channels = (np.float32(0),) * x.shape[1]
        run(add_regular, len(matrix.labels), np.float32(factor), matrix.stencil, matrix.screen,
            runs, x, b, out, channels, chunk=ROWS)  # fmt: skip
        run(add_block, len(rows.unknowns), factor, rows, x, b, out)

    def _norm(self, values: Singles, solution: bool = False) -> float:
        # Of a residual, or of a solution, in the unknowns in which the diagonal is 1.
        size = chunk_size(len(values))
        sums = np.zeros(-(-len(values) // size))
        inverse = self._levels[0].inverse
        run(_add_squares, len(values), size, solution, inverse, values, sums, chunk=size)
        return float(np.sqrt(sums.sum()))

    def _buffers(self, channels: int) -> list[_Vectors]:
        # What the levels need for some number of channels, kept.
        if channels not in self._vectors:
            self._vectors[channels] = [
                _Vectors(*(np.zeros((len(level.inverse), channels), np.float32) for _ in range(3)))
                for level in self._levels
            ]
        return self._vectors[channels]


def _spans(labels: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    there = labels >= 0
    spans = np.zeros((len(labels), 2), dtype=np.int32)
    rows = there.any(axis=1)
    spans[rows, 0] = there.argmax(axis=1)[rows]
    spans[rows, 1] = labels.shape[1] - there[:, ::-1].argmax(axis=1)[rows]
    return spans


@sum_kernel
def _sweep(start, stop, parity, backward, runs, stencil, inverse, b, x, channels):
    # Gauss-Seidel in each second row. The node just updated comes last: it is waited for.
    columns = stencil.shape[2]
    step = -1 if backward else 1
    total = np.empty(len(channels), dtype=np.float32)
    before = np.empty(len(channels), dtype=np.float32)
    for half in range(start, stop):
        y = 2 * half + parity
        if y >= stencil.shape[1]:
            break
        for k in range(runs.start[y], runs.start[y + 1]):
            first, last = runs.columns[k, 0], runs.columns[k, 1]
            u = last - 1 if backward else first
            i = y * columns + u
            for j in range(len(channels)):
                before[j] = x[i - step, j]
            for _ in range(last - first):
                left, right = stencil[0, y, u - 1], stencil[0, y, u]
                ahead = left if backward else right
                behind = right if backward else left
                d = inverse[i]
                for j in range(len(channels)):
                    total[j] = b[i, j] - ahead * x[i + step, j]
                p = i + columns
                a, c, e = stencil[1, y, u], stencil[2, y, u], stencil[3, y, u]
                for j in range(len(channels)):
                    total[j] -= a * x[p - 1, j] + c * x[p, j] + e * x[p + 1, j]
                p = i - columns
                a, c = stencil[3, y - 1, u - 1], stencil[2, y - 1, u]
                e = stencil[1, y - 1, u + 1]
                for j in range(len(channels)):
                    total[j] -= a * x[p - 1, j] + c * x[p, j] + e * x[p + 1, j]
                behind *= d
                for j in range(len(channels)):
                    before[j] = d * total[j] - behind * before[j]
                    x[i, j] = before[j]
                u += step
                i += step


@sum_kernel
def _add_squares(start, stop, chunk, solution, inverse, values, sums):
    total = 0.0
    for i in range(start, stop):
        if inverse[i] == 0:
            continue
        part = 0.0
        for j in range(values.shape[1]):
            part += np.float64(values[i, j]) * values[i, j]
        total += part / inverse[i] if solution else part * inverse[i]
    sums[start // chunk] = total


@sum_kernel
def _multiply(start, stop, chunk, u, v, sums):
    u = u[start:stop].reshape(-1)
    v = v[start:stop].reshape(-1)
    total = 0.0
    for i in range(len(u)):
        total += np.float64(u[i]) * v[i]
    sums[start // chunk] = total


@sum_kernel
def _direct(start, stop, beta, z, p):
    z = z[start:stop].reshape(-1)
    p = p[start:stop].reshape(-1)
    for i in range(len(p)):
        p[i] = z[i] + beta * p[i]


@sum_kernel
def _step(start, stop, alpha, p, q, x, r):
    p = p[start:stop].reshape(-1)
    q = q[start:stop].reshape(-1)
    x = x[start:stop].reshape(-1)
    r = r[start:stop].reshape(-1)
    for i in range(len(p)):
        x[i] += alpha * p[i]
        r[i] -= alpha * q[i]
