# SPDX-License-Identifier: GPL-3.0-or-later
"""Walks along given vectors on a grid, for the tests."""

import numpy as np
from shock_filter.core.base.parallel import kernel, run
from shock_filter.core.base.unfinished import MOST_STEPS
from shock_filter.core.grid.walk import UNFINISHED, walk_cells


def follow(vectors, time, points, most_steps=MOST_STEPS):
    """Follow the vectors in the cells of a grid from points (k, 2); return ends and whether cut."""
    ends = np.empty_like(points)
    unfinished = np.zeros(len(points), dtype=np.bool_)
    run(_follow, len(points), vectors, float(time), most_steps, points, ends, unfinished)
    return ends, unfinished


@kernel
def _follow(start, stop, vectors, time, most_steps, points, ends, unfinished):
    for i in range(start, stop):
        row = min(int(points[i, 0]), vectors.shape[0] - 1)
        column = min(int(points[i, 1]), vectors.shape[1] - 1)
        place = row, column, points[i, 0] - row, points[i, 1] - column
        place, _, _, _, ending = walk_cells(None, vectors, None, None, time, most_steps, place)
        ends[i, 0] = place[0] + place[2]
        ends[i, 1] = place[1] + place[3]
        unfinished[i] = ending == UNFINISHED
