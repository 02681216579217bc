# SPDX-License-Identifier: GPL-3.0-or-later
"""The nearest marked pixel of each pixel."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run

_CHUNK = 64
"""Rows or columns at once."""


def nearest_marked(marked: npt.NDArray[np.bool_]) -> npt.NDArray[np.int64]:
    """Find the nearest marked pixel of each pixel, by Euclidean distance between centres.

    Of several at the same distance, the leftmost is taken, and of two in one column the upper one.

    Parameters
    ----------
    marked : (h, w) bool

    Returns
    -------
    (h, w) int64
        Row times w plus column of the nearest pixel; -1 everywhere if none is marked.

    Notes
    -----
    In linear time (Meijster, Roerdink and Hesselink 2000): first within columns, then along each
    row, where the squared distances from the columns are parabolas and the lowest one counts.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter.core.grid.nearest import nearest_marked
    >>> nearest_marked(np.array([[False, True, False], [False, False, True]])).tolist()
    [[1, 1, 1], [1, 1, 5]]
    """
    height, width = marked.shape
    rows = np.empty(marked.shape, dtype=np.int32)
    nearest = np.empty(marked.shape, dtype=np.int64)
    run(_within_columns, width, np.ascontiguousarray(marked), rows, chunk=_CHUNK)
    run(_along_rows, height, rows, nearest, chunk=_CHUNK)
    return nearest


@kernel
def _within_columns(start, stop, marked, rows):
    # The row of the nearest marked pixel of the same column; -1 if there is none.
    height = len(marked)
    for y in range(height):
        for x in range(start, stop):
            if marked[y, x]:
                rows[y, x] = y
            else:
                rows[y, x] = rows[y - 1, x] if y > 0 else -1
    for y in range(height - 2, -1, -1):
        for x in range(start, stop):
            above, below = rows[y, x], rows[y + 1, x]
            if below > y and (above < 0 or below - y < y - above):
                rows[y, x] = below


@kernel
def _along_rows(start, stop, rows, nearest):
    width = rows.shape[1]
    parabolas = np.empty(width, np.int64)  # columns whose parabolas are the lowest, in order
    begins = np.empty(width, np.int64)  # and where each of them is the lowest one
    for y in range(start, stop):
        count = 0
        for x in range(width):
            if rows[y, x] < 0:
                continue
            square = (rows[y, x] - y) ** 2
            begin = 0
            while count > 0:
                last = parabolas[count - 1]
                its = (rows[y, last] - y) ** 2
                # The first column where this one is lower than the last one.
                begin = (x * x - last * last + square - its) // (2 * (x - last)) + 1
                if begin > begins[count - 1]:
                    break
                count -= 1
                begin = 0
            if begin < width:
                parabolas[count] = x
                begins[count] = max(begin, 0)
                count += 1
        for x in range(width - 1, -1, -1):
            while count > 1 and begins[count - 1] > x:
                count -= 1
            at = parabolas[count - 1] if count > 0 else -1
            nearest[y, x] = rows[y, at] * width + at if count > 0 else -1
