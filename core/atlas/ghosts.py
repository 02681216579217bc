# SPDX-License-Identifier: GPL-3.0-or-later
"""Ghosts: nodes around each chart that hold the values beyond its seams.

The value of a ghost is that of the surface at the end of a straight walk from the nearest edge of
the chart to the ghost's texel. It is interpolated linearly there, which may need other ghosts in
turn: a few rounds settle them; the first one uses no ghosts. Beyond a closed seam (see
`core.atlas.seams`) it is the chart's own value on that edge.
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
_MOST_TEXELS = 4.0  # longest step over a seam, in texels beyond the seam


class GhostSources(NamedTuple):
    """Where the values of ghosts are interpolated.

    Attributes
    ----------
    cells : (g,) int32
        Row times columns plus column of the cell, or -1 if the surface ends there.
    places : (g, 2) float32
        The point in the cell, (down, across).
    rotations : (g, 2, 2) float32
        Rotation of tangent-space normals from the source to the ghost.
    """

    cells: Ints
    places: npt.NDArray[np.float32]
    rotations: npt.NDArray[np.float32]


class TakenCells(NamedTuple):
    """Cells removed from a sheet: row times columns plus column, and the faces they held."""

    numbers: npt.NDArray[np.int64]
    faces: Ints


def find_sources(sheet: Sheet, metric: AtlasMetric) -> tuple[GhostSources, TakenCells]:
    """Find the sources of a sheet's ghosts; removes the cells at ghosts without a source."""
    count = len(sheet.ghosts)
    rows, columns = np.divmod(sheet.ghosts.astype(np.int64), sheet.nodes.shape[1])
    places = np.stack([rows, columns], axis=1).astype(np.float64)
    sources = GhostSources(
        np.full(count, -1, dtype=np.int32),
        np.zeros((count, 2), dtype=np.float32),
        np.zeros((count, 2, 2), dtype=np.float32),
    )
    run(_find, count, places, sheet, metric, sources)
    # Ghosts that read only one another would keep what the image holds beside the charts.
    values = np.zeros((*sheet.nodes.shape, 1), dtype=np.float32)
    known = fill_ghosts(sheet, sources, values)
    sources.cells[~known] = -1
    y, x = np.divmod(sheet.ghosts[sources.cells < 0].astype(np.int64), sheet.nodes.shape[1])
    corners = y[:, None] - [0, 0, 1, 1], x[:, None] - [0, 1, 0, 1]
    # The sheet's last row and column of cells are empty, so that index -1 is valid.
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
    """Interpolate the ghosts' values across the seams, in place.

    Parameters
    ----------
    values : (rows, columns, c) float32
        Values of the nodes.
    alpha : int
        The opacity channel, which weights the others. -1: none.
    directions : float, optional
        The first two channels are tangent-space directions around this value; they are rotated.

    Returns
    -------
    (g,) bool
        Ghosts that received a value.
    """
    flat = values.reshape(-1, values.shape[-1])
    found = np.empty((len(sheet.ghosts), values.shape[-1]), dtype=np.float32)
    rotates = directions is not None
    centre = np.float32(directions or 0.0)
    known = np.zeros(len(sheet.ghosts), dtype=np.bool_)
    for _ in range(_ROUNDS):
        known_next = np.zeros_like(known)
        run(_read_ghosts, len(sheet.ghosts), sheet.nodes, sources, flat, alpha, rotates, centre,
            known, found, known_next)  # fmt: skip
        known = known_next
        flat[sheet.ghosts[known]] = found[known]
    return known


class GhostReads(NamedTuple):
    """What ghosts read, round by round: all of them first, then those that read ghosts.

    Attributes
    ----------
    ghosts : (n,) int32
        Row times columns plus column of the ghosts that receive a value.
    corners : (n, 4) int32
        The same index for the four nodes that each ghost reads.
    weights : (n, 4) float64
    totals : (n,) float64
        The sums of the weights.
    rounds : (_ROUNDS + 1,) int64
        Where the ghosts of each round begin in these arrays, and where the last round ends.
    """

    ghosts: Ints
    corners: Ints
    weights: npt.NDArray[np.float64]
    totals: npt.NDArray[np.float64]
    rounds: npt.NDArray[np.int64]


def find_reads(sheet: Sheet, sources: GhostSources) -> GhostReads:
    """Prepare `fill_planes`."""
    which = np.flatnonzero(sources.cells >= 0).astype(np.int32)
    known = np.zeros(len(sheet.ghosts), dtype=np.bool_)
    found = []
    for number in range(_ROUNDS):
        corners = np.empty((len(which), 4), dtype=np.int32)
        weights = np.empty((len(which), 4))
        run(_find_reads, len(which), which, sheet.nodes, sources, known, corners, weights)
        totals = weights.sum(axis=1)
        at = totals > 0
        known = known.copy()
        known[which[at]] = True
        found.append((sheet.ghosts[which[at]], corners[at], weights[at], totals[at]))
        if number == 0:
            chained = np.zeros(len(known), dtype=np.bool_)
            run(_find_chained, len(chained), sheet.nodes, sources.cells, chained)
            which = np.flatnonzero(chained).astype(np.int32)
    rounds = np.cumsum([0, *(len(each[0]) for each in found)], dtype=np.int64)
    ghosts, corners, weights, totals = map(np.concatenate, zip(*found, strict=True))
    return GhostReads(ghosts, corners, weights, totals, rounds)


def fill_planes(reads: GhostReads, planes: npt.NDArray[np.float32]) -> None:
    """Fill ghosts as `fill_ghosts`, but for separate planes: (k, rows, columns)."""
    run(_fill_planes, len(planes), reads, planes, chunk=1)


def nearest_nodes(sheet: Sheet, sources: GhostSources) -> Ints:
    """Return the node inside a chart nearest to each node or ghost: (rows * columns,).

    `NOTHING` where there is none; for a ghost it is the node nearest to its source.
    """
    nodes = sheet.nodes.reshape(-1)
    found = np.where(nodes >= 0, np.arange(len(nodes), dtype=np.int32), np.int32(NOTHING))
    found[sheet.ghosts] = nearest_in_cells(sheet, found, sources.cells, sources.places)
    return found


def nearest_in_cells(
    sheet: Sheet, nearest: Ints, cells: Ints, places: npt.NDArray[np.float32]
) -> Ints:
    """Return the value of `nearest` at the nearest corner of each cell that counts.

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
        Ghosts that received a value.
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
    # The mean over all directions with two known nodes in a row; if there are none, with one.
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
            sources.rotations[i],
        )  # fmt: skip
        if face < 0:
            share, _ = nearest_on_edge(points, edge, places[i, 0], places[i, 1])
            if not is_closed(ways, edge, share):
                continue
            row, column = place_on_edge(points, edge, share)
            store(sources.rotations[i], 1.0, 0.0, 0.0, 1.0)
        sources.cells[i] = int(row) * cells.shape[1] + int(column)
        sources.places[i, 0] = row - int(row)
        sources.places[i, 1] = column - int(column)


@kernel
def place_beyond(points, ways, shapes, jacobians, cells, edge, y, x, b, rotation):
    """Call `walk_beyond`, for walks that end in a cell of a chart.

    Parameters
    ----------
    cells : (rows, columns) int32
        See `Sheet`.

    Returns
    -------
    face, row, column, cosine, sine
        As in `walk_beyond`; `face` is -1 also if no chart has a cell there.
    """
    g, row, column, cosine, sine = walk_beyond(
        points, ways, shapes, jacobians, edge, y, x, b, rotation
    )
    if g < 0 or cells[int(row), int(column)] == NOTHING:
        return -1, 0.0, 0.0, 1.0, 0.0
    return g, row, column, cosine, sine


@kernel
def walk_beyond(points, ways, shapes, jacobians, edge, y, x, b, rotation):
    """Walk on the surface beyond a half-edge, from its point nearest to (y, x) to (y, x).

    Parameters
    ----------
    edge : int
        A half-edge on the outline of a chart.
    y, x : float
        A place in the sheet, outside of that chart.
    b : (3,) float64
        Barycentric coordinates of the end; overwritten.
    rotation : (2, 2) float
        Rotation of tangent-space normals from the end to the half-edge's face; overwritten.

    Returns
    -------
    face : int
        The face in which the walk ends, or -1 if the surface ends at the half-edge.
    row, column : float
        The end, in the sheet.
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
    _normal_rotation(jacobians, edge // 3, g, cosine, sine, rotation)
    return g, row, column, cosine, sine


@kernel
def _shorter(twins, jacobians, edge, dy, dx):
    # The factor of a step over a half-edge: where one texel covers many beyond the seam, for
    # example beside slivers in the texture, the step must not skip the texels at the seam.
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
def _normal_rotation(jacobians, f, g, cosine, sine, rotation):
    # The rotation of a tangent-space normal from face g to face f. Tangents point along columns:
    # that of f is transported to g and compared with that of g.
    tx, ty = jacobians[f, 0, 1], jacobians[f, 1, 1]
    sx, sy = jacobians[g, 0, 1], jacobians[g, 1, 1]
    length = np.sqrt((tx * tx + ty * ty) * (sx * sx + sy * sy))
    if length == 0:
        store(rotation, 1.0, 0.0, 0.0, 1.0)
        return
    tx, ty = cosine * tx - sine * ty, sine * tx + cosine * ty
    c = (tx * sx + ty * sy) / length
    s = (sx * ty - sy * tx) / length
    # The second axis points along rows: to the left of the first one, unless mirrored.
    one = 1.0 if _left(jacobians, f) else -1.0
    two = 1.0 if _left(jacobians, g) else -1.0
    # To g: [[c, -s one], [two s, two c one]]; the way back is the transposed matrix.
    store(rotation, c, two * s, -s * one, two * c * one)


@kernel
def _left(jacobians, f):
    return jacobians[f, 0, 1] * jacobians[f, 1, 0] - jacobians[f, 1, 1] * jacobians[f, 0, 0] > 0


@kernel
def _read_ghosts(
    start, stop, nodes, sources, values, alpha, rotates, centre, known, found, known_now
):
    cells, places, rotations = sources
    for i in range(start, stop):
        found[i] = 0.0
        if cells[i] < 0:
            continue
        down, across = places[i]
        total = interpolate(nodes, known, values, cells[i], down, across, alpha, found[i])
        if total <= 0:
            continue
        known_now[i] = True
        if rotates:
            turn_direction(rotations[i], found[i], centre)


@kernel
def _find_chained(start, stop, nodes, cells, chained):
    flat = nodes.reshape(-1)
    for i in range(start, stop):
        if cells[i] >= 0:
            for corner in range(4):
                if flat[cells[i] + (corner >> 1) * nodes.shape[1] + (corner & 1)] < NOTHING:
                    chained[i] = True


@kernel
def _find_reads(start, stop, which, nodes, sources, known, corners, weights):
    # As `_add_nodes`; unused nodes have the weight 0 and the place of a used one.
    flat, columns = nodes.reshape(-1), nodes.shape[1]
    cells, places, _ = sources
    for n in range(start, stop):
        i = which[n]
        down, across = places[i]
        used = cells[i]
        for corner in range(4):
            node = cells[i] + (corner >> 1) * columns + (corner & 1)
            corners[n, corner] = node
            ghost = -2 - flat[node]
            weights[n, corner] = 0.0
            if ghost == -1 or (ghost >= 0 and not known[ghost]):
                corners[n, corner] = -1
                continue
            weight = down if corner >> 1 else 1.0 - down
            weights[n, corner] = weight * (across if corner & 1 else 1.0 - across)
            used = node
        for corner in range(4):
            if corners[n, corner] < 0:
                corners[n, corner] = used


@kernel
def _fill_planes(start, stop, reads, planes):
    ghosts, corners, weights, totals, rounds = reads
    found = np.empty(len(ghosts), np.float32)
    for k in range(start, stop):
        values = planes[k].reshape(-1)
        for number in range(len(rounds) - 1):
            for n in range(rounds[number], rounds[number + 1]):
                value = np.float32(0)
                for corner in range(4):
                    share = weights[n, corner] * values[corners[n, corner]]
                    value = np.float32(value + share)
                found[n] = value / totals[n]
            for n in range(rounds[number], rounds[number + 1]):
                values[ghosts[n]] = found[n]


@kernel
def _add_nodes(nodes, known, values, cell, down, across, alpha, out):
    # Adds up the weighted sums that `interpolate` divides; returns the total weight.
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
    """Interpolate the values of a cell's nodes; of its ghosts, only those that are `known`.

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
        The opacity channel, which weights the others. -1: none.
    out : (c,) array of float
        The values are added to it; must be zero before.

    Returns
    -------
    float
        The weight of the known nodes; if it is zero, `out` stays zero.
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
        # All nodes are transparent: colors have equal weights.
        out[:] = 0.0
        _add_nodes(nodes, known, values, cell, down, across, -1, out)
    if total > 0:
        for c in range(values.shape[1]):
            out[c] /= total
    return total


@kernel
def turn_direction(rotation, color, centre):
    """Rotate the direction stored in the first two channels around a centre, in place."""
    p = color[0] - centre
    q = color[1] - centre
    color[0] = centre + rotation[0, 0] * p + rotation[0, 1] * q
    color[1] = centre + rotation[1, 0] * p + rotation[1, 1] * q
