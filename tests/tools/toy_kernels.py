# SPDX-License-Identifier: GPL-3.0-or-later
"""Kernels of all kinds that the core has."""

from typing import NamedTuple

import numpy as np
from shock_filter.core.base.parallel import kernel


class Rows(NamedTuple):
    """Arrays in a tuple."""

    start: np.ndarray
    values: np.ndarray


@kernel
def doubled(start, stop, values, out):
    for i in range(start, stop):
        out[i] = 2.0 * values[i]


@kernel
def row_sums(start, stop, rows, scale, out):
    for i in range(start, stop):
        out[i] = 0.0
        for e in range(rows.start[i], rows.start[i + 1]):
            out[i] += rows.values[e] * scale[0]


@kernel
def total(values):
    found = 0.0
    for value in values:
        found += value
    return found


@kernel
def extremes(values):
    return values.min(), values.max(), len(values)


@kernel
def sorted_copy(values):
    return np.sort(values)


@kernel
def found_and_count(values, limit):
    found = np.empty(len(values), np.int32)
    count = 0
    for i in range(len(values)):
        if values[i] > limit:
            found[count] = i
            count += 1
    return found[:count], count


@kernel
def listed(values, out):
    stack = [0]
    while stack:
        i = stack.pop()
        out[i] = values[i]
        if i + 1 < len(values):
            stack.append(i + 1)


@kernel
def combined(values, more, out):
    out[:] = 2.0 * values + more


@kernel
def refuses(values):
    if values[0] < 0:
        raise ValueError("negative")
    return values[0]


def calls():
    """Return kernels with arguments, new ones each time."""
    values = np.linspace(-1.0, 1.0, 50) ** 3
    rows = Rows(np.arange(0, 51, 10), values)
    return [
        (doubled, (0, 50, values, np.zeros(50))),
        (doubled, (0, 25, values[::2], np.zeros(25))),
        (doubled, (3, 50, values.astype(np.float32), np.zeros(50, np.float32))),
        (row_sums, (0, 5, rows, (2.0, 1), np.zeros(5))),
        (total, (abs(values),)),
        (extremes, (values,)),
        (sorted_copy, (values[::-1],)),
        (found_and_count, (values, 0.25)),
        (listed, (values, np.zeros(50))),
        (combined, (values, values[::-1].copy(), np.zeros(50))),
        (refuses, (np.ones(1),)),
    ]
