# SPDX-License-Identifier: GPL-3.0-or-later
"""Flow and advection in a sheet of texels, on the surface's metric and across seams.

The scheme is that for images (`core.grid.walk`): texels are vertices of a mesh of squares, the flow
is constant in a cell. Here it is u = h^-1 dP / 2 with the metric h of a face in the cell, and
a flow-line that leaves its chart goes on where the surface does.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.parallel import Progress, kernel, run
from ..grid.walk import OFFSET, Channels, add_sample, reach
from ..mesh.triangle_mesh import Ints
from .ghosts import Sources, beyond, fill_ghosts
from .sheet import NOTHING, ROWS, Sheet
from .surface import Surface

_MOST_HOPS = 10000
_TOUCH = 1e-6  # in texels


def texel_potential(
    sheet: Sheet,
    sources: Sources,
    surface: Surface,
    values: npt.NDArray[np.float32],
    channels: Channels,
    passes: int,
    progress: Progress = Progress(None),
    *,
    normals: bool = False,
) -> npt.NDArray[np.float32]:
    """Compute P = sum over channels of the squared gradient, smoothed before and after.

    Parameters
    ----------
    values : (rows, columns, c) float32
        Values of nodes and ghosts, in [0, 1].
    channels : Channels
        As for images.
    passes : int
        Smoothing passes on the signal and on P.
    normals : bool
        The first two channels are tangent-space directions around 1/2, which turn across seams.

    Returns
    -------
    (rows, columns) float32
    """
    shape = sheet.nodes.shape
    message = "Computing the flow"
    energy = np.zeros(shape, dtype=np.float32)
    guides = 1 if channels.brightness.size else channels.stop - channels.start
    together = guides if normals else 1  # directions turn together, others go one by one
    centre = np.float32(0.5 if normals else 0.0)
    signal = np.zeros((*shape, together), dtype=np.float32)
    spare = np.zeros_like(signal)
    for guide in range(0, guides, together):
        first = guide / (guides + together)
        still = progress.part(first, first, message)
        run(_take_guides, shape[0], values, channels.start + guide, channels.alpha,
            channels.brightness, centre, signal, chunk=ROWS, progress=still)  # fmt: skip
        for _ in range(passes):
            _smooth(sheet, sources, surface, signal, spare, still, 0.0 if normals else None)
            signal, spare = spare, signal
        run(_add_energy, shape[0] - 1, sheet.cells, surface.metrics, signal, energy, chunk=ROWS,
            progress=still)  # fmt: skip
    still = progress.part(guides / (guides + together), guides / (guides + together), message)
    if normals:
        signal, spare = (np.zeros((*shape, 1), dtype=np.float32) for _ in range(2))
    potential = signal
    run(_average_energy, shape[0], sheet.nodes, sheet.cells, surface.metrics, energy,
        potential[..., 0], chunk=ROWS, progress=still)  # fmt: skip
    fill_ghosts(sheet, sources, potential, still)
    for _ in range(passes):
        _smooth(sheet, sources, surface, potential, spare, still)
        potential, spare = spare, potential
    progress.update(1.0)
    return potential[..., 0]


def advect_texels(
    sheet: Sheet,
    sources: Sources,
    surface: Surface,
    values: npt.NDArray[np.float32],
    channels: Channels,
    potential: npt.NDArray[np.float32],
    time: float,
    copies: Ints,
    out: npt.NDArray[np.float32],
    *,
    nearest: bool = False,
    normals: bool = False,
    progress: Progress | None = None,
) -> None:
    """Read the values where the flow-lines come from, as `core.grid.advect_pixels` does.

    Parameters
    ----------
    copies : (k, 2) int32
        Nodes that get the result of another one, and that one.
    normals : bool
        The first two channels are tangent-space directions around 1/2, which turn with the
        charts that flow-lines come from.
    out : (rows, columns, c) float32
        Where the channels' values at nodes inside charts go.
    """
    skipped = np.zeros(sheet.nodes.shape, dtype=np.bool_)
    skipped.reshape(-1)[copies[:, 0]] = True
    run(_advect, sheet.nodes.shape[0], skipped, sheet.nodes, sheet.cells, sheet.ghost_edges,
        surface.points, surface.twins, surface.shapes, surface.to_frame, surface.to_texels,
        surface.metrics, potential, float(time), values, channels.start, channels.stop,
        channels.alpha, nearest, normals, out, chunk=8, progress=progress)  # fmt: skip
    flat = out.reshape(skipped.size, -1)
    flat[copies[:, 0], channels.start : channels.stop] = flat[
        copies[:, 1], channels.start : channels.stop
    ]


def _smooth(
    sheet: Sheet,
    sources: Sources,
    surface: Surface,
    values: npt.NDArray[np.float32],
    out: npt.NDArray[np.float32],
    progress: Progress = Progress(None),
    directions: float | None = None,
) -> None:
    run(_smooth_rows, values.shape[0], sheet.nodes, sources.cells, surface.metrics, values, out,
        chunk=ROWS, progress=progress)  # fmt: skip
    fill_ghosts(sheet, sources, out, progress, directions=directions)


@kernel
def _take_guides(start, stop, values, first, alpha, brightness, centre, signal):
    for y in range(start, stop):
        for x in range(signal.shape[1]):
            for c in range(signal.shape[2]):
                if brightness.size > 0:
                    total = np.float32(0.0)
                    for k in range(brightness.size):
                        total += brightness[k] * values[y, x, first + k]
                else:
                    total = values[y, x, first + c]
                total -= centre
                if alpha >= 0:
                    total *= values[y, x, alpha]
                signal[y, x, c] = total


@kernel
def _exists(nodes, sources, y, x):
    node = nodes[y, x]
    return node >= 0 or (node < -1 and sources[-2 - node] >= 0)


@kernel
def _smooth_rows(start, stop, nodes, sources, metrics, values, out):
    for y in range(start, stop):
        for x in range(nodes.shape[1]):
            face = nodes[y, x]
            if face < 0:
                continue
            # Nodes inside are never at the sheet's rim.
            down = metrics[face, 4]
            across = metrics[face, 5]
            up = down if _exists(nodes, sources, y - 1, x) else np.float32(0.0)
            down = down if _exists(nodes, sources, y + 1, x) else np.float32(0.0)
            left = across if _exists(nodes, sources, y, x - 1) else np.float32(0.0)
            right = across if _exists(nodes, sources, y, x + 1) else np.float32(0.0)
            weight = np.float32(1.0) + up + down + left + right
            for c in range(values.shape[2]):
                total = values[y, x, c] + up * values[y - 1, x, c] + down * values[y + 1, x, c]
                total += left * values[y, x - 1, c] + right * values[y, x + 1, c]
                out[y, x, c] = total / weight


@kernel
def _add_energy(start, stop, cells, metrics, signal, energy):
    for y in range(start, stop):
        for x in range(cells.shape[1] - 1):
            face = cells[y, x]
            if face == NOTHING:
                continue
            for k in range(signal.shape[2]):
                a = signal[y, x, k]
                b = signal[y, x + 1, k]
                c = signal[y + 1, x, k]
                d = signal[y + 1, x + 1, k]
                across = np.float32(0.5) * (b - a + d - c)
                down = np.float32(0.5) * (c - a + d - b)
                energy[y, x] += (
                    metrics[face, 0] * down * down
                    + np.float32(2.0) * metrics[face, 1] * down * across
                    + metrics[face, 2] * across * across
                )


@kernel
def _average_energy(start, stop, nodes, cells, metrics, energy, potential):
    for y in range(start, stop):
        for x in range(nodes.shape[1]):
            if nodes[y, x] < 0:
                continue
            total = np.float32(0.0)
            area = np.float32(0.0)
            for dy in range(2):
                for dx in range(2):
                    face = cells[y - dy, x - dx]
                    if face != NOTHING:
                        total += metrics[face, 3] * energy[y - dy, x - dx]
                        area += metrics[face, 3]
            value = total / area if area > 0 else np.float32(0.0)
            potential[y, x] = value if abs(value) < np.float32(1e30) else np.float32(1e30)


@kernel
def _flow(potential, cells, metrics, i, j, turned):
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
    mixed = float(metrics[face, 1])
    v = -0.5 * (metrics[face, 0] * down + mixed * across)
    w = -0.5 * (mixed * down + metrics[face, 2] * across)
    if turned:
        return w, v, across, down
    return v, w, down, across


@kernel
def _is_open(cells, i, j, turned):
    return (cells[j, i] if turned else cells[i, j]) != NOTHING


@kernel
def _seam(nodes, edges, row, column, down, across, axis):
    # The half-edge over which a point on a side of a cell leaves its chart, or -1: that of the
    # nearest ghost at the side's ends.
    y = row + (down > 0.5)
    x = column + (across > 0.5)
    node = nodes[y, x]
    if node >= -1:
        if axis == 1 and 0.0 < across < 1.0:
            node = nodes[y, 2 * column + 1 - x]
        elif axis == 2 and 0.0 < down < 1.0:
            node = nodes[2 * row + 1 - y, x]
    return edges[-2 - node] if node < -1 else -1


@kernel
def _hop(points, twins, shapes, to_frame, to_texels, edge, y, x, vy, vx, cells, b, turn):
    # Over a seam: (face or -1, row, column) on the other side, and the velocity (vy, vx) there.
    f = edge // 3
    face, row, column, cosine, sine = beyond(
        points, twins, shapes, to_frame, edge, y, x, cells, b, turn
    )
    if face < 0:
        return -1, row, column, vy, vx
    u = to_frame[f, 0, 0] * vy + to_frame[f, 0, 1] * vx
    v = to_frame[f, 1, 0] * vy + to_frame[f, 1, 1] * vx
    u, v = cosine * u - sine * v, sine * u + cosine * v
    vy = to_texels[face, 0, 0] * u + to_texels[face, 0, 1] * v
    vx = to_texels[face, 1, 0] * u + to_texels[face, 1, 1] * v
    return face, row, column, vy, vx


@kernel
def _walk(potential, cells, metrics, time, row, column, down, across):
    # From cell to cell inside a chart. The same walk as in `core.grid`, but on the surface's metric
    # and among cells that may be closed; that one stays free of both for speed. Returns where it
    # ends: (row, column, down, across), the time that is left, the velocity (down, across),
    # and the axis along which it leaves its chart: 1 down, 2 across, 0 if it does not.
    left = time
    v, w, _, _ = _flow(potential, cells, metrics, row, column, False)
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
            next_v, next_w, pv, pw = _flow(potential, cells, metrics, next_i, j, turned)
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
        v, w, _, pw = _flow(potential, cells, metrics, i, j, turned)
        next_v, next_w, _, next_pw = _flow(potential, cells, metrics, i + 1, j, turned)
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
    nodes, cells, edges, points, twins, shapes, to_frame, to_texels, metrics, potential,
    row, column, down, across, left, vy, vx, axis, b, turn, step_turn,
):  # fmt: skip
    # From where a walk leaves its chart, over as many seams as it takes. `turn` gathers how
    # normals turn on the way back.
    turn[0, 0] = turn[1, 1] = 1.0
    turn[0, 1] = turn[1, 0] = 0.0
    for _ in range(_MOST_HOPS):
        edge = _seam(nodes, edges, row, column, down, across, axis)
        if edge < 0 or twins[edge // 3, edge % 3] < 0:
            break
        # A touch before the line: should the charts' texels line up, the walk crosses it there
        # as it would have done here.
        speed = abs(vy) + abs(vx)
        face, y, x, vy, vx = _hop(
            points, twins, shapes, to_frame, to_texels, edge,
            row + down - _TOUCH * vy / speed, column + across - _TOUCH * vx / speed,
            vy, vx, cells, b, step_turn,
        )  # fmt: skip
        if face < 0:
            break
        _join_turns(turn, step_turn)
        row = int(y)
        column = int(x)
        down = y - row
        across = x - column
        _, _, py, px = _flow(potential, cells, metrics, row, column, False)
        if vy * py + vx * px >= 0:
            break
        row, column, down, across, left, vy, vx, axis = _walk(
            potential, cells, metrics, left, row, column, down, across
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
    start, stop, skipped, nodes, cells, edges, points, twins, shapes, to_frame, to_texels, metrics,
    potential, time, values, first, last, alpha, nearest, normals, out,
):  # fmt: skip
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
                    potential, cells, metrics, time, row, column,
                    1.0 - 0.5 * OFFSET if up else 0.5 * OFFSET,
                    1.0 - 0.5 * OFFSET if left else 0.5 * OFFSET,
                )  # fmt: skip
                hops = axis != 0
                if hops:
                    row, column, down, across = _walk_on(
                        nodes, cells, edges, points, twins, shapes, to_frame, to_texels, metrics,
                        potential, row, column, down, across, rest, vy, vx, axis, b, turn,
                        step_turn,
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
