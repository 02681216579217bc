# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of sums in a fixed order."""

import math

import numpy as np
import pytest
from shock_filter.core.linear.sums import sum_by_halves


@pytest.mark.parametrize("count", [0, 1, 2, 3, 7, 64, 1000, 4096, 5001])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_it_is_the_sum(count, dtype):
    values = np.random.default_rng(count).normal(size=count).astype(dtype)
    wanted = math.fsum(values)
    found = sum_by_halves(values.copy())
    size = math.fsum(np.abs(values))
    assert abs(found - wanted) <= 13 * np.finfo(dtype).eps * size  # a rounding for each halving
    assert sum_by_halves(values.copy()) == found


def test_it_loses_little_where_adding_one_by_one_loses_much():
    values = np.full(1 << 20, 0.1, dtype=np.float32)
    assert float(sum_by_halves(values.copy())) == float(np.float32(0.1)) * (1 << 20)
