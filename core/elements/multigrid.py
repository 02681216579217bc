# SPDX-License-Identifier: GPL-3.0-or-later
"""Geometric multigrid on a sheet, with an exact solve along the seams (paper B, section 6).

Every second node in both directions is a node of the next level. The smoother is one sweep of
Gauss-Seidel on the regular nodes, even rows, then odd ones (rows of one parity are not coupled, so
they run on all cores), followed by the exact solve of the block. After the coarse correction its
steps are reversed, so that the cycle is symmetric and serves as a preconditioner of conjugate
gradients. After an exact solve the block has no residual, and its values are about to be replaced
by the next solve: restriction and prolongation involve regular nodes only.

Internal vectors are (channels, n): rows become vector instructions, which takes half of the time.
"""

from __future__ import annotations

from concurrent.futures import Future
from typing import Any, NamedTuple

import numpy as np

from ..atlas.sheet import ROWS
from ..base.checks import Floats
from ..base.parallel import beside, kernel, run
from ..base.progress import aside, phase
from ..errors import SolverError
from ..linear.cg import SolveReport
from ..linear.sums import sum_by_halves
from ..mesh.triangle_mesh import Ints
from .coarsening import coarsened, prolong, restrict
from .seam_block import SeamBlock
from .sheet_matrix import (
    BlockRows,
    Runs,
    SheetMatrix,
    Singles,
    block_rows,
    inverse_diagonal,
    kinds_of,
    multiply_block,
    multiply_rows,
    runs_of,
)

DIRECT = 1500
"""Most unknowns of a level that is solved directly."""

LIMIT = 200
"""Most iterations of conjugate gradients."""

_ROUNDING = float(np.finfo(np.float32).eps)
"""Residuals below this share of the solution are due to its rounding and cannot be reduced."""

_BLOCK = 1 << 12
"""Length of the blocks that vectors are cut into; sums are taken block by block."""

_GAP = 32
"""Most numbers without an unknown between two unknowns that cost less than a new span."""

NODES = 1 << 16
"""Nodes that a thread processes at once: waking it takes as long as thousands of them."""


class _Level(NamedTuple):
    matrix: SheetMatrix
    rows: BlockRows
    block: SeamBlock
    runs: Runs
    inverse: Singles  # of the diagonal, 0 where there is no unknown

    @property
    def coarsest(self) -> bool:
        return len(self.runs.columns) == 0


class _Spans(NamedTuple):
    # Spans of numbers that cover all unknowns, in blocks of `_BLOCK`: those of block k start at
    # start[k]. And a sum for each block, overwritten.
    start: Ints
    ranges: Ints
    sums: Floats


class _Vectors(NamedTuple):
    x: Singles
    b: Singles


class SheetSolver:
    """A matrix on a sheet, prepared to be solved for any number of right-hand sides.

    Parameters
    ----------
    matrix : SheetMatrix
    coarsen : bool
        Without coarser levels there is only smoothing, enough for a dominant diagonal.

    Raises
    ------
    SolverError
        If the matrix is not positive definite.
    """

    def __init__(self, matrix: SheetMatrix, coarsen: bool = True) -> None:
        self._kept: dict[int, list[_Vectors]] = {}
        self._vectors: list[Singles] | None = None
        parts: list[tuple[SheetMatrix, BlockRows, Runs, Singles]] = []
        blocks: list[Future[SeamBlock]] = []
        with beside() as begin:
            while True:
                done = min(0.2 * len(blocks), 0.9)
                with phase(done, done, "Coarsening"):
                    whole = int((matrix.labels >= 0).sum()) <= DIRECT
                    kinds = kinds_of(matrix, whole)
                    rows, number = block_rows(matrix, kinds)
                    inverse = inverse_diagonal(matrix, kinds, rows)
                    # Factoring takes one core, and the rest of the set-up does not need it.
                    blocks.append(begin(SeamBlock, rows, number))
                    parts.append((matrix, rows, runs_of(kinds), inverse))
                    if len(parts[-1][2].columns) == 0 or not coarsen:
                        break
                    matrix = coarsened(matrix, kinds, rows, number)
        self._levels = [
            _Level(matrix, rows, block.result(), runs, inverse)
            for (matrix, rows, runs, inverse), block in zip(parts, blocks, strict=True)
        ]
        self._spans = _spans_of(self._levels[0].inverse)

    def apply(self, x: Singles, out: Singles) -> None:
        """Write ``A x`` (n, c) to `out`, only at unknowns."""
        flat, product = np.zeros(x.shape[::-1], np.float32), np.zeros(x.shape[::-1], np.float32)
        self._run(_transpose, x, flat)
        self._multiply(flat, product)
        self._run(_transpose_back, self._levels[0].inverse, product, out)

    def solve(
        self,
        rhs: Singles,
        x: Singles,
        tolerance: float = 1e-3,
        message: str = "Solving",
    ) -> SolveReport:
        """Solve ``A x = rhs`` by conjugate gradients, all channels as one vector.

        Parameters
        ----------
        rhs : (n, c) float32
        x : (n, c) float32
            Initial guess, 0 where there is no unknown. Becomes the solution at the unknowns. After
            an exception it is still a valid initial guess.
        tolerance : float
            Largest residual relative to the right-hand side, with each equation divided by the
            root of its diagonal entry.
        message : str
            What is being solved, shown to people.

        Returns
        -------
        report : SolveReport

        Raises
        ------
        SolverError
            If the matrix is not positive definite, the right-hand side is not finite, or the
            tolerance is not reached within `LIMIT` iterations, though single precision allows it.
        """
        with aside(message):
            if self._vectors is None or len(self._vectors[0]) != x.shape[1]:
                self._vectors = [np.zeros(x.shape[::-1], np.float32) for _ in range(4)]
            vectors = self._vectors
            self._run(_transpose, rhs, vectors[0])
            self._run(_transpose, x, vectors[3])
            scale = self._norm(vectors[0])
            if not np.isfinite(scale):
                raise SolverError("The right-hand side of the linear system is not finite.")
            if scale == 0:
                x[:] = 0.0
                return SolveReport(0, 0.0, True)
            relative, reachable = self._residual(rhs, vectors, scale)
        iterations = 0
        while relative > max(tolerance, reachable) and iterations < LIMIT:
            wanted = max(0.9 * tolerance / relative, 1e-7)
            with phase(0.0, 1.0, message):
                count, sound = self._conjugate_gradients(
                    vectors, wanted, LIMIT - iterations, message
                )
            iterations += count
            with aside(message):
                before = relative
                relative, reachable = self._residual(rhs, vectors, scale)
            if not sound or not relative <= 0.5 * before:
                break
        if iterations:
            with aside(message):
                self._run(_transpose_back, self._levels[0].inverse, vectors[3], x)
        if not relative <= max(tolerance, reachable):
            if not np.isfinite(relative):
                x[:] = 0.0
            raise SolverError(
                "The linear solve stopped at a relative residual of {relative:.1e} after"
                " {iterations} iterations ({tolerance:.1e} is needed).",
                relative=relative,
                iterations=iterations,
                tolerance=tolerance,
            )
        return SolveReport(iterations, relative, True)

    def cycle(self, b: Singles, x: Singles) -> None:
        """Solve ``A x = b`` approximately by one V-cycle from zero: (c, n)."""
        self._cycle(0, b, x, self._buffers(len(x)))

    def relax(self, b: Singles, x: Singles) -> None:
        """Improve the solution `x` of ``A x = b`` by one smoothing sweep over all: (c, n)."""
        if len(self._levels[0].runs.columns):
            self._sweep(0, b, x)
        self._levels[0].block.solve(b, x)

    def residual(self, b: Singles, x: Singles) -> float:
        """Return the residual relative to `b`, in the norm of `solve`: (c, n)."""
        r = np.zeros_like(x)
        self._multiply(x, r)
        self._run(_subtract_from, self._levels[0].inverse, b.T, r)
        return self._norm(r) / max(self._norm(b), 1e-30)

    def _residual(self, rhs: Singles, vectors: list[Singles], scale: float) -> tuple[float, float]:
        # Writes the residual to the first vector, which holds the right-hand side while the
        # solution, the last one, is 0. Returns its norm, and the norm that the rounding of the
        # solution alone causes.
        r, *_, x = vectors
        size = self._norm(x, solution=True)
        if size > 0:
            self._multiply(x, r)
            self._run(_subtract_from, self._levels[0].inverse, rhs, r)
        return self._norm(r) / scale, _ROUNDING * size / scale

    def _conjugate_gradients(
        self, vectors: list[Singles], tolerance: float, limit: int, message: str
    ) -> tuple[int, bool]:
        # Returns the number of iterations, and whether the matrix behaved as positive definite.
        r, z, p, x = vectors
        inverse, sums = self._levels[0].inverse, self._spans.sums
        first = self._norm(r)
        before, done = 1.0, 0.0
        for iteration in range(limit):
            with phase(done, done, message):
                self.cycle(r, z)
                product = self._dot(r, z)
                beta = np.float32(product / before if iteration else 0.0)
                self._run(_update_direction, beta, z, p)
                q = z  # reuses the memory of z
                self._multiply(p, q)
                curvature = self._dot(p, q)
                if not (curvature > 0 and product > 0):
                    return iteration, False
                alpha = np.float32(product / curvature)
                self._run(_step, alpha, inverse, p, q, x, r, sums)
                norm = float(np.sqrt(sums.sum()))
                if not np.isfinite(norm):
                    return iteration + 1, False
            before = product
            if norm <= tolerance * first:
                break
            # The residual falls roughly geometrically: progress is its logarithm.
            fallen = float(np.log(norm / first) / np.log(tolerance))
            done = min(max(done, (iteration + 1) / limit, fallen), 1.0)
        return iteration + 1, True

    def _cycle(self, depth: int, b: Singles, x: Singles, vectors: list[_Vectors]) -> None:
        matrix, _, block, runs, inverse = self._levels[depth]
        if self._levels[depth].coarsest:
            block.solve(b, x)
            return
        height, width = matrix.labels.shape
        pairs = (height + 1) // 2
        chunk = max(NODES // (2 * width), 1)
        chunks = -(-pairs // chunk)
        smoother = runs, matrix.stencil, inverse, b, x
        x[:, height * width :] = 0.0
        run(_sweep_down, pairs, *smoother, chunk=chunk)
        run(_sweep_between, chunks, chunk, False, *smoother)
        block.solve(b, x)
        if depth + 1 < len(self._levels):
            coarse = vectors[depth]
            run(restrict, height // 2 + 1, matrix.stencil, matrix.screen, runs, b, x, coarse.b,
                chunk=chunk)  # fmt: skip
            self._cycle(depth + 1, coarse.b, coarse.x, vectors)
            run(prolong, height, runs, coarse.x, x, width, chunk=2 * chunk)
            block.solve(b, x)
        self._sweep(depth, b, x)

    def _sweep(self, depth: int, b: Singles, x: Singles) -> None:
        # Over the regular nodes, odd rows first.
        matrix, _, _, runs, inverse = self._levels[depth]
        height, width = matrix.labels.shape
        pairs = (height + 1) // 2
        chunk = max(NODES // (2 * width), 1)
        smoother = runs, matrix.stencil, inverse, b, x
        run(_sweep_up, pairs, *smoother, chunk=chunk)
        run(_sweep_between, -(-pairs // chunk), chunk, True, *smoother)

    def _multiply(self, x: Singles, out: Singles) -> None:
        # A x at the unknowns: (c, n)
        matrix, rows, _, runs, _ = self._levels[0]
        run(multiply_rows, len(matrix.labels), matrix.stencil, matrix.screen, runs, x, out,
            chunk=ROWS)  # fmt: skip
        run(multiply_block, len(rows.unknowns), rows, x, out)

    def _norm(self, values: Singles, solution: bool = False) -> float:
        # Norm of a residual, or of a solution, in unknowns scaled to a diagonal of ones.
        sums = self._spans.sums
        self._run(_add_squares, solution, self._levels[0].inverse, values, sums)
        return float(np.sqrt(sums.sum()))

    def _dot(self, u: Singles, v: Singles) -> float:
        self._run(_add_products, u, v, self._spans.sums)
        return float(self._spans.sums.sum())

    def _run(self, function: Any, *arguments: Any) -> None:
        # Runs a kernel over the blocks of vectors.
        blocks = len(self._spans.sums)
        run(function, blocks, self._spans, *arguments, chunk=max(blocks // 16, 1))

    def _buffers(self, channels: int) -> list[_Vectors]:
        # The vectors of the coarse levels for a number of channels, kept.
        if channels not in self._kept:
            self._kept[channels] = [
                _Vectors(
                    *(np.zeros((channels, level.matrix.labels.size), np.float32) for _ in "xb")
                )
                for level in self._levels[1:]
            ]
        return self._kept[channels]


def _spans_of(inverse: Singles) -> _Spans:
    blocks = -(-len(inverse) // _BLOCK)
    start = np.zeros(blocks + 1, dtype=np.int32)
    run(_count_spans, blocks, inverse, start[1:], chunk=16)
    np.cumsum(start, out=start)
    ranges = np.zeros((start[-1], 2), dtype=np.int32)
    run(_find_spans, blocks, inverse, start, ranges, chunk=16)
    return _Spans(start, ranges, np.zeros(blocks))


@kernel
def _sweep_down(start, stop, runs, stencil, inverse, b, x):
    # Gauss-Seidel from zero: the even row of each pair, then the odd row before it, while both are
    # in the cache; the last odd row is left to `_sweep_between`.
    columns = stencil.shape[2]
    rest = np.empty((x.shape[0], columns), dtype=np.float32)
    pull = np.empty(columns, dtype=np.float32)
    for pair in range(start, stop):
        y = 2 * pair
        x[:, y * columns : min(y + 2, stencil.shape[1]) * columns] = 0
        for k in range(runs.start[y], runs.start[y + 1]):
            # Only the previous node of the row has a value.
            first, last = runs.columns[k]
            i = y * columns + first
            n = last - first
            behind = stencil[0, y, first - 1 : last - 1]
            scale = inverse[i : i + n]
            for u in range(n):
                pull[u] = scale[u] * behind[u]
            for j in range(x.shape[0]):
                rhs = b[j, i : i + n]
                row = rest[j]
                for u in range(n):
                    row[u] = scale[u] * rhs[u]
            _recur(rest, pull[:n], x, i, False)
        if pair > start:
            _relax_row(y - 1, False, runs, stencil, inverse, b, x, rest, pull)


@kernel
def _sweep_up(start, stop, runs, stencil, inverse, b, x):
    # The reverse: the odd row of each pair, then the even one; the first even row is left.
    columns = stencil.shape[2]
    rest = np.empty((x.shape[0], columns), dtype=np.float32)
    pull = np.empty(columns, dtype=np.float32)
    for pair in range(start, stop):
        if 2 * pair + 1 < stencil.shape[1]:
            _relax_row(2 * pair + 1, True, runs, stencil, inverse, b, x, rest, pull)
        if pair > start:
            _relax_row(2 * pair, True, runs, stencil, inverse, b, x, rest, pull)


@kernel
def _sweep_between(start, stop, chunk, backward, runs, stencil, inverse, b, x):
    # The rows that the sweeps over chunks of pairs have left.
    columns = stencil.shape[2]
    rest = np.empty((x.shape[0], columns), dtype=np.float32)
    pull = np.empty(columns, dtype=np.float32)
    for part in range(start, stop):
        y = 2 * chunk * part
        if not backward:
            y = min(y + 2 * chunk, stencil.shape[1] + stencil.shape[1] % 2) - 1
        if y < stencil.shape[1]:
            _relax_row(y, backward, runs, stencil, inverse, b, x, rest, pull)


@kernel
def _relax_row(y, backward, runs, stencil, inverse, b, x, rest, pull):
    # First all neighbours but the previous node, then that node by a recurrence; `rest` and `pull`
    # are working memory.
    columns = stencil.shape[2]
    side = 0 if backward else 1
    for k in range(runs.start[y], runs.start[y + 1]):
        first, last = runs.columns[k]
        i = y * columns + first
        n = last - first
        ahead = stencil[0, y, first - 1 + side : last - 1 + side]
        behind = stencil[0, y, first - side : last - side]
        q = stencil[3, y - 1, first - 1 : last - 1]
        c = stencil[2, y - 1, first:last]
        d = stencil[1, y - 1, first + 1 : last + 1]
        e = stencil[1, y, first:last]
        f = stencil[2, y, first:last]
        g = stencil[3, y, first:last]
        scale = inverse[i : i + n]
        for u in range(n):
            pull[u] = scale[u] * behind[u]
        for j in range(x.shape[0]):
            beside = x[j, i - 1 + 2 * side : i - 1 + 2 * side + n]
            upper = x[j, i - columns - 1 : i - columns + n + 1]
            lower = x[j, i + columns - 1 : i + columns + n + 1]
            rhs = b[j, i : i + n]
            row = rest[j]
            for u in range(n):
                total = rhs[u] - ahead[u] * beside[u]
                total -= q[u] * upper[u] + c[u] * upper[u + 1] + d[u] * upper[u + 2]
                total -= e[u] * lower[u] + f[u] * lower[u + 1] + g[u] * lower[u + 2]
                row[u] = scale[u] * total
        _recur(rest, pull[:n], x, i, backward)


@kernel
def _recur(rest, pull, x, i, backward):
    # Nodes of a run from number i on, each from the previous one. Each waits for the last result:
    # three channels side by side take no longer than one.
    n = len(pull)
    before = i + n if backward else i - 1
    j = 0
    while j < x.shape[0]:
        if j + 2 < x.shape[0]:
            one, two, three = x[j, before], x[j + 1, before], x[j + 2, before]
            here_one, here_two = x[j, i : i + n], x[j + 1, i : i + n]
            here_three = x[j + 2, i : i + n]
            rest_one, rest_two, rest_three = rest[j], rest[j + 1], rest[j + 2]
            if backward:
                for u in range(n - 1, -1, -1):
                    one = rest_one[u] - pull[u] * one
                    two = rest_two[u] - pull[u] * two
                    three = rest_three[u] - pull[u] * three
                    here_one[u], here_two[u], here_three[u] = one, two, three
            else:
                for u in range(n):
                    one = rest_one[u] - pull[u] * one
                    two = rest_two[u] - pull[u] * two
                    three = rest_three[u] - pull[u] * three
                    here_one[u], here_two[u], here_three[u] = one, two, three
            j += 3
        else:
            one = x[j, before]
            here, row = x[j, i : i + n], rest[j]
            if backward:
                for u in range(n - 1, -1, -1):
                    one = row[u] - pull[u] * one
                    here[u] = one
            else:
                for u in range(n):
                    one = row[u] - pull[u] * one
                    here[u] = one
            j += 1


@kernel
def _count_spans(start, stop, inverse, counts):
    for block in range(start, stop):
        last = -1
        for i in range(block * _BLOCK, min((block + 1) * _BLOCK, len(inverse))):
            if inverse[i] > 0:
                counts[block] += last < 0 or i > last + _GAP
                last = i


@kernel
def _find_spans(start, stop, inverse, starts, ranges):
    for block in range(start, stop):
        k = starts[block] - 1
        for i in range(block * _BLOCK, min((block + 1) * _BLOCK, len(inverse))):
            if inverse[i] > 0:
                if k < starts[block] or i >= ranges[k, 1] + _GAP:
                    k += 1
                    ranges[k, 0] = i
                ranges[k, 1] = i + 1


@kernel
def _transpose(start, stop, spans, values, out):
    for first, last in spans.ranges[spans.start[start] : spans.start[stop]]:
        for j in range(values.shape[1]):
            row = out[j, first:last]
            part = values[first:last, j]
            for i in range(len(row)):
                row[i] = part[i]


@kernel
def _transpose_back(start, stop, spans, inverse, values, out):
    for first, last in spans.ranges[spans.start[start] : spans.start[stop]]:
        for j in range(out.shape[1]):
            row = values[j, first:last]
            part = out[first:last, j]
            for i in range(len(row)):
                if inverse[first + i] > 0:
                    part[i] = row[i]


@kernel
def _subtract_from(start, stop, spans, inverse, rhs, product):
    for first, last in spans.ranges[spans.start[start] : spans.start[stop]]:
        for j in range(rhs.shape[1]):
            row = product[j, first:last]
            part = rhs[first:last, j]
            for i in range(len(row)):
                row[i] = part[i] - row[i] if inverse[first + i] > 0 else np.float32(0)


@kernel
def _add_squares(start, stop, spans, solution, inverse, values, sums):
    memory = np.empty(_BLOCK)
    for block in range(start, stop):
        count = 0
        for first, last in spans.ranges[spans.start[block] : spans.start[block + 1]]:
            scale = inverse[first:last]
            squares = memory[count : count + last - first]
            count += last - first
            squares[:] = 0
            for j in range(values.shape[0]):
                row = values[j, first:last]
                for i in range(len(row)):
                    squares[i] += np.float64(row[i]) * row[i]
            if not solution:
                for i in range(len(squares)):
                    squares[i] *= scale[i]
            else:
                for i in range(len(squares)):
                    squares[i] = squares[i] / scale[i] if scale[i] > 0 else 0.0
        sums[block] = sum_by_halves(memory[:count])


@kernel
def _add_products(start, stop, spans, u, v, sums):
    memory = np.empty(_BLOCK)
    for block in range(start, stop):
        count = 0
        for first, last in spans.ranges[spans.start[block] : spans.start[block + 1]]:
            products = memory[count : count + last - first]
            count += last - first
            products[:] = 0
            for j in range(len(u)):
                one = u[j, first:last]
                other = v[j, first:last]
                for i in range(len(one)):
                    products[i] += np.float64(one[i]) * other[i]
        sums[block] = sum_by_halves(memory[:count])


@kernel
def _update_direction(start, stop, spans, beta, z, p):
    for first, last in spans.ranges[spans.start[start] : spans.start[stop]]:
        for j in range(len(p)):
            one = z[j, first:last]
            row = p[j, first:last]
            if beta == 0:
                row[:] = one
                continue
            for i in range(len(row)):
                row[i] = one[i] + beta * row[i]


@kernel
def _step(start, stop, spans, alpha, inverse, p, q, x, r, sums):
    # Moves along the direction p; sums the squares of the new residual.
    memory = np.empty(_BLOCK)
    for block in range(start, stop):
        count = 0
        for first, last in spans.ranges[spans.start[block] : spans.start[block + 1]]:
            scale = inverse[first:last]
            squares = memory[count : count + last - first]
            count += last - first
            squares[:] = 0
            for j in range(len(p)):
                direction, change = p[j, first:last], q[j, first:last]
                solution, residual = x[j, first:last], r[j, first:last]
                for i in range(len(direction)):
                    solution[i] += alpha * direction[i]
                    value = residual[i] - alpha * change[i]
                    residual[i] = value
                    squares[i] += np.float64(value) * value * scale[i]
        sums[block] = sum_by_halves(memory[:count])
