# SPDX-License-Identifier: GPL-3.0-or-later
"""Sums in an order that no compiler chooses: the same bits on every processor."""

from __future__ import annotations

from ..base.parallel import kernel


@kernel
def sum_by_halves(values):
    """Sum an array by adding its second half to its first until one value is left.

    Overwrites the array; 0 if it is empty.
    """
    n = len(values)
    if n == 0:
        return values.dtype.type(0)
    while n > 1:
        half = (n + 1) // 2
        low, high = values[: n - half], values[half:n]
        for i in range(len(low)):
            low[i] += high[i]
        n = half
    return values[0]
