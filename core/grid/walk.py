# SPDX-License-Identifier: GPL-3.0-or-later
"""Walks along the flow-lines of a grid of square cells (paper A, Appendix A).

Nodes, such as pixels, are the corners of the cells, and the flow is constant in each cell. A walk
has three parts: `cell_velocity` is the field, the shock flow or a given one; `ends_at_turn` is the
rule by which a walk ends early; `walk_cells` goes from cell to cell. Lengths are in distances of
neighbouring nodes.

Kernels take the parts of a flow one by one, and None for those that it lacks: numba compiles
them for the others, and counts references each time that an array is taken from a tuple, which
would slow short walks by a third. The parts are

potential : (h, w) float32
    P at the nodes; v = -grad(P) / 2 is followed until it turns by a right angle or more.
vectors : (h - 1, w - 1, 2) array of float
    Velocity (down, across) in each cell, followed for the whole time; excludes `potential`.
faces : (h - 1, w - 1) or larger array of int
    The face of a surface under each cell; negative if the cell is closed. None: all are open.
metrics : (m, 3) or wider array of float
    The inverse metric of each face: entries 11, 12 and 22, axis 1 the rows. None: the plane.

A place is (row, column, down, across): a cell's first node, and offsets in it from 0 to 1.
"""

from __future__ import annotations

import numpy as np

from ..base.parallel import kernel

ENDED, LEFT_DOWN, LEFT_ACROSS, UNFINISHED = range(4)
"""How a walk ends: by itself; at a closed cell along the first axis or the second; cut off."""

OFFSET = 0.001
"""How far into each adjacent cell the trace of a node begins: the paper's epsilon."""

_MOST_RESTS = 8


@kernel
def cell_velocity(potential, vectors, faces, metrics, i, j, transposed):
    """Compute the flow in a cell, (down, across), and its product with the metric likewise.

    If `transposed`, the axes are exchanged, those of (i, j) too.
    """
    row, column = (j, i) if transposed else (i, j)
    v = w = p = q = 0.0
    # numba drops branches for arguments that are None, and only those.
    if potential is not None:
        a = potential[row, column]
        b = potential[row, column + 1]
        c = potential[row + 1, column]
        d = potential[row + 1, column + 1]
        v = p = -0.25 * (float(c - a) + float(d - b))
        w = q = -0.25 * (float(b - a) + float(d - c))
    if metrics is not None:
        face = faces[row, column]
        mixed = float(metrics[face, 1])
        v = metrics[face, 0] * p + mixed * q
        w = mixed * p + metrics[face, 2] * q
    if vectors is not None:
        v = p = float(vectors[row, column, 0])
        w = q = float(vectors[row, column, 1])
    return (w, v, q, p) if transposed else (v, w, p, q)


@kernel
def ends_at_turn(vectors, v, w, p, q):
    """The shock filter's rule: a walk along (v, w) ends where the flow turns by a right angle.

    (p, q) is the product of the metric and the flow ahead. Given fields may turn by any angle.
    """
    return vectors is None and v * p + w * q <= 0


@kernel
def _is_open(potential, vectors, faces, i, j, transposed):
    """Tell whether a walk may enter a cell; the axes are exchanged if `transposed`."""
    row, column = (j, i) if transposed else (i, j)
    if faces is not None:
        return faces[row, column] >= 0
    rows = columns = 0
    if vectors is not None:
        rows, columns = vectors.shape[:2]
    if potential is not None:
        rows, columns = potential.shape[0] - 1, potential.shape[1] - 1
    return row >= 0 and column >= 0 and row < rows and column < columns


@kernel
def begin(y, x, corner):
    """The start of the trace of node (y, x) in one of the four cells around it."""
    up = corner >> 1
    left = corner & 1
    down = 1.0 - 0.5 * OFFSET if up else 0.5 * OFFSET
    across = 1.0 - 0.5 * OFFSET if left else 0.5 * OFFSET
    return y - up, x - left, down, across


@kernel
def reach(place, speed):
    """Time until the end of the cell, along one axis."""
    if speed > 1e-30:
        return (1.0 - place) / speed
    if speed < -1e-30:
        return place / -speed
    return np.inf


@kernel
def walk_cells(potential, vectors, faces, metrics, time, most_steps, place):
    """Walk from cell to cell.

    Parameters
    ----------
    potential, vectors, faces, metrics
        The parts of a flow; see this module's beginning.
    time : float
    most_steps : int
        Most cells to cross.
    place
        The start of the walk.

    Returns
    -------
    place
        The end of the walk.
    left : float
        The remaining time.
    v, w : float
        The velocity (down, across) at the end.
    ending : int
        `ENDED`, `LEFT_DOWN`, `LEFT_ACROSS` or `UNFINISHED`.
    """
    row, column, down, across = place
    left = time
    v, w, _, _ = cell_velocity(potential, vectors, faces, metrics, row, column, False)
    y = down + v * left
    x = across + w * left
    if 0.0 < y < 1.0 and 0.0 < x < 1.0:
        return (row, column, y, x), 0.0, v, w, ENDED
    # The walk crosses the lines between cells along the first axis; i, a and v belong to it.
    # To cross along the other one, the axes are exchanged.
    i, j, a, b = row, column, down, across
    transposed = False
    sliding = False  # along a line between cells, that is, along the second axis
    last = left
    rests = 0  # consecutive steps that took no time
    ending = ENDED
    for _ in range(most_steps):
        if vectors is not None:
            rests = rests + 1 if left == last else 0
            last = left
            if rests > _MOST_RESTS:
                break  # circles around a node to which all cells flow
        if not sliding:
            reach_a = reach(a, v)
            reach_b = reach(b, w)
            if left <= min(reach_a, reach_b):
                if left < np.inf:
                    a += v * left
                    b += w * left
                break
            if reach_b < reach_a:
                transposed = not transposed
                i, j, a, b, v, w = j, i, b, a, w, v
                reach_a = reach_b
            left -= reach_a
            ahead = 1 if v > 0 else -1
            a = 1.0 if v > 0 else 0.0
            b = min(max(b + w * reach_a, 0.0), 1.0)
            beyond = i + ahead
            if not _is_open(potential, vectors, faces, beyond, j, transposed):
                ending = LEFT_DOWN
                break
            next_v, next_w, p, q = cell_velocity(
                potential, vectors, faces, metrics, beyond, j, transposed
            )
            if ends_at_turn(vectors, v, w, p, q):
                break
            if v * next_v > 0:
                i = beyond
                a = 1.0 - a
                v, w = next_v, next_w
                continue
            # Both cells flow into the line between them: slide on it with the convex combination
            # of both flows that stays on the line (Filippov). The line belongs to the lower cell.
            share = -next_v / (v - next_v)
            w = share * w + (1.0 - share) * next_w
            v = 0.0
            i = min(i, beyond)
            a = 1.0
            sliding = True
        reached = (1.0 - b) / w if w > 0 else (b / -w if w < 0 else np.inf)
        if reached >= left:
            if left < np.inf:
                b += w * left
            break
        left -= reached
        ahead = 1 if w > 0 else -1
        b = 1.0 if w > 0 else 0.0
        beyond = j + ahead
        if not _is_open(potential, vectors, faces, i, beyond, transposed) or not _is_open(
            potential, vectors, faces, i + 1, beyond, transposed
        ):
            ending = LEFT_ACROSS
            break
        j = beyond
        b = 1.0 - b
        # Beyond the node, the cells on both sides of the line decide.
        came = w
        v, w, _, q = cell_velocity(potential, vectors, faces, metrics, i, j, transposed)
        next_v, next_w, _, next_q = cell_velocity(
            potential, vectors, faces, metrics, i + 1, j, transposed
        )
        if v >= 0 and next_v <= 0:
            total = v - next_v
            share = -next_v / total if total > 0 else 0.5
            w = share * w + (1.0 - share) * next_w
            q = share * q + (1.0 - share) * next_q
            v = 0.0
        else:
            if next_v > 0 and next_v > -v:
                i += 1
                a = 0.0
                v, w, q = next_v, next_w, next_q
            sliding = False
        if ends_at_turn(vectors, 0.0, came, 0.0, q):
            break
    else:
        ending = UNFINISHED
    if transposed:
        if ending == LEFT_DOWN or ending == LEFT_ACROSS:
            ending = LEFT_DOWN + LEFT_ACROSS - ending
        return (j, i, b, a), left, w, v, ending
    return (i, j, a, b), left, v, w, ending
