# SPDX-License-Identifier: GPL-3.0-or-later
"""Flow and advection in a sheet of texels, on the surface's metric and across seams.

The scheme is that for images (`core.grid`): texels are vertices of a mesh of squares, the flow
is constant in a cell. Here it is u = h^-1 dP / 2 with the metric h of a face in the cell, and
a flow-line that leaves its chart goes on where the surface does.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..grid import OFFSET, Channels
from ..parallel import Progress, kernel, run
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
    progress: Progress,
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
    energy = np.zeros(shape, dtype=np.float32)
    guides = 1 if channels.brightness.size else channels.stop - channels.start
    together = guides if normals else 1  # directions turn together, others go one by one
    centre = np.float32(0.5 if normals else 0.0)
    signal = np.zeros((*shape, together), dtype=np.float32)
    spare = np.zeros_like(signal)
    for guide in range(0, guides, together):
        run(_take_guides, shape[0], values, channels.start + guide, channels.alpha,
            channels.brightness, centre, signal, chunk=ROWS)  # fmt: skip
        for _ in range(passes):
            _smooth(sheet, sources, surface, signal, spare, 0.0 if normals else None)
            signal, spare = spare, signal
        run(_add_energy, shape[0] - 1, sheet.cells, surface.metrics, signal, energy, chunk=ROWS)
        progress.update((guide + together) / (guides + 1))
    if normals:
        signal, spare = (np.zeros((*shape, 1), dtype=np.float32) for _ in range(2))
    potential = signal
    run(_average_energy, shape[0], sheet.nodes, sheet.cells, surface.metrics, energy,
        potential[..., 0], chunk=ROWS)  # fmt: skip
    fill_ghosts(sheet, sources, potential)
    for _ in range(passes):
        _smooth(sheet, sources, surface, potential, spare)
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
    out: npt.NDArray[np.float32],
    *,
    nearest: bool = False,
    normals: bool = False,
    progress: Progress | None = None,
) -> None:
    """Read the values where the flow-lines come from, as `core.grid.advect_pixels` does.

    Parameters
    ----------
    normals : bool
        The first two channels are tangent-space directions around 1/2, which turn with the
        charts that flow-lines come from.
    out : (rows, columns, c) float32
        Where the channels' values at nodes inside charts go.
    """
    run(_advect, sheet.nodes.shape[0], sheet.nodes, sheet.cells, sheet.ghost_edges,
        surface.points, surface.twins, surface.shapes, surface.to_frame, surface.to_texels,
        surface.metrics, potential, float(time), values, channels.start, channels.stop,
        channels.alpha, nearest, normals, out, chunk=8, progress=progress)  # fmt: skip


def _smooth(
    sheet: Sheet,
    sources: Sources,
    surface: Surface,
    values: npt.NDArray[np.float32],
    out: npt.NDArray[np.float32],
    directions: float | None = None,
) -> None:
    run(_smooth_rows, values.shape[0], sheet.nodes, sources.cells, surface.metrics, values, out,
        chunk=ROWS)  # fmt: skip
    fill_ghosts(sheet, sources, out, directions=directions)


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
            potential[y, x] = min(total / area, np.float32(1e30)) if area > 0 else 0.0


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
def _reach(place, speed):
    # The time until the end of the cell, along one axis.
    if speed > 1e-30:
        return (1.0 - place) / speed
    if speed < -1e-30:
        return place / -speed
    return np.inf


@kernel
def _seam(nodes, edges, i, j, a, o, turned):
    # The half-edge over which a point on a side of a cell leaves its chart, or -1: that of the
    # nearest ghost at the side's ends.
    line = i + (a > 0.5)
    near = j + (o > 0.5)
    node = nodes[near, line] if turned else nodes[line, near]
    if node >= -1 and 0.0 < o < 1.0:
        other = 2 * j + 1 - near
        node = nodes[other, line] if turned else nodes[line, other]
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
def _walk(
    nodes, cells, edges, points, twins, shapes, to_frame, to_texels, metrics, potential, time,
    row, column, down, across, b, turn, step_turn,
):  # fmt: skip
    # From cell to cell, as `core.grid` walks from square to square. Returns where it ends;
    # `turn` gathers how normals turn on the way back.
    left = time
    v, w, _, _ = _flow(potential, cells, metrics, row, column, False)
    y = down + v * left
    x = across + w * left
    if 0.0 < y < 1.0 and 0.0 < x < 1.0:
        return row, column, y, x
    i, j, a, o = row, column, down, across
    turned = False
    sliding = False
    hops = 0
    for _ in range(1000000):
        leaves = False
        if not sliding:
            reach_a = _reach(a, v)
            reach_o = _reach(o, w)
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
                leaves = True
            else:
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
        if not leaves:
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
                leaves = True
            else:
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
                continue
        # Over the seam, if there is one.
        y = (j + o) if turned else (i + a)
        x = (i + a) if turned else (j + o)
        edge = _seam(nodes, edges, i, j, a, o, turned)
        hops += 1
        if edge < 0 or twins[edge // 3, edge % 3] < 0 or hops > _MOST_HOPS:
            break
        vy, vx = (w, v) if turned else (v, w)
        # A touch before the line: should the charts' texels line up, the walk crosses it there
        # as it would have done here.
        speed = np.sqrt(vy * vy + vx * vx)
        y -= _TOUCH * vy / speed
        x -= _TOUCH * vx / speed
        face, row, column, vy, vx = _hop(
            points, twins, shapes, to_frame, to_texels, edge, y, x, vy, vx, cells, b, step_turn
        )
        if face < 0:
            break
        _join_turns(turn, step_turn)
        turned = False
        sliding = False
        i = int(row)
        j = int(column)
        a = row - i
        o = column - j
        v, w, pv, pw = _flow(potential, cells, metrics, i, j, False)
        if vy * pv + vx * pw >= 0:
            break
    return (j, i, o, a) if turned else (i, j, a, o)


@kernel
def _join_turns(turn, step):
    # turn times step, in place.
    for row in range(2):
        a = turn[row, 0]
        c = turn[row, 1]
        turn[row, 0] = a * step[0, 0] + c * step[1, 0]
        turn[row, 1] = a * step[0, 1] + c * step[1, 1]


@kernel
def _add(values, first, last, alpha, row, column, down, across, nearest, normals, turn, total):
    # Adds the values at a point, times opacity, to total; returns the opacity.
    if nearest:
        down = 1.0 if down > 0.5 else 0.0
        across = 1.0 if across > 0.5 else 0.0
    opacity = 0.0
    for corner in range(4):
        y = row + (corner >> 1)
        x = column + (corner & 1)
        weight = down if corner >> 1 else 1.0 - down
        weight *= across if corner & 1 else 1.0 - across
        if alpha >= 0:
            weight *= values[y, x, alpha]
        opacity += weight
        if normals:
            p = values[y, x, 0] - 0.5
            q = values[y, x, 1] - 0.5
            total[0] += weight * (0.5 + turn[0, 0] * p + turn[0, 1] * q)
            total[1] += weight * (0.5 + turn[1, 0] * p + turn[1, 1] * q)
            for c in range(2, last):
                total[c] += weight * values[y, x, c]
        else:
            for c in range(first, last):
                total[c] += weight * values[y, x, c]
    return opacity


@kernel
def _advect(
    start, stop, nodes, cells, edges, points, twins, shapes, to_frame, to_texels, metrics,
    potential, time, values, first, last, alpha, nearest, normals, out,
):  # fmt: skip
    total = np.empty(values.shape[2])
    b = np.empty(3)
    turn = np.empty((2, 2))
    step_turn = np.empty((2, 2))
    for y in range(start, stop):
        for x in range(nodes.shape[1]):
            if nodes[y, x] < 0:
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
                turn[0, 0] = turn[1, 1] = 1.0
                turn[0, 1] = turn[1, 0] = 0.0
                row, column, down, across = _walk(
                    nodes, cells, edges, points, twins, shapes, to_frame, to_texels, metrics,
                    potential, time, row, column,
                    1.0 - 0.5 * OFFSET if up else 0.5 * OFFSET,
                    1.0 - 0.5 * OFFSET if left else 0.5 * OFFSET,
                    b, turn, step_turn,
                )  # fmt: skip
                weight += _add(values, first, last, alpha, row, column, down, across, nearest,
                               normals, turn, total)  # fmt: skip
            for c in range(first, last):
                out[y, x, c] = total[c] / weight if weight > 0 else values[y, x, c]
