# SPDX-License-Identifier: GPL-3.0-or-later
"""Distinguishes seams across which a texture continues from borders between materials.

A seam is cut into parts about a texel long, and texels on both sides of each are compared. Where
the median step around a part exceeds what chance and the change within each side explain, the part
is closed, as a border between materials: nothing crosses it. Stray texels and edges that cross the
seam have no effect, as parts are decided together with those near them along the seam.

Beside faces without area in the texture, as those on one point of a palette, there are no texels on
one of the sides: there, the texels at the seam itself are compared.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..base.progress import ask
from ..base.vectors import after
from ..mesh.triangle_mesh import Floats, Ints
from .atlas import TextureAtlas
from .ghosts import interpolate, place_beyond, turn_direction
from .metric import apply, frame_axis
from .sheet import NOTHING, place_on_edge

_NEAR, _FAR = 0.75, 1.75  # depths at which texels are read, in texels of the coarser side
_SLOPE = 2.0  # a step must exceed the change between these depths this many times, if in line
_MOST_TEXELS = 4.0  # most texels of the finer side for one of the coarser side
_LEAST = 0.25  # least weight of the chart's texels for a reading
_RUN = 8.0  # texels to each side along the seam that are decided together
_MOST_PARTS = 64  # the same as a number of parts, of which edges far below a texel make many
_UNSEEN = 0.012  # largest invisible step, relative to the texture's range
_STEPS = 1.5  # largest invisible step of whole numbers, in multiples of their spacing
_CHANCE = 2.0  # standard errors that count as chance
_DEVIATION = 1.86  # standard error of a median times root n, in median absolute deviations
_TOUCH = 1e-3  # distance beyond a seam, in texels, from which normals are rotated
_SAMPLE = 100_000  # texels that the range is measured from


class _Parts(NamedTuple):
    # Parts of seams in their order along runs; a run continues while the charts on both sides stay
    # the same. Edge and share of the middle on both sides (2, k), length in texels of the coarser
    # side, number of the run, and number within the seam.
    edges: Ints
    shares: Floats
    lengths: Floats
    runs: Ints
    numbers: npt.NDArray[np.int64]


def settle_seams(
    atlas: TextureAtlas,
    values: npt.NDArray[np.float32],
    how: str,
    step: float,
    *,
    alpha: int = -1,
    normals: bool = False,
) -> TextureAtlas:
    """Close the seams of an atlas across which its texture does not continue.

    Parameters
    ----------
    values : (rows, columns, c) float32
        Values of the nodes inside charts before filtering.
    how : {"auto", "continue", "extend"}
        Compare both sides, close no seam, or close all seams.
    step : float
        Values are multiples of it; 0 for floats.
    alpha : int
        The channel that is opacity; -1: none.
    normals : bool
        The first two channels are tangent-space directions around 1/2; they rotate across seams.

    Returns
    -------
    TextureAtlas
        The same object if no seam has to be closed.
    """
    borders, twins = atlas.charts.borders, atlas.mesh.twins.reshape(-1)
    seams = borders[twins[borders] >= 0]
    if how == "continue" or len(seams) == 0:
        return atlas
    counts = np.zeros(len(twins) + 1, dtype=np.int32)
    if how == "extend":
        counts[seams + 1] = 1
        return atlas.closed(np.cumsum(counts, dtype=np.int32), np.ones(len(seams), dtype=np.bool_))
    parts = _cut(atlas)
    ask()
    unseen = max(_STEPS * step, _UNSEEN * _range(atlas, values, alpha))
    closed = _differing(atlas, parts, values.reshape(-1, values.shape[2]), unseen, alpha, normals)
    if not closed.any():
        return atlas
    # Each side numbers its parts in its own direction.
    np.add.at(counts, parts.edges + 1, 1)
    starts = np.cumsum(counts, dtype=np.int32)
    one, other = parts.edges
    both = np.empty(starts[-1], dtype=np.bool_)
    both[starts[one] + parts.numbers] = closed
    both[starts[other + 1] - 1 - parts.numbers] = closed
    return atlas.closed(starts, both)


def _differing(
    atlas: TextureAtlas,
    parts: _Parts,
    values: npt.NDArray[np.float32],
    unseen: float,
    alpha: int,
    normals: bool,
) -> npt.NDArray[np.bool_]:
    count = len(parts.lengths)
    steps = np.empty((count, values.shape[1]), dtype=np.float32)
    changes = np.empty(count, dtype=np.float32)
    unknown = np.zeros(len(atlas.sheet.ghosts), dtype=np.bool_)  # ghosts are not read
    inner = atlas.sheet, atlas.charts.labels, unknown
    run(_measure, count, parts.edges, parts.shares, inner, atlas.metric, values, alpha, normals,
        steps, changes)  # fmt: skip
    closed = np.empty(count, dtype=np.bool_)
    reach = _around(parts, _RUN)
    run(_decide, count, *reach, parts.lengths, steps, changes, unseen, closed)
    known = np.concatenate([[0], np.cumsum(~np.isnan(changes))])
    bare = known[reach[1]] == known[reach[0]]
    if bare.any() and not normals:  # these would have to be turned
        at_seams = np.empty(count, dtype=np.bool_)
        painted = _painted(atlas, parts, values, alpha)
        nothing = np.zeros_like(changes)
        run(_decide, count, *reach, parts.lengths, painted, nothing, unseen, at_seams)
        closed = np.where(bare, at_seams, closed)
    # Closed parts that are a minority nearby are chance.
    first, last = _around(parts, 0.5 * _RUN)
    votes = np.concatenate([[0.0], np.cumsum(np.where(closed, 1.0, -1.0) * parts.lengths)])
    return closed & (votes[last] - votes[first] > -1e-9)


def _painted(
    atlas: TextureAtlas, parts: _Parts, values: npt.NDArray[np.float32], alpha: int
) -> npt.NDArray[np.float32]:
    # The step from one side of each part to the other, of the nearest texels at the seam.
    face, k = np.divmod(parts.edges, 3)
    points, share = atlas.sheet.points, parts.shares[..., None]
    places = points[face, k] + share * (points[face, (k + 1) % 3] - points[face, k])
    rows, columns = np.moveaxis(np.rint(places).astype(np.int64), -1, 0)
    colors = values[rows * atlas.sheet.nodes.shape[1] + columns]
    if alpha >= 0:
        opacity = colors[..., alpha].copy()
        colors *= opacity[..., None]
        colors[..., alpha] = opacity
    steps: npt.NDArray[np.float32] = colors[1] - colors[0]
    return steps


def _range(atlas: TextureAtlas, values: npt.NDArray[np.float32], alpha: int) -> float:
    # The range of nearly all visible values, in the channel where it is largest.
    nodes = atlas.sheet.nodes.reshape(-1)
    stride = nodes.size // _SAMPLE | 1
    sample = values.reshape(nodes.size, -1)[::stride][nodes[::stride] >= 0]
    shown = sample if alpha < 0 else sample[sample[:, alpha] > 0]
    if len(shown) == 0:
        return 0.0
    low, high = np.quantile(shown, (0.01, 0.99), axis=0)
    if alpha >= 0:
        low[alpha], high[alpha] = np.quantile(sample[:, alpha], (0.01, 0.99))
    return float((high - low).max())


def _cut(atlas: TextureAtlas) -> _Parts:
    twins, points = atlas.mesh.twins.reshape(-1), atlas.charts.points
    borders = atlas.charts.borders
    ends = np.zeros(len(twins), dtype=np.bool_)
    ends[borders] = True
    first = borders[twins[borders] > borders]
    edges, runs = np.empty_like(first), np.empty_like(first)
    _order(first, twins, ends, edges, runs)
    ask()
    sides = np.stack([edges, twins[edges]])
    face, k = np.divmod(sides, 3)
    sizes = np.linalg.norm(points[face, (k + 1) % 3] - points[face, k], axis=-1)
    counts = np.maximum(np.ceil(sizes.max(axis=0)), 1).astype(np.int64)
    seam = np.repeat(np.arange(len(edges)), counts)
    numbers = np.arange(len(seam)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = (numbers + 0.5) / counts[seam]
    lengths = (sizes.min(axis=0) / counts)[seam]
    return _Parts(sides[:, seam], np.stack([share, 1.0 - share]), lengths, runs[seam], numbers)


def _around(parts: _Parts, reach: float) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    # The range of parts within reach of each along its run: the first, and one past the last.
    places = np.cumsum(parts.lengths) - 0.5 * parts.lengths + 4 * _RUN * parts.runs
    first = np.searchsorted(places, places - reach, side="left")
    last = np.searchsorted(places, places + reach, side="right")
    number = np.arange(len(places))
    return np.maximum(first, number - _MOST_PARTS), np.minimum(last, number + _MOST_PARTS + 1)


@kernel
def _next(twins, ends, edge):
    # The next half-edge along the chart's outline.
    edge = edge - edge % 3 + after(edge % 3)
    while not ends[edge]:
        edge = twins[edge]
        edge = edge - edge % 3 + after(edge % 3)
    return edge


@kernel
def _follow(twins, ends, edge):
    # The next seam between the sides of the same two charts, or -1.
    found = _next(twins, ends, edge)
    if twins[found] < 0 or found == twins[edge] or _next(twins, ends, twins[found]) != twins[edge]:
        return -1
    return found


@kernel
def _order(seams, twins, ends, edges, runs):
    # Lists the seams run by run, each as the half-edge that points along the run.
    done = np.zeros(twins.shape[0], dtype=np.bool_)
    count = 0
    number = 0
    for seam in seams:
        if done[seam]:
            continue
        first = seam
        while True:
            before = _follow(twins, ends, twins[first])
            if before < 0 or twins[before] == seam:
                break
            first = twins[before]
        edge = first
        while edge >= 0 and not done[edge]:
            done[edge] = True
            done[twins[edge]] = True
            edges[count] = edge
            runs[count] = number
            count += 1
            edge = _follow(twins, ends, edge)
        number += 1


@kernel
def _steps(metric, edge):
    # The inward step from a half-edge, in texels down and across, per unit on the surface.
    f, k = divmod(edge, 3)
    if metric.shapes[f, 2] == 0:
        return 0.0, 0.0
    u, v = frame_axis(metric.shapes, f, k)
    return apply(metric.inverse_jacobians, f, -v, u)


@kernel
def _read(atlas, values, alpha, face, y, x, out):
    # Reads the texels of a face's own chart at a place, times opacity; returns if there are any.
    sheet, labels, unknown = atlas
    rows, columns = sheet.cells.shape
    if not (0 <= y < rows - 1 and 0 <= x < columns - 1):
        return False
    row, column = int(y), int(x)
    there = sheet.cells[row, column]
    if there == NOTHING or labels[there] != labels[face]:
        return False
    cell = row * columns + column
    out[:] = 0.0
    weight = interpolate(sheet.nodes, unknown, values, cell, y - row, x - column, alpha, out)
    if alpha >= 0:
        for c in range(out.shape[0]):
            if c != alpha:
                out[c] *= out[alpha]
    return weight > _LEAST


@kernel
def _rotate(alpha, rotation, color):
    turn_direction(rotation, color, 0.5 if alpha < 0 else 0.5 * color[alpha])


@kernel
def _look(atlas, metric, values, alpha, normals, edge, share, other, step, back, b, rotation, out):
    # Reads beside a half-edge, a step inside its chart. If the chart has no texels of its own
    # there, as in slivers, reads the texels behind it: a step `back` over the half-edge of the
    # other side ends there. Normals are rotated to that side.
    sheet = atlas[0]
    y, x = place_on_edge(sheet.points, edge, share)
    if _read(atlas, values, alpha, edge // 3, y + step[0], x + step[1], out):
        if normals:
            y, x = place_on_edge(sheet.points, other, 1.0 - share)
            size = max(np.sqrt(back[0] ** 2 + back[1] ** 2), 1e-9)
            place_beyond(
                sheet.points, metric.ways, metric.shapes, metric.jacobians, sheet.cells, other,
                y - _TOUCH / size * back[0], x - _TOUCH / size * back[1], b, rotation,
            )  # fmt: skip
            _rotate(alpha, rotation, out)
        return True
    y, x = place_on_edge(sheet.points, other, 1.0 - share)
    face, y, x, _, _ = place_beyond(
        sheet.points, metric.ways, metric.shapes, metric.jacobians, sheet.cells, other,
        y - back[0], x - back[1], b, rotation,
    )  # fmt: skip
    if face < 0 or not _read(atlas, values, alpha, face, y, x, out):
        return False
    if normals:
        _rotate(alpha, rotation, out)
    return True


@kernel
def _measure(start, stop, edges, shares, atlas, metric, values, alpha, normals, steps, changes):
    # The step from one side of each part to the other, beyond what a ramp or a soft edge across the
    # seam explains, and how much both sides change inwards; NaN if that is unknown.
    colors = np.empty((2, 2, values.shape[1]))
    strides = np.empty((2, 2))
    rotation = np.eye(2)
    b = np.empty(3)
    for i in range(start, stop):
        steps[i] = np.nan
        changes[i] = np.nan
        length = 0.0  # of a texel of the coarser side
        for side in range(2):
            strides[side] = _steps(metric, edges[side, i])
            size = np.sqrt(strides[side, 0] ** 2 + strides[side, 1] ** 2)
            if size > 0:
                length = max(length, 1.0 / size)
        for side in range(2):
            size = np.sqrt(strides[side, 0] ** 2 + strides[side, 1] ** 2)
            if size > 0:
                strides[side] *= min(length, _MOST_TEXELS / size)
        complete = True
        for side in range(2):
            for n in range(2):
                depth = _NEAR if n == 0 else _FAR
                complete = complete and _look(
                    atlas, metric, values, alpha, normals and side == 1, edges[side, i],
                    shares[side, i], edges[1 - side, i], depth * strides[side],
                    depth * strides[1 - side], b, rotation, colors[side, n],
                )  # fmt: skip
        if not complete:
            continue
        changes[i] = 0.0
        for c in range(values.shape[1]):
            one = colors[0, 0, c] - colors[0, 1, c]
            other = colors[1, 1, c] - colors[1, 0, c]
            step = colors[1, 0, c] - colors[0, 0, c]
            slope = _SLOPE * (one + other)
            if step * slope > 0:
                step -= slope if abs(slope) < abs(step) else step
            steps[i, c] = step
            changes[i] = max(changes[i], abs(one) + abs(other))


@kernel
def _median(values, weights, count):
    # Weighted median of the first ones, which are sorted; the mean of two if it lies between them.
    half = 0.0
    for i in range(count):
        value = values[i]
        weight = weights[i]
        half += 0.5 * weight
        j = i
        while j > 0 and values[j - 1] > value:
            values[j] = values[j - 1]
            weights[j] = weights[j - 1]
            j -= 1
        values[j] = value
        weights[j] = weight
    total = 0.0
    for i in range(count - 1):
        total += weights[i]
        if total > half * (1.0 + 1e-9):
            return values[i]
        if total >= half * (1.0 - 1e-9):
            return 0.5 * (values[i] + values[i + 1])
    return values[count - 1]


@kernel
def _take(values, changes, lengths, first, last, found, weights):
    # Gathers the known values of some parts, with their lengths; returns their number.
    count = 0
    for i in range(first, last):
        if not np.isnan(changes[i]):
            found[count] = values[i]
            weights[count] = lengths[i]
            count += 1
    return count


@kernel
def _decide(start, stop, first, last, lengths, steps, changes, unseen, closed):
    # Closes parts around which the steps agree on more than chance explains.
    found = np.empty(2 * _MOST_PARTS + 1)
    weights = np.empty(2 * _MOST_PARTS + 1)
    for i in range(start, stop):
        closed[i] = False
        count = _take(changes, changes, lengths, first[i], last[i], found, weights)
        if count == 0:
            continue
        change = _median(found, weights, count)
        independent = max(min(weights[:count].sum(), float(count)), 1.0)
        for c in range(steps.shape[1]):
            _take(steps[:, c], changes, lengths, first[i], last[i], found, weights)
            step = _median(found, weights, count)
            for j in range(count):
                found[j] = abs(found[j] - step)
            spread = max(_DEVIATION * _median(found, weights, count), change)
            if abs(step) > unseen + _CHANCE * spread / np.sqrt(independent):
                closed[i] = True
                break
