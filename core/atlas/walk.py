# SPDX-License-Identifier: GPL-3.0-or-later
"""Flow-lines and advection in a sheet of texels, on the surface's metric and across seams.

The scheme is that for images (`core.grid.walk`): texels are vertices of a mesh of squares, the flow
is constant in a cell. Here it is u = h^-1 dP / 2 with the metric h of a face in the cell, and
a flow-line that leaves its chart goes on where the surface does.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..grid.walk import OFFSET, Channels, add_sample, reach
from .atlas import TextureAtlas
from .ghosts import place_beyond
from .metric import apply
from .sheet import NOTHING

_MOST_HOPS = 10000
_TOUCH = 1e-6  # in texels


def advect_texels(
    atlas: TextureAtlas,
    values: npt.NDArray[np.float32],
    channels: Channels,
    potential: npt.NDArray[np.float32],
    time: float,
    out: npt.NDArray[np.float32],
    *,
    nearest: bool = False,
    normals: bool = False,
) -> None:
    """Read the values where the flow-lines come from, as `core.grid.walk.advect_pixels` does.

    Parameters
    ----------
    atlas : TextureAtlas
    values : (rows, columns, c) float32
        Values of nodes and ghosts.
    channels : Channels
    potential : (rows, columns) float32
        See `texel_potential`.
    time : float
        How long values flow.
    out : (rows, columns, c) float32
        Where the channels' values at nodes inside charts go.
    nearest : bool
        Read the nearest texel instead of interpolating.
    normals : bool
        The first two channels are tangent-space directions around 1/2, which turn with the
        charts that flow-lines come from.
    """
    nodes, copies = atlas.sheet.nodes, atlas.copies
    skipped = np.zeros(nodes.shape, dtype=np.bool_)
    skipped.reshape(-1)[copies[:, 0]] = True
    run(_advect, len(nodes), skipped, atlas.sheet, atlas.metric, potential, float(time), values,
        channels.start, channels.stop, channels.alpha, nearest, normals, out, chunk=8)  # fmt: skip
    flat = out.reshape(skipped.size, -1)
    flat[copies[:, 0], channels.start : channels.stop] = flat[
        copies[:, 1], channels.start : channels.stop
    ]


@kernel
def _flow(potential, cells, inverse, i, j, turned):
    # v = -h^-1 dP / 2 in a cell, and dP: (down, across, down, across), or the other way round
    # if turned.
    row, column = (j, i) if turned else (i, j)
    a = potential[row, column]
    b = potential[row, column + 1]
    c = potential[row + 1, column]
    d = potential[row + 1, column + 1]
    down = 0.5 * (float(c - a) + float(d - b))
    across = 0.5 * (float(b - a) + float(d - c))
    face = cells[row, column]
    v = -0.5 * (inverse[face, 0, 0] * down + inverse[face, 0, 1] * across)
    w = -0.5 * (inverse[face, 1, 0] * down + inverse[face, 1, 1] * across)
    if turned:
        return w, v, across, down
    return v, w, down, across


@kernel
def _is_open(cells, i, j, turned):
    return (cells[j, i] if turned else cells[i, j]) != NOTHING


@kernel
def _seam(sheet, row, column, down, across, axis):
    # The half-edge over which a point on a side of a cell leaves its chart, or -1: that of the
    # nearest ghost at the side's ends.
    y = row + (down > 0.5)
    x = column + (across > 0.5)
    nodes = sheet.nodes
    node = nodes[y, x]
    if node >= -1:
        if axis == 1 and 0.0 < across < 1.0:
            node = nodes[y, 2 * column + 1 - x]
        elif axis == 2 and 0.0 < down < 1.0:
            node = nodes[2 * row + 1 - y, x]
    return sheet.ghost_edges[-2 - node] if node < -1 else -1


@kernel
def _cross_seam(sheet, metric, edge, y, x, vy, vx, b, turn):
    # Over a seam: (face or -1, row, column) on the other side, and the velocity (vy, vx) there.
    face, row, column, cosine, sine = place_beyond(
        sheet.points, metric.twins, metric.shapes, metric.jacobians, sheet.cells, edge, y, x, b, turn
    )
    if face < 0:
        return -1, row, column, vy, vx
    u, v = apply(metric.jacobians, edge // 3, vy, vx)
    u, v = cosine * u - sine * v, sine * u + cosine * v
    vy, vx = apply(metric.inverse_jacobians, face, u, v)
    return face, row, column, vy, vx


@kernel
def _walk(potential, cells, inverse, time, row, column, down, across):
    # From cell to cell inside a chart. The same walk as in `core.grid`, but on the surface's metric
    # and among cells that may be closed; that one stays free of both for speed. Returns where it
    # ends: (row, column, down, across), the time that is left, the velocity (down, across),
    # and the axis along which it leaves its chart: 1 down, 2 across, 0 if it does not.
    left = time
    v, w, _, _ = _flow(potential, cells, inverse, row, column, False)
    y = down + v * left
    x = across + w * left
    if 0.0 < y < 1.0 and 0.0 < x < 1.0:
        return row, column, y, x, 0.0, v, w, 0
    i, j, a, o = row, column, down, across
    turned = False
    sliding = False
    axis = 0
    for _ in range(1000000):
        if not sliding:
            reach_a = reach(a, v)
            reach_o = reach(o, w)
            if left <= min(reach_a, reach_o):
                if left < np.inf:
                    a += v * left
                    o += w * left
                break
            if reach_o < reach_a:
                turned = not turned
                i, j, a, o, v, w = j, i, o, a, w, v
                reach_a = reach_o
            left -= reach_a
            ahead = 1 if v > 0 else -1
            a = 1.0 if v > 0 else 0.0
            o = min(max(o + w * reach_a, 0.0), 1.0)
            next_i = i + ahead
            if not _is_open(cells, next_i, j, turned):
                axis = 1
                break
            next_v, next_w, pv, pw = _flow(potential, cells, inverse, next_i, j, turned)
            if v * pv + w * pw >= 0:
                break
            if v * next_v > 0:
                i = next_i
                a = 1.0 - a
                v, w = next_v, next_w
                continue
            share = -next_v / (v - next_v)
            w = share * w + (1.0 - share) * next_w
            v = 0.0
            i = min(i, next_i)
            a = 1.0
            sliding = True
        reached = (1.0 - o) / w if w > 0 else (o / -w if w < 0 else np.inf)
        if reached >= left:
            if left < np.inf:
                o += w * left
            break
        left -= reached
        ahead = 1 if w > 0 else -1
        o = 1.0 if w > 0 else 0.0
        next_j = j + ahead
        if not _is_open(cells, i, next_j, turned) or not _is_open(cells, i + 1, next_j, turned):
            axis = 2
            break
        came = w
        j = next_j
        o = 1.0 - o
        v, w, _, pw = _flow(potential, cells, inverse, i, j, turned)
        next_v, next_w, _, next_pw = _flow(potential, cells, inverse, i + 1, j, turned)
        if v >= 0 and next_v <= 0:
            total = v - next_v
            share = -next_v / total if total > 0 else 0.5
            w = share * w + (1.0 - share) * next_w
            pw = share * pw + (1.0 - share) * next_pw
            v = 0.0
        else:
            if next_v > 0 and next_v > -v:
                i += 1
                a = 0.0
                v, w, pw = next_v, next_w, next_pw
            sliding = False
        if came * pw >= 0:
            break
    if turned:
        return j, i, o, a, left, w, v, (3 - axis if axis else 0)
    return i, j, a, o, left, v, w, axis


@kernel
def _walk_on(
    sheet, metric, potential, row, column, down, across, left, vy, vx, axis, b, turn, step_turn
):
    # From where a walk leaves its chart, over as many seams as it takes. `turn` gathers how
    # normals turn on the way back.
    turn[0, 0] = turn[1, 1] = 1.0
    turn[0, 1] = turn[1, 0] = 0.0
    for _ in range(_MOST_HOPS):
        edge = _seam(sheet, row, column, down, across, axis)
        if edge < 0 or metric.twins[edge // 3, edge % 3] < 0:
            break
        # A touch before the line: should the charts' texels line up, the walk crosses it there
        # as it would have done here.
        speed = abs(vy) + abs(vx)
        y = row + down - _TOUCH * vy / speed
        x = column + across - _TOUCH * vx / speed
        face, y, x, vy, vx = _cross_seam(sheet, metric, edge, y, x, vy, vx, b, step_turn)
        if face < 0:
            break
        _join_turns(turn, step_turn)
        row = int(y)
        column = int(x)
        down = y - row
        across = x - column
        _, _, py, px = _flow(potential, sheet.cells, metric.inverse_metrics, row, column, False)
        if vy * py + vx * px >= 0:
            break
        row, column, down, across, left, vy, vx, axis = _walk(
            potential, sheet.cells, metric.inverse_metrics, left, row, column, down, across
        )
        if axis == 0:
            break
    return row, column, down, across


@kernel
def _join_turns(turn, step):
    # turn times step, in place.
    for row in range(2):
        a = turn[row, 0]
        c = turn[row, 1]
        turn[row, 0] = a * step[0, 0] + c * step[1, 0]
        turn[row, 1] = a * step[0, 1] + c * step[1, 1]


@kernel
def _advect(
    start, stop, skipped, sheet, metric, potential, time, values, first, last, alpha, nearest,
    normals, out,
):  # fmt: skip
    nodes, cells = sheet.nodes, sheet.cells
    total = np.empty(values.shape[2])
    sample = np.empty(values.shape[2])
    b = np.empty(3)
    turn = np.empty((2, 2))
    step_turn = np.empty((2, 2))
    for y in range(start, stop):
        for x in range(nodes.shape[1]):
            if nodes[y, x] < 0 or skipped[y, x]:
                continue
            total[:] = 0.0
            weight = 0.0
            for corner in range(4):
                up = corner >> 1
                left = corner & 1
                row = y - up
                column = x - left
                if cells[row, column] == NOTHING:
                    continue
                row, column, down, across, rest, vy, vx, axis = _walk(
                    potential, cells, metric.inverse_metrics, time, row, column,
                    1.0 - 0.5 * OFFSET if up else 0.5 * OFFSET,
                    1.0 - 0.5 * OFFSET if left else 0.5 * OFFSET,
                )  # fmt: skip
                hops = axis != 0
                if hops:
                    row, column, down, across = _walk_on(
                        sheet, metric, potential, row, column, down, across, rest, vy, vx, axis,
                        b, turn, step_turn,
                    )  # fmt: skip
                if hops and normals:
                    sample[:] = 0.0
                    part = add_sample(
                        values, first, last, alpha, row, column, down, across, nearest, sample
                    )
                    p = sample[0] - 0.5 * part
                    q = sample[1] - 0.5 * part
                    sample[0] = 0.5 * part + turn[0, 0] * p + turn[0, 1] * q
                    sample[1] = 0.5 * part + turn[1, 0] * p + turn[1, 1] * q
                    total += sample
                    weight += part
                else:
                    weight += add_sample(
                        values, first, last, alpha, row, column, down, across, nearest, total
                    )
            for c in range(first, last):
                out[y, x, c] = total[c] / weight if weight > 0 else values[y, x, c]
