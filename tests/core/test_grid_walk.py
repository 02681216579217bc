# SPDX-License-Identifier: GPL-3.0-or-later
"""Walks along given flows from cell to cell of a grid, and what they do at lines and nodes."""

import numpy as np
import pytest
from grid_walks import follow

WAYS = pytest.mark.parametrize("exchanged", [False, True], ids=["across", "down"])


def end(velocities, start, time, exchanged=False):
    """Where a walk ends; with the axes exchanged and back."""
    turn = slice(None, None, -1 if exchanged else 1)
    vectors = np.asarray(velocities, dtype=float)
    if exchanged:
        vectors = vectors.transpose(1, 0, 2)[..., ::-1]
    return follow(np.ascontiguousarray(vectors), time, np.array([start[turn]], float))[0][0][turn]


@WAYS
@pytest.mark.parametrize(("up", "down"), [(2.0, 1.0), (1.0, 2.0), (3.0, 0.5)])
def test_past_a_node_a_walk_takes_the_faster_of_two_flows_that_part(up, down, exchanged):
    # Both cells of the first column flow onto the line between them, those of the next one off it.
    velocities = [[(1, 1), (-up, 1)], [(-1, 1), (down, 1)]]
    row = 1 - 0.2 * up if up > down else 1 + 0.2 * down
    found = end(velocities, (0.5, 0.2), 1.0, exchanged)
    assert found == pytest.approx((row, 1.2))


@WAYS
def test_past_a_node_a_walk_stays_on_a_line_onto_which_both_cells_flow(exchanged):
    # What keeps it there is 3/4 of the first flow and 1/4 of the second (Filippov).
    velocities = [[(1, 1), (1, 2)], [(-1, 1), (-3, 6)]]
    found = end(velocities, (0.5, 0.2), 1.0, exchanged)
    assert found == pytest.approx((1.0, 1.0 + 0.2 * (0.75 * 2 + 0.25 * 6)))


@WAYS
def test_a_walk_that_one_cell_leads_off_a_line_leaves_it(exchanged):
    velocities = [[(1, 1), (1, 1)], [(-1, 1), (2, 1)]]
    assert end(velocities, (0.5, 0.2), 1.0, exchanged) == pytest.approx((1.4, 1.2))
    velocities = [[(1, 1), (-2, 1)], [(-1, 1), (-1, 1)]]
    assert end(velocities, (0.5, 0.2), 1.0, exchanged) == pytest.approx((0.6, 1.2))
