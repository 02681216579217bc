# SPDX-License-Identifier: GPL-3.0-or-later
"""A symmetric matrix over the nodes of a sheet and points along its seams, stored as couplings.

Row i of A x is ``screen_i x_i`` plus the sum over j of ``a_ij (x_j - x_i)``, so that constants stay
exact under rounding. An unknown is *regular* if only the stencil couples it, with eight neighbors
of its own chart. All others, a thin strip along chart outlines, are the *block*: their rows are
gathered here, and `seam_block` solves for them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..atlas.sheet import NOTHING, ROWS
from ..base.parallel import kernel, run
from ..errors import SolverError
from ..mesh.triangle_mesh import Floats, Ints

Singles = npt.NDArray[np.float32]

NONE, REGULAR, STENCILED, LOOSE = 0, 1, 2, 3
"""Kinds of nodes: no unknown; regular; in the block with all its coarse parents; without them."""

_STRETCHED_NODE = 4
_STRETCHED = 0.22
"""Nodes with a coupling above this positive share of the diagonal also belong to the block.

Their texels are so stretched that smoothing hardly helps; the share cannot exceed 0.25.
"""

_MOST_STRETCHED = 0.05
"""With a larger share of such nodes, all are left to smoothing: the block would be no strip."""


class SheetMatrix(NamedTuple):
    """A symmetric positive matrix over the nodes of a sheet and points along its seams.

    Unknown ``row * columns + column`` is a node, ``rows * columns + k`` is seam point k. The
    diagonal is not stored: it is the screening minus the sum of the couplings of both kinds.

    Attributes
    ----------
    stencil : (4, rows, columns) float32
        Matrix entries of the node (y, x) with (y, x + 1), (y + 1, x - 1), (y + 1, x) and
        (y + 1, x + 1), mostly below 0.
    labels : (rows, columns) int32
        The chart of each node that is an unknown, -1 for others. The first and last row and column
        hold no unknown.
    screen : (n,) floating
        Screening: the row sums of the matrix.
    seam : (s,) int32
        Unknowns that the seam part couples, ascending: nodes, then all seam points.
    start, columns_, values : (s + 1,), (k,) int32, (k,) float64
        The seam part as a symmetric sparse matrix over the numbers 0 to s - 1, without a diagonal.
    """

    stencil: Singles
    labels: Ints
    screen: npt.NDArray[np.floating]
    seam: Ints
    start: Ints
    columns_: Ints
    values: Floats


class BlockRows(NamedTuple):
    """Rows of the matrix for the unknowns of the block.

    Attributes
    ----------
    unknowns : (b,) int32
        Numbers of the unknowns, ascending.
    start, middle : (b + 1,), (b,) int32
        Row p has the entries from ``start[p]`` on; those from ``middle[p]`` on couple it with
        regular unknowns.
    columns, values : (k,) int32, float64
        The coupled unknowns and the couplings; some occur twice.
    screen, diagonal : (b,) float64
    """

    unknowns: Ints
    start: Ints
    middle: Ints
    columns: Ints
    values: Floats
    screen: Floats
    diagonal: Floats


class Runs(NamedTuple):
    """Runs of regular nodes: those of row y start at ``start[y]``; run k is ``columns[k, 0:2]``."""

    start: Ints
    columns: Ints


def kinds_of(matrix: SheetMatrix, whole: bool) -> npt.NDArray[np.uint8]:
    """Classify the nodes: (rows, columns); `whole` puts all unknowns into the block.

    Raises
    ------
    ValueError
        If a node that is not an unknown is coupled, or an unknown lies in the outermost rows or
        columns.
    """
    rows, columns = matrix.labels.shape
    kinds = np.zeros((rows, columns), dtype=np.uint8)
    counts = np.zeros((rows, 3), dtype=np.int64)
    run(_sort, rows, matrix.labels, matrix.stencil, matrix.screen, whole, kinds, counts,
        chunk=ROWS)  # fmt: skip
    unknowns, stretched, wrong = counts.sum(axis=0)
    few = stretched <= _MOST_STRETCHED * unknowns
    kinds[kinds == _STRETCHED_NODE] = STENCILED if few else REGULAR
    nodes = matrix.seam[: np.searchsorted(matrix.seam, rows * columns)]
    edges = matrix.labels[[0, -1]], matrix.labels[:, [0, -1]]
    if wrong or (matrix.labels.reshape(-1)[nodes] < 0).any():
        raise ValueError("A node that is no unknown is coupled; give it the label of its chart.")
    if any((edge >= 0).any() for edge in edges):
        raise ValueError("The sheet's first and last row and column may hold no unknown.")
    run(_put_into_block, len(nodes), nodes, matrix.labels, kinds)
    return kinds


def block_rows(matrix: SheetMatrix, kinds: npt.NDArray[np.uint8]) -> tuple[BlockRows, Ints]:
    """Gather the rows of the block, and number its unknowns; -1 for unknowns outside.

    Raises
    ------
    SolverError
        If a diagonal entry is not above 0.
    """
    nodes = np.flatnonzero(kinds.reshape(-1) >= STENCILED).astype(np.int32)
    points = np.arange(kinds.size, len(matrix.screen), dtype=np.int32)
    unknowns = np.concatenate([nodes, points])
    number = np.full(len(matrix.screen), -1, dtype=np.int32)
    number[unknowns] = np.arange(len(unknowns), dtype=np.int32)
    of_seam = np.full(len(unknowns), -1, dtype=np.int32)
    of_seam[number[matrix.seam]] = np.arange(len(matrix.seam), dtype=np.int32)
    start = np.zeros(len(unknowns) + 1, dtype=np.int32)
    run(_count_entries, len(unknowns), unknowns, of_seam, matrix, start[1:])
    np.cumsum(start, out=start)
    middle = np.empty(len(unknowns), dtype=np.int32)
    columns, values = np.empty(start[-1], dtype=np.int32), np.empty(start[-1])
    screen = matrix.screen[unknowns].astype(np.float64)
    diagonal = np.empty(len(unknowns))
    rows = BlockRows(unknowns, start, middle, columns, values, screen, diagonal)
    run(_gather_rows, len(unknowns), rows, number, of_seam, matrix)
    require_positive(diagonal)
    return rows, number


def inverse_diagonal(matrix: SheetMatrix, kinds: npt.NDArray[np.uint8], rows: BlockRows) -> Singles:
    """Invert the diagonal: (n,), 0 where there is no unknown."""
    inverse = np.zeros(len(matrix.screen), dtype=np.float32)
    run(_invert, len(kinds), matrix.stencil, matrix.screen, kinds, inverse, chunk=ROWS)
    inverse[rows.unknowns] = 1.0 / rows.diagonal
    require_positive(np.array([inverse.min(initial=0.0) >= 0.0, np.isfinite(inverse.sum())]))
    return inverse


def runs_of(kinds: npt.NDArray[np.uint8]) -> Runs:
    """Find the runs of regular nodes in each row."""
    start = np.zeros(len(kinds) + 1, dtype=np.int32)
    run(_count_runs, len(kinds), kinds, start[1:], chunk=ROWS)
    np.cumsum(start, out=start)
    runs = Runs(start, np.empty((start[-1], 2), dtype=np.int32))
    run(_find_runs, len(kinds), kinds, runs, chunk=ROWS)
    return runs


def without_held(matrix: SheetMatrix, held: npt.NDArray[np.bool_]) -> SheetMatrix:
    """Take nodes that are held at 0 out of a matrix.

    Parameters
    ----------
    matrix : SheetMatrix
    held : (rows, columns) bool
        The nodes; what it says of nodes that are no unknowns does not count.

    Returns
    -------
    SheetMatrix
        The rows and columns of all other unknowns. Couplings to held nodes become screening, which
        leaves the diagonal as it is, up to rounding.
    """
    held = held & (matrix.labels >= 0)
    stencil, screen = matrix.stencil.copy(), matrix.screen.copy()
    run(_take_out, len(held), held, matrix.stencil, stencil, screen, chunk=ROWS)
    flat = np.zeros(len(screen), dtype=np.bool_)
    flat[: held.size] = held.reshape(-1)
    out = flat[matrix.seam]
    of = np.repeat(np.arange(len(out), dtype=np.int32), np.diff(matrix.start))
    lost = out[matrix.columns_] & ~out[of]
    fixed = np.bincount(of[lost], matrix.values[lost], len(out))
    screen[matrix.seam] -= fixed.astype(screen.dtype)
    kept = ~(out[matrix.columns_] | out[of])
    number = np.cumsum(~out, dtype=np.int32) - 1
    start = np.zeros(int(np.count_nonzero(~out)) + 1, dtype=np.int32)
    np.cumsum(np.bincount(number[of[kept]], minlength=len(start) - 1), out=start[1:])
    return SheetMatrix(
        stencil,
        np.where(held, NOTHING, matrix.labels),
        screen,
        matrix.seam[~out],
        start,
        number[matrix.columns_[kept]],
        matrix.values[kept],
    )


def require_positive(values: npt.NDArray) -> None:
    """Raise `SolverError` unless all values, entries of a diagonal, are above 0."""
    if not (np.isfinite(values) & (values > 0)).all():
        raise SolverError(
            "The matrix of the texture is not positive definite. Check the mesh and its texture"
            " coordinates for numbers that are not finite, and raise the fidelity above 0."
        )


@kernel
def diagonal_of(stencil, screen, y, x):
    """The diagonal entry of a node that no seam touches, in single precision."""
    couplings = stencil[0, y, x] + stencil[0, y, x - 1] + stencil[1, y, x] + stencil[2, y, x]
    couplings += stencil[3, y, x] + stencil[1, y - 1, x + 1] + stencil[2, y - 1, x]
    couplings += stencil[3, y - 1, x - 1]
    return np.float32(screen[y * stencil.shape[2] + x]) - couplings


@kernel
def _sort(start, stop, labels, stencil, screen, whole, kinds, counts):
    for y in range(max(start, 1), min(stop, labels.shape[0] - 1)):
        for x in range(1, labels.shape[1] - 1):
            label = labels[y, x]
            if label < 0:
                for k in range(8):
                    if _beside(stencil, y, x, k)[2] != 0:
                        counts[y, 2] += 1
                continue
            alone = labels[y, x - 1] != label or labels[y, x + 1] != label
            for u in range(x - 1, x + 2):
                alone |= labels[y - 1, u] != label or labels[y + 1, u] != label
            counts[y, 0] += 1
            if alone or whole:
                kinds[y, x] = _in_block(labels, y, x)
                continue
            most = max(stencil[0, y, x], stencil[0, y, x - 1])
            most = max(most, max(stencil[1, y, x], stencil[1, y - 1, x + 1]))
            most = max(most, max(stencil[2, y, x], stencil[2, y - 1, x]))
            most = max(most, max(stencil[3, y, x], stencil[3, y - 1, x - 1]))
            kinds[y, x] = REGULAR
            if most > 0 and most > _STRETCHED * diagonal_of(stencil, screen, y, x):
                kinds[y, x] = _STRETCHED_NODE
                counts[y, 1] += 1


@kernel
def _in_block(labels, y, x):
    # Coarse parents are the nodes at even places among the node and its neighbors.
    for v in range(y - (y & 1), y + (y & 1) + 1, 2):
        for u in range(x - (x & 1), x + (x & 1) + 1, 2):
            if labels[v, u] != labels[y, x]:
                return LOOSE
    return STENCILED


@kernel
def _put_into_block(start, stop, nodes, labels, kinds):
    for k in range(start, stop):
        y, x = divmod(nodes[k], labels.shape[1])
        kinds[y, x] = _in_block(labels, y, x)


@kernel
def _beside(stencil, y, x, k):
    # Row, column and coupling of the k-th of the eight neighbors.
    if k == 0:
        return y, x + 1, stencil[0, y, x]
    if k == 1:
        return y, x - 1, stencil[0, y, x - 1]
    if k < 5:
        return y + 1, x + k - 3, stencil[k - 1, y, x]
    return y - 1, x + 6 - k, stencil[k - 4, y - 1, x + 6 - k]


@kernel
def _take_out(start, stop, held, given, stencil, screen):
    rows, columns = held.shape
    for y in range(max(start, 1), min(stop, rows - 1)):
        for x in range(1, columns - 1):
            i = y * columns + x
            if held[y, x]:
                stencil[:, y, x] = 0
                screen[i] = 0
                continue
            for k in range(8):
                v, u, value = _beside(given, y, x, k)
                if value == 0 or not held[v, u]:
                    continue
                screen[i] -= value
                if k == 0:
                    stencil[0, y, x] = 0
                elif 2 <= k < 5:
                    stencil[k - 1, y, x] = 0


@kernel
def _count_entries(start, stop, unknowns, of_seam, matrix, counts):
    for p in range(start, stop):
        s = of_seam[p]
        if s >= 0:
            counts[p] += matrix.start[s + 1] - matrix.start[s]
        if unknowns[p] < matrix.labels.size:
            y, x = divmod(unknowns[p], matrix.labels.shape[1])
            for k in range(8):
                counts[p] += _beside(matrix.stencil, y, x, k)[2] != 0


@kernel
def _gather_rows(start, stop, rows, number, of_seam, matrix):
    for p in range(start, stop):
        first = rows.start[p]
        last = rows.start[p + 1]
        total = 0.0
        s = of_seam[p]
        if s >= 0:
            for e in range(matrix.start[s], matrix.start[s + 1]):
                rows.columns[first] = matrix.seam[matrix.columns_[e]]
                rows.values[first] = matrix.values[e]
                total += matrix.values[e]
                first += 1
        if rows.unknowns[p] < matrix.labels.size:
            y, x = divmod(rows.unknowns[p], matrix.labels.shape[1])
            for k in range(8):
                v, u, value = _beside(matrix.stencil, y, x, k)
                if value == 0:
                    continue
                column = v * matrix.labels.shape[1] + u
                if number[column] >= 0:
                    place = first
                    first += 1
                else:
                    last -= 1
                    place = last
                rows.columns[place] = column
                rows.values[place] = value
                total += value
        rows.middle[p] = last
        rows.diagonal[p] = rows.screen[p] - total


@kernel
def _invert(start, stop, stencil, screen, kinds, inverse):
    for y in range(start, stop):
        for x in range(kinds.shape[1]):
            if kinds[y, x] == REGULAR:
                inverse[y * kinds.shape[1] + x] = 1.0 / diagonal_of(stencil, screen, y, x)


@kernel
def _count_runs(start, stop, kinds, counts):
    for y in range(start, stop):
        count = np.int32(0)
        for x in range(1, kinds.shape[1]):  # without a branch: vector instructions
            count += np.int32((kinds[y, x] == REGULAR) & (kinds[y, x - 1] != REGULAR))
        counts[y] = count


@kernel
def _find_runs(start, stop, kinds, runs):
    for y in range(start, stop):
        k = runs.start[y]
        for x in range(1, kinds.shape[1]):
            if kinds[y, x] == REGULAR and kinds[y, x - 1] != REGULAR:
                runs.columns[k, 0] = x
            elif kinds[y, x] != REGULAR and kinds[y, x - 1] == REGULAR:
                runs.columns[k, 1] = x
                k += 1


@kernel
def multiply_row(y, stencil, screen, runs, x, out):
    """Write ``A x`` of the regular nodes of row `y` to a row, one channel."""
    columns = stencil.shape[2]
    for k in range(runs.start[y], runs.start[y + 1]):
        # Where neighbors are read, slices start one node before the run, so that all loops start
        # at 0 and become vector instructions.
        first, last = runs.columns[k]
        i = y * columns + first
        n = last - first
        here = x[i - 1 : i + n + 1]
        upper = x[i - columns - 1 : i - columns + n + 1]
        lower = x[i + columns - 1 : i + columns + n + 1]
        level = stencil[0, y, first - 1 : last]
        a = stencil[3, y - 1, first - 1 : last - 1]
        b = stencil[2, y - 1, first:last]
        c = stencil[1, y - 1, first + 1 : last + 1]
        d = stencil[1, y, first:last]
        e = stencil[2, y, first:last]
        f = stencil[3, y, first:last]
        rest = screen[i : i + n]
        row = out[first:last]
        for u in range(n):
            value = here[u + 1]
            total = level[u] * (here[u] - value) + level[u + 1] * (here[u + 2] - value)
            total += a[u] * (upper[u] - value) + b[u] * (upper[u + 1] - value)
            total += c[u] * (upper[u + 2] - value) + d[u] * (lower[u] - value)
            total += e[u] * (lower[u + 1] - value) + f[u] * (lower[u + 2] - value)
            row[u] = np.float32(rest[u]) * value + total


@kernel
def multiply_rows(start, stop, stencil, screen, runs, x, out):
    """Write ``A x`` to `out` at the regular nodes of some rows: (c, n)."""
    columns = stencil.shape[2]
    for y in range(start, stop):
        for j in range(x.shape[0]):
            row = out[j, y * columns : (y + 1) * columns]
            multiply_row(y, stencil, screen, runs, x[j], row)


@kernel
def multiply_block(start, stop, rows, x, out):
    """Write ``A x`` to `out` at some unknowns of the block, in double precision: (c, n)."""
    for p in range(start, stop):
        i = rows.unknowns[p]
        for j in range(x.shape[0]):
            here = np.float64(x[j, i])
            total = rows.screen[p] * here
            for e in range(rows.start[p], rows.start[p + 1]):
                total += rows.values[e] * (x[j, rows.columns[e]] - here)
            out[j, i] = total
