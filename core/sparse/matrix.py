# SPDX-License-Identifier: GPL-3.0-or-later
"""Sparse matrices by rows: sums, products and transposes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run, run_in_order
from ..base.progress import ask

Ints = npt.NDArray[np.int32]
Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

_MOST = np.iinfo(np.int32).max


class Sparse(NamedTuple):
    """A matrix by rows; entries that are not stored are 0.

    Attributes
    ----------
    start : (rows + 1,) int32
        Row i has the entries from ``start[i]`` to ``start[i + 1]``.
    columns : (k,) int32
        In no particular order within a row, unless said otherwise.
    values : (k,) array of float
    shape : (int, int)
        Rows and columns.
    """

    start: Ints
    columns: Ints
    values: npt.NDArray[np.floating]
    shape: tuple[int, int]


def from_triples(
    rows: npt.NDArray[np.integer],
    columns: npt.NDArray[np.integer],
    values: npt.NDArray[np.floating],
    shape: tuple[int, int],
) -> Sparse:
    """Make a matrix of entries in any order; those at the same place add up, in that order.

    Columns ascend within the rows.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter.core.sparse.matrix import from_triples
    >>> places = np.array([1, 0, 1]), np.array([2, 1, 2])
    >>> matrix = from_triples(*places, np.array([1.0, 2.0, 3.0]), (2, 3))
    >>> matrix.start.tolist(), matrix.columns.tolist(), matrix.values.tolist()
    ([0, 1, 2], [1, 2], [2.0, 4.0])
    """
    rows, columns = (np.ascontiguousarray(each, dtype=np.int32) for each in (rows, columns))
    start = _begins(columns, shape[1])
    by_column = start, np.empty_like(rows), np.empty_like(values)
    run_in_order(_place, len(rows), rows, columns, values, start[:-1].copy(), *by_column[1:])
    begin, columns, values, _ = transposed(Sparse(*by_column, (shape[1], shape[0])))
    counts = np.zeros(shape[0] + 1, dtype=np.int64)
    run(_add_repeated, shape[0], begin, columns, values, counts[1:])
    start = running_totals(counts)
    if start[-1] == len(columns):
        return Sparse(start, columns, values, shape)
    kept = np.empty(start[-1], dtype=np.int32), np.empty(start[-1], dtype=values.dtype)
    run(_close_up, shape[0], begin, start, columns, values, *kept)
    return Sparse(start, *kept, shape)


def diagonal_matrix(values: Floats) -> Sparse:
    """Make a diagonal matrix."""
    places = np.arange(len(values) + 1, dtype=np.int32)
    return Sparse(places, places[:-1], values, (len(values), len(values)))


def rows_of(matrix: Sparse) -> Ints:
    """The row of each entry."""
    return np.repeat(np.arange(matrix.shape[0], dtype=np.int32), np.diff(matrix.start))


def diagonal_of(matrix: Sparse) -> npt.NDArray[np.floating]:
    """The diagonal entries of a square matrix."""
    places = np.flatnonzero(rows_of(matrix) == matrix.columns)
    found = np.zeros(matrix.shape[0], dtype=matrix.values.dtype)
    np.add.at(found, matrix.columns[places], matrix.values[places])
    return found


def row_sums(matrix: Sparse) -> npt.NDArray[np.floating]:
    """Add up the entries of each row."""
    sums = np.zeros(matrix.shape[0], dtype=matrix.values.dtype)
    held = np.flatnonzero(np.diff(matrix.start))
    if len(held):
        sums[held] = np.add.reduceat(matrix.values, matrix.start[held])
    return sums


def absolute(matrix: Sparse) -> Sparse:
    """The matrix of the sizes of all entries."""
    return matrix._replace(values=np.abs(matrix.values))


def with_entries(matrix: Sparse, kept: Bools) -> Sparse:
    """Drop all entries but those that are `kept`: (k,) bool."""
    before = np.concatenate([[0], np.cumsum(kept)])
    start = before[matrix.start].astype(np.int32)
    return matrix._replace(start=start, columns=matrix.columns[kept], values=matrix.values[kept])


def couplings_of(matrix: Sparse) -> Sparse:
    """A square matrix without its diagonal and without zeros; columns ascend within the rows."""
    off = (rows_of(matrix) != matrix.columns) & (matrix.values != 0)
    return in_order(with_entries(matrix, off))


def with_rows(matrix: Sparse, rows: npt.NDArray[np.integer]) -> Sparse:
    """Gather rows of a matrix, in the order given."""
    counts = np.diff(matrix.start)[rows]
    start = running_totals(np.concatenate([[0], counts]))
    entries = np.arange(start[-1]) + np.repeat(matrix.start[rows] - start[:-1], counts)
    shape = len(rows), matrix.shape[1]
    return Sparse(start, matrix.columns[entries], matrix.values[entries], shape)


def transposed(matrix: Sparse) -> Sparse:
    """Transpose a matrix; columns of the result ascend within its rows."""
    start = _begins(matrix.columns, matrix.shape[1])
    columns, values = np.empty_like(matrix.columns), np.empty_like(matrix.values)
    run_in_order(_transpose, matrix.shape[0], *matrix[:3], start[:-1].copy(), columns, values)
    return Sparse(start, columns, values, (matrix.shape[1], matrix.shape[0]))


def in_order(matrix: Sparse) -> Sparse:
    """Sort the entries of each row by their columns."""
    return transposed(transposed(matrix))


def added(a: Sparse, b: Sparse, factor: float = 1.0) -> Sparse:
    """Compute ``a + factor b``, without zeros. Columns ascend within the rows if those of both do.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter.core.sparse.matrix import added, diagonal_matrix
    >>> one, other = diagonal_matrix(np.array([3.0, 4.0])), diagonal_matrix(np.array([1.0, 2.0]))
    >>> added(one, other, -2.0).values.tolist()
    [1.0]
    """
    ascend = _ascend(a) and _ascend(b)

    def most(start: int, stop: int) -> int:
        return int(a.start[stop] - a.start[start] + b.start[stop] - b.start[start])

    return _by_rows(a.shape, most, _add_rows, *a[:3], *b[:3], factor, ascend)


def product(a: Sparse, b: Sparse) -> Sparse:
    """Multiply two matrices; the result has no zeros.

    Notes
    -----
    Row by row (Gustavson 1978): the entries of a row are a linked list while they are summed up,
    and stay in its order, the newest first.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter.core.sparse.matrix import from_triples, product
    >>> step = from_triples(np.array([0, 1]), np.array([1, 0]), np.array([2.0, 3.0]), (2, 2))
    >>> product(step, step).values.tolist()
    [6.0, 6.0]
    """
    lengths = np.diff(b.start).astype(np.int64)

    def most(start: int, stop: int) -> int:
        return int(lengths[a.columns[a.start[start] : a.start[stop]]].sum())

    columns = b.columns.view(np.uint32)
    given = *a[:3], b.start, columns, b.values
    return _by_rows((a.shape[0], b.shape[1]), most, _multiply_rows, *given)


def in_double(matrix: Sparse) -> Sparse:
    """The same matrix in double precision."""
    return matrix._replace(values=matrix.values.astype(np.float64))


def applied(matrix: Sparse, x: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
    """Multiply a matrix by vectors: (columns,) or (columns, c), converted to the matrix' type."""
    if x.ndim == 1:
        return applied(matrix, x[:, None])[:, 0]
    given = np.ascontiguousarray(x, dtype=matrix.values.dtype)
    out = np.empty((matrix.shape[0], x.shape[1]), dtype=matrix.values.dtype)
    columns = matrix.columns.view(np.uint32)  # indices without a sign are quicker
    run(_multiply_vectors, len(out), matrix.start, columns, matrix.values, given, out)
    return out


def running_totals(counts: npt.NDArray[np.integer]) -> Ints:
    """Add up counts, the first of which is 0, to where each row begins."""
    start = np.cumsum(counts, dtype=np.int64)
    if start[-1] > _MOST:
        raise MemoryError(f"A sparse matrix has {start[-1]} entries; at most {_MOST} are possible.")
    return start.astype(np.int32)


def _begins(keys: Ints, count: int) -> Ints:
    # Where each key below `count` begins once they are sorted, and their number.
    start = np.zeros(count + 1, dtype=np.int32)
    run_in_order(_count, len(keys), keys, start)
    return np.cumsum(start, out=start)


def _ascend(matrix: Sparse) -> bool:
    # Whether columns ascend within all rows.
    descents = np.zeros(1, dtype=np.int64)
    run(_find_descents, matrix.shape[0], matrix.start, matrix.columns, descents)
    return not descents[0]


def _by_rows(
    shape: tuple[int, int], most: Callable[[int, int], int], fill: Any, *given: Any
) -> Sparse:
    # A matrix that `fill` makes by blocks of rows, with a limited number of entries in each.
    counts = np.zeros(shape[0] + 1, dtype=np.int64)
    found: dict[int, tuple[Ints, npt.NDArray[np.floating]]] = {}
    precision = given[2].dtype

    def work(start: int, stop: int) -> None:
        size = most(start, stop)
        columns, values = np.empty(size, dtype=np.int32), np.empty(size, dtype=precision)
        # Only the pages of these that are used take memory and time.
        links, sums = np.zeros(shape[1], dtype=np.int32), np.zeros(shape[1], dtype=precision)
        total = fill(start, stop, *given, links, sums, columns, values, counts)
        found[start] = columns[:total].copy(), values[:total].copy()

    run(work, shape[0])
    start = running_totals(counts)
    ask()
    nothing = np.empty(0, dtype=np.int32), np.empty(0, dtype=precision)
    parts = [nothing, *(found[begin] for begin in sorted(found))]
    columns, values = (np.concatenate(each) for each in zip(*parts, strict=True))
    return Sparse(start, columns, values, shape)


@kernel
def _count(start, stop, keys, counts):
    for i in range(start, stop):
        counts[keys[i] + 1] += 1


@kernel
def _place(start, stop, rows, columns, values, cursors, by_column, taken):
    for i in range(start, stop):
        place = cursors[columns[i]]
        cursors[columns[i]] += 1
        by_column[place] = rows[i]
        taken[place] = values[i]


@kernel
def _add_repeated(start, stop, begin, columns, values, counts):
    # In place, to the front of each row.
    for row in range(start, stop):
        last = begin[row] - 1
        for e in range(begin[row], begin[row + 1]):
            if last >= begin[row] and columns[last] == columns[e]:
                values[last] += values[e]
            else:
                last += 1
                columns[last] = columns[e]
                values[last] = values[e]
        counts[row] = last + 1 - begin[row]


@kernel
def _close_up(start, stop, begin, row_start, columns, values, kept, taken):
    for row in range(start, stop):
        for e in range(row_start[row + 1] - row_start[row]):
            kept[row_start[row] + e] = columns[begin[row] + e]
            taken[row_start[row] + e] = values[begin[row] + e]


@kernel
def _transpose(start, stop, row_start, columns, values, cursors, rows, taken):
    for row in range(start, stop):
        for e in range(row_start[row], row_start[row + 1]):
            place = cursors[columns[e]]
            cursors[columns[e]] += 1
            rows[place] = row
            taken[place] = values[e]


@kernel
def _find_descents(start, stop, row_start, columns, descents):
    for row in range(start, stop):
        for e in range(row_start[row] + 1, row_start[row + 1]):
            if columns[e] <= columns[e - 1]:
                descents[0] = 1
                return


@kernel
def _list(column, value, head, links, sums):
    # Adds to an entry of the row; returns the head of the list, which ends with -1. Links are
    # raised by 2, so that 0 is what no list holds.
    sums[column] += value
    if links[column] == 0:
        links[column] = head + 2
        return column
    return head


@kernel
def _unlist(head, links, sums, columns, values, count):
    # Writes the entries of the row that are not 0, and leaves nothing behind.
    while head >= 0:
        if sums[head] != 0:
            columns[count] = head
            values[count] = sums[head]
            count += 1
        column = head
        head = links[column] - 2
        links[column] = 0
        sums[column] = 0
    return count


@kernel
def _multiply_rows(
    start, stop, a_start, a_columns, a_values, b_start, b_columns, b_values,
    links, sums, columns, values, counts,
):  # fmt: skip
    total = 0
    for row in range(start, stop):
        before = total
        head = -1
        for e in range(a_start[row], a_start[row + 1]):
            between, value = a_columns[e], a_values[e]
            for f in range(b_start[between], b_start[between + 1]):
                head = _list(b_columns[f], value * b_values[f], head, links, sums)
        total = _unlist(head, links, sums, columns, values, total)
        counts[row + 1] = total - before
    return total


@kernel
def _add_rows(
    start, stop, a_start, a_columns, a_values, b_start, b_columns, b_values, factor, ascend,
    links, sums, columns, values, counts,
):  # fmt: skip
    total = 0
    for row in range(start, stop):
        before = total
        e, f = a_start[row], b_start[row]
        if ascend:
            while e < a_start[row + 1] or f < b_start[row + 1]:
                a = a_columns[e] if e < a_start[row + 1] else len(links)
                b = b_columns[f] if f < b_start[row + 1] else len(links)
                value = 0.0
                if a <= b:
                    value += a_values[e]
                    e += 1
                if b <= a:
                    value += factor * b_values[f]
                    f += 1
                if value != 0:
                    columns[total] = min(a, b)
                    values[total] = value
                    total += 1
        else:
            head = -1
            for e in range(a_start[row], a_start[row + 1]):
                head = _list(a_columns[e], a_values[e], head, links, sums)
            for f in range(b_start[row], b_start[row + 1]):
                head = _list(b_columns[f], factor * b_values[f], head, links, sums)
            total = _unlist(head, links, sums, columns, values, total)
        counts[row + 1] = total - before
    return total


@kernel
def _multiply_vectors(start, stop, row_start, columns, values, x, out):
    for row in range(start, stop):
        for j in range(x.shape[1]):
            total = values.dtype.type(0)
            for e in range(row_start[row], row_start[row + 1]):
                total += values[e] * x[columns[e], j]
            out[row, j] = total
