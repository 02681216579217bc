# SPDX-License-Identifier: GPL-3.0-or-later
"""Factors of a symmetric positive definite matrix: ``P A P^T = L D L^T``."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run_in_order
from .matrix import Floats, Ints, Sparse, running_totals
from .ordering import minimum_degree

_CHUNK = 1 << 10


class Factors(NamedTuple):
    """L by columns without its diagonal of ones, and D.

    Attributes
    ----------
    start : (n + 1,) int32
    below : (k,) uint32
        Rows of the entries of L, ascending within the columns; unsigned, which is faster.
    values : (k,) float64
    diagonal : (n,) float64
        D: all above 0 if and only if the matrix is positive definite, up to rounding.
    """

    start: Ints
    below: npt.NDArray[np.uint32]
    values: Floats
    diagonal: Floats


def factored(matrix: Sparse, most: float = np.inf) -> tuple[Factors, Ints]:
    """Factor a symmetric matrix; returns also the place of each unknown in the factors.

    Raises
    ------
    TooDense
        If L would hold more than `most` entries, which is known before it is computed.

    Notes
    -----
    Row by row (Davis 2005): row k of L solves a triangular system with the rows above, whose
    pattern is found along the elimination tree.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter.core.sparse.factors import factored
    >>> from shock_filter.core.sparse.matrix import from_triples
    >>> places = np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1])
    >>> factors, _ = factored(from_triples(*places, np.array([2.0, 1.0, 1.0, 2.0]), (2, 2)))
    >>> factors.values.tolist(), factors.diagonal.tolist()
    ([0.5], [2.0, 1.5])
    """
    count = matrix.shape[0]
    order, parents, counts = minimum_degree(matrix, most)
    place = np.empty(count, dtype=np.int32)
    place[order] = np.arange(count, dtype=np.int32)
    start = running_totals(np.concatenate([[0], counts]))
    # Zeros, because an entry of the upper half whose mirror image is rounded to 0 leaves a gap.
    factors = Factors(
        start, np.zeros(start[-1], dtype=np.uint32), np.zeros(start[-1]), np.empty(count)
    )
    path, marks = np.empty(count, dtype=np.int32), np.full(count, -1, dtype=np.int32)
    run_in_order(_factor, count, *matrix[:3], order, place, parents, start[:-1].copy(), factors,
                 np.zeros(count), path, marks, chunk=_CHUNK)  # fmt: skip
    return factors, place


@kernel
def _factor(
    start, stop, row_start, columns, values, order, place, parents, ends, factors, row, path, marks
):
    # `row` holds zeros before and after; the columns are filled up to `ends`.
    below, lower = factors.below, factors.values
    for k in range(start, stop):
        first = len(path)
        marks[k] = k
        for e in range(row_start[order[k]], row_start[order[k] + 1]):
            i = place[columns[e]]
            if i > k or values[e] == 0:
                continue
            row[i] += values[e]
            length = 0
            while marks[i] != k:
                path[length] = i
                length += 1
                marks[i] = k
                i = parents[i]
            while length > 0:
                length -= 1
                first -= 1
                path[first] = path[length]
        pivot = row[k]
        row[k] = 0
        for step in range(first, len(path)):
            i = path[step]
            value = row[i]
            row[i] = 0
            for e in range(factors.start[i], ends[i]):
                row[below[e]] -= lower[e] * value
            entry = value / factors.diagonal[i]
            pivot -= entry * value
            below[ends[i]] = k
            lower[ends[i]] = entry
            ends[i] += 1
        factors.diagonal[k] = pivot
