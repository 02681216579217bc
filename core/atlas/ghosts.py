# SPDX-License-Identifier: GPL-3.0-or-later
"""Ghosts: what each chart sees beyond its seams.

The value of a ghost is that of the surface where one comes by walking straight from the nearest
edge of the chart to the ghost's texel. It is read there by linear interpolation, which may need
other ghosts again: a few rounds settle them, the first one without them. Beyond a seam that is
closed (see `core.atlas.seams`) it is the value on that edge, which the chart has itself.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..mesh.triangle_mesh import Ints
from .metric import AtlasMetric, apply, exponential_map, is_closed, store
from .sheet import NOTHING, Sheet, ends, nearest_on_edge, place_on_edge

_ROUNDS = 3
_MOST_TEXELS = 4.0  # a texel beyond a seam is not farther away than so many texels there


class GhostSources(NamedTuple):
    """Where the values of ghosts come from.

    Attributes
    ----------
    cells : (g,) int32
        Row times columns plus column of the cell, or -1 if the surface ends here.
    places : (g, 2) float32
        The point in the cell, (down, across).
    turns : (g, 2, 2) float32
        What turns tangent-space normals from there to here.
    """

    cells: Ints
    places: npt.NDArray[np.float32]
    turns: npt.NDArray[np.float32]


class TakenCells(NamedTuple):
    """Cells that were taken out of a sheet: row times columns plus column, and what they held."""

    numbers: npt.NDArray[np.int64]
    faces: Ints


def find_sources(sheet: Sheet, metric: AtlasMetric) -> tuple[GhostSources, TakenCells]:
    """Find the sources of a sheet's ghosts; cells at ghosts without one are taken out."""
    count = len(sheet.ghosts)
    rows, columns = np.divmod(sheet.ghosts.astype(np.int64), sheet.nodes.shape[1])
    places = np.stack([rows, columns], axis=1).astype(np.float64)
    sources = GhostSources(
        np.full(count, -1, dtype=np.int32),
        np.zeros((count, 2), dtype=np.float32),
        np.zeros((count, 2, 2), dtype=np.float32),
    )
    run(_find, count, places, sheet, metric, sources)
    # Those that read nothing but one another would keep what the image holds beside the charts.
    values = np.zeros((*sheet.nodes.shape, 1), dtype=np.float32)
    known = fill_ghosts(sheet, sources, values)
    sources.cells[~known] = -1
    y, x = np.divmod(sheet.ghosts[sources.cells < 0].astype(np.int64), sheet.nodes.shape[1])
    corners = y[:, None] - [0, 0, 1, 1], x[:, None] - [0, 1, 0, 1]
    # The sheet's last row and column of cells are empty, so that -1 may stand for them.
    numbers = np.unique(np.ravel_multi_index(corners, sheet.cells.shape, mode="wrap"))
    flat = sheet.cells.reshape(-1)
    taken = TakenCells(numbers, flat[numbers])
    flat[numbers] = NOTHING
    return sources, taken


def fill_ghosts(
    sheet: Sheet,
    sources: GhostSources,
    values: npt.NDArray[np.float32],
    alpha: int = -1,
    directions: float | None = None,
) -> npt.NDArray[np.bool_]:
    """Read the ghosts' values from across the seams, in place.

    Parameters
    ----------
    values : (rows, columns, c) float32
        Values of the nodes.
    alpha : int
        The channel that is opacity: other channels count as much as it says. -1: none.
    directions : float, optional
        The first two channels are tangent-space directions around this value, which turn.

    Returns
    -------
    (g,) bool
        Ghosts that got a value.
    """
    flat = values.reshape(-1, values.shape[-1])
    found = np.empty((len(sheet.ghosts), values.shape[-1]), dtype=np.float32)
    turning = directions is not None
    centre = np.float32(directions or 0.0)
    known = np.zeros(len(sheet.ghosts), dtype=np.bool_)
    for _ in range(_ROUNDS):
        known_next = np.zeros_like(known)
        run(_read_ghosts, len(sheet.ghosts), sheet.nodes, sources, flat, alpha, turning, centre,
            known, found, known_next)  # fmt: skip
        known = known_next
        flat[sheet.ghosts[known]] = found[known]
    return known


def nearest_nodes(sheet: Sheet, sources: GhostSources) -> Ints:
    """Return the node inside a chart that is nearest to each node or ghost: (rows * columns,).

    Where there is none, it is `NOTHING`; that of a ghost is the nearest to its source.
    """
    nodes = sheet.nodes.reshape(-1)
    found = np.where(nodes >= 0, np.arange(len(nodes), dtype=np.int32), np.int32(NOTHING))
    found[sheet.ghosts] = nearest_in_cells(sheet, found, sources.cells, sources.places)
    return found


def nearest_in_cells(
    sheet: Sheet, nearest: Ints, cells: Ints, places: npt.NDArray[np.float32]
) -> Ints:
    """Return what `nearest` has at the nearest corner of cells that has any.

    Parameters
    ----------
    nearest : (rows * columns,) int32
        `NOTHING` at corners that do not count.
    cells : (k,) int32
        Row times columns plus column, or `NOTHING`.
    places : (k, 2) float32
        The point in the cell, (down, across).

    Returns
    -------
    (k,) int32
        `NOTHING` where no corner counts.
    """
    columns = sheet.nodes.shape[1]
    corners = cells[:, None] + np.array([0, 1, columns, columns + 1], dtype=np.int32)
    down, across = places[:, :1], places[:, 1:]
    weights = np.hstack([1 - down, down])[:, [0, 0, 1, 1]]
    weights = weights * np.hstack([1 - across, across])[:, [0, 1, 0, 1]]
    known = nearest[np.where(cells[:, None] >= 0, corners, 0)]
    known[cells < 0] = NOTHING
    best = np.where(known >= 0, weights, -1.0).argmax(axis=1)
    return known[np.arange(len(cells)), best]


def extend_ghosts(
    sheet: Sheet, labels: Ints, values: npt.NDArray[np.float32], inside: npt.NDArray[np.bool_]
) -> npt.NDArray[np.bool_]:
    """Continue each chart's own values linearly into its ghosts, in place.

    Parameters
    ----------
    labels : (m,) int32
        The chart of each face.
    values : (rows, columns, c) float32
    inside : (rows, columns) bool
        Nodes whose values are known.

    Returns
    -------
    (g,) bool
        Ghosts that got a value.
    """
    known = inside.copy()
    at_ghosts = known.reshape(-1)
    for _ in range(_ROUNDS):
        found = at_ghosts[sheet.ghosts]
        missing = np.flatnonzero(~found).astype(np.int32)
        run(_extend, len(missing), missing, sheet, labels, known, values, found)
        at_ghosts[sheet.ghosts] = found
    return at_ghosts[sheet.ghosts]


@kernel
def chart_of(sheet, labels, y, x):
    """Return the chart of a node or of the edge that a ghost is beyond, or `NOTHING`."""
    node = sheet.nodes[y, x]
    if node >= 0:
        return labels[node]
    if node == NOTHING or sheet.ghost_edges[-2 - node] < 0:
        return NOTHING
    return labels[sheet.ghost_edges[-2 - node] // 3]


@kernel
def _extend(start, stop, missing, sheet, labels, known, values, found):
    # The mean over all directions in which two known nodes follow; or in which one does.
    rows, columns = known.shape
    for ghost in missing[start:stop]:
        y, x = divmod(sheet.ghosts[ghost], columns)
        label = chart_of(sheet, labels, y, x)
        for reach in (2, 1):
            count = 0
            for n in range(9):
                b, a = y + n // 3 - 1, x + n % 3 - 1
                d, c = 2 * b - y, 2 * a - x
                if n == 4 or not (0 <= b < rows and 0 <= a < columns and known[b, a]):
                    continue
                if chart_of(sheet, labels, b, a) != label:
                    continue
                if reach == 2:
                    if not (0 <= d < rows and 0 <= c < columns and known[d, c]):
                        continue
                    if chart_of(sheet, labels, d, c) != label:
                        continue
                if count == 0:
                    values[y, x] = 0.0
                count += 1
                for channel in range(values.shape[2]):
                    change = values[b, a, channel] - values[d, c, channel] if reach == 2 else 0.0
                    values[y, x, channel] += values[b, a, channel] + change
            if count > 0:
                for channel in range(values.shape[2]):
                    values[y, x, channel] /= count
                found[ghost] = True
                break


@kernel
def _find(start, stop, places, sheet, metric, sources):
    points, cells = sheet.points, sheet.cells
    ways, shapes, jacobians = metric.ways, metric.shapes, metric.jacobians
    b = np.empty(3)
    for i in range(start, stop):
        edge = sheet.ghost_edges[i]
        if edge < 0:
            continue
        face, row, column, _, _ = place_beyond(
            points, ways, shapes, jacobians, cells, edge, places[i, 0], places[i, 1], b,
            sources.turns[i],
        )  # fmt: skip
        if face < 0:
            share, _ = nearest_on_edge(points, edge, places[i, 0], places[i, 1])
            if not is_closed(ways, edge, share):
                continue
            row, column = place_on_edge(points, edge, share)
            store(sources.turns[i], 1.0, 0.0, 0.0, 1.0)
        sources.cells[i] = int(row) * cells.shape[1] + int(column)
        sources.places[i, 0] = row - int(row)
        sources.places[i, 1] = column - int(column)


@kernel
def place_beyond(points, ways, shapes, jacobians, cells, edge, y, x, b, turn):
    """Walk as `walk_beyond` does, to a cell that a chart has.

    Parameters
    ----------
    cells : (rows, columns) int32
        See `Sheet`.

    Returns
    -------
    face, row, column, cosine, sine
        As there; `face` is -1 where there is no such cell, too.
    """
    g, row, column, cosine, sine = walk_beyond(points, ways, shapes, jacobians, edge, y, x, b, turn)
    if g < 0 or cells[int(row), int(column)] == NOTHING:
        return -1, 0.0, 0.0, 1.0, 0.0
    return g, row, column, cosine, sine


@kernel
def walk_beyond(points, ways, shapes, jacobians, edge, y, x, b, turn):
    """Walk from a half-edge's nearest point to (y, x), on the surface beyond it.

    Parameters
    ----------
    edge : int
        A half-edge at which a chart ends.
    y, x : float
        A place in the sheet, outside of that chart.
    b : (3,) float64
        Barycentric coordinates of the end; overwritten.
    turn : (2, 2) float
        What turns tangent-space normals from there to the half-edge's face; overwritten.

    Returns
    -------
    face : int
        Where one arrives, or -1 if the surface ends there.
    row, column : float
        The place in the sheet.
    cosine, sine : float
        Parallel transport from the half-edge's face to `face`.
    """
    share, _ = nearest_on_edge(points, edge, y, x)
    ay, ax, by, bx = ends(points, edge)
    dy = y - ay - share * (by - ay)
    dx = x - ax - share * (bx - ax)
    shorter = _shorter(ways.twins, jacobians, edge, dy, dx)
    dy *= shorter
    dx *= shorter
    g, cosine, sine = exponential_map(ways, shapes, jacobians, edge, share, dy, dx, b)
    if g < 0:
        return -1, 0.0, 0.0, 1.0, 0.0
    row = b[0] * points[g, 0, 0] + b[1] * points[g, 1, 0] + b[2] * points[g, 2, 0]
    column = b[0] * points[g, 0, 1] + b[1] * points[g, 1, 1] + b[2] * points[g, 2, 1]
    _turn_normals(jacobians, edge // 3, g, cosine, sine, turn)
    return g, row, column, cosine, sine


@kernel
def _shorter(twins, jacobians, edge, dy, dx):
    # What a step over a half-edge is to be multiplied by: where a texel here covers many beyond
    # the seam, such as next to slivers in the texture, it must not skip what lies at the seam.
    f = edge // 3
    g = twins[f, edge - 3 * f] // 3
    if g < 0:
        return 1.0
    there = abs(jacobians[g, 0, 0] * jacobians[g, 1, 1] - jacobians[g, 0, 1] * jacobians[g, 1, 0])
    u, v = apply(jacobians, f, dy, dx)
    length = np.sqrt(u * u + v * v)
    most = _MOST_TEXELS * np.sqrt(there * (dy * dy + dx * dx))
    return most / length if 0 < most < length else 1.0


@kernel
def _turn_normals(jacobians, f, g, cosine, sine, turn):
    # What turns a tangent-space normal in face g to face f. Tangents point along columns: that of
    # f is taken to g by parallel transport, and compared.
    tx, ty = jacobians[f, 0, 1], jacobians[f, 1, 1]
    sx, sy = jacobians[g, 0, 1], jacobians[g, 1, 1]
    length = np.sqrt((tx * tx + ty * ty) * (sx * sx + sy * sy))
    if length == 0:
        store(turn, 1.0, 0.0, 0.0, 1.0)
        return
    tx, ty = cosine * tx - sine * ty, sine * tx + cosine * ty
    c = (tx * sx + ty * sy) / length
    s = (sx * ty - sy * tx) / length
    # The second axis points along rows, to the left of the first one unless mirrored.
    one = 1.0 if _left(jacobians, f) else -1.0
    two = 1.0 if _left(jacobians, g) else -1.0
    # To g: [[c, -s one], [two s, two c one]]; back is its transpose.
    store(turn, c, two * s, -s * one, two * c * one)


@kernel
def _left(jacobians, f):
    return jacobians[f, 0, 1] * jacobians[f, 1, 0] - jacobians[f, 1, 1] * jacobians[f, 0, 0] > 0


@kernel
def _read_ghosts(
    start, stop, nodes, sources, values, alpha, turning, centre, known, found, known_now
):
    cells, places, turns = sources
    for i in range(start, stop):
        found[i] = 0.0
        if cells[i] < 0:
            continue
        down, across = places[i]
        total = interpolate(nodes, known, values, cells[i], down, across, alpha, found[i])
        if total <= 0:
            continue
        known_now[i] = True
        if turning:
            turn_direction(turns[i], found[i], centre)


@kernel
def _add_nodes(nodes, known, values, cell, down, across, alpha, out):
    # Adds up what `interpolate` divides, and returns the weight.
    flat_nodes = nodes.reshape(-1)
    total = 0.0
    for corner in range(4):
        node = cell + (corner >> 1) * nodes.shape[1] + (corner & 1)
        ghost = -2 - flat_nodes[node]
        if ghost == -1 or (ghost >= 0 and not known[ghost]):
            continue
        weight = down if corner >> 1 else 1.0 - down
        weight *= across if corner & 1 else 1.0 - across
        total += weight
        share = weight
        if alpha >= 0:
            share *= values[node, alpha]
            out[alpha] += share
        for c in range(values.shape[1]):
            if c != alpha:
                out[c] += share * values[node, c]
    return total


@kernel
def interpolate(nodes, known, values, cell, down, across, alpha, out):
    """Interpolate the values of a cell's nodes, of its ghosts those that are `known`.

    Parameters
    ----------
    nodes : (rows, columns) int32
    known : (g,) bool
    values : (rows * columns, c) float32
    cell : int
        Row times columns plus column.
    down, across : float
        The place in the cell.
    alpha : int
        The channel that is opacity: other channels count as much as it says. -1: none.
    out : (c,) array of float
        Zero; the values are added to it.

    Returns
    -------
    float
        The weight of the nodes that are known; `out` stays zero where it is zero.
    """
    total = _add_nodes(nodes, known, values, cell, down, across, alpha, out)
    if total > 0 and alpha >= 0:
        opacity = out[alpha]
        if opacity > 0:
            for c in range(values.shape[1]):
                if c != alpha:
                    out[c] /= opacity
            out[alpha] /= total
            return total
        # Nothing is opaque: the colors count alike.
        out[:] = 0.0
        _add_nodes(nodes, known, values, cell, down, across, -1, out)
    if total > 0:
        for c in range(values.shape[1]):
            out[c] /= total
    return total


@kernel
def turn_direction(turn, color, centre):
    """Turn the direction that the first two channels hold around a centre, in place."""
    p = color[0] - centre
    q = color[1] - centre
    color[0] = centre + turn[0, 0] * p + turn[0, 1] * q
    color[1] = centre + turn[1, 0] * p + turn[1, 1] * q
