# SPDX-License-Identifier: GPL-3.0-or-later
"""Steps along a given flow from each node of a sheet, across seams: where they end.

Inside a chart that is arithmetic. A step that leaves its chart is walked once; the surroundings of
its start are mapped to those of its end by parallel transport.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..base.unfinished import MOST_STEPS
from ..grid.walk import ENDED, UNFINISHED, begin, walk_cells
from ..mesh.triangle_mesh import Ints
from .atlas import TextureAtlas
from .ghosts import chart_of, nearest_nodes
from .sheet import NOTHING, ROWS
from .walk import MOST_SEAMS, SheetFlow, seam_crossed, walk_across_seams

_Singles = npt.NDArray[np.float32]


class StepsBeyond(NamedTuple):
    """Steps that leave their chart, and where they come from.

    Attributes
    ----------
    nodes : (k,) int32
        Row times columns plus column of the nodes at which they end.
    sources : (k, 4) int32
        The nodes inside charts where the step starts if it is rounded to whole texels: up in both
        axes; down across; down in the first axis; down in both. `NOTHING` where the surface
        begins later.
    """

    nodes: Ints
    sources: Ints


def steps_beyond(
    atlas: TextureAtlas, flow: SheetFlow, down: _Singles, across: _Singles
) -> StepsBeyond:
    """Find the sources of steps that cross seams.

    Parameters
    ----------
    atlas : TextureAtlas
    flow : SheetFlow
        The flow, followed backwards for a time of 1, from the end of a step to its source; see
        `given_flow`.
    down, across : (rows, columns) float32
        The straight step to each node.
    """
    sheet, labels = atlas.sheet, atlas.charts.labels
    nearest = nearest_nodes(sheet, atlas.sources)
    leaves = np.zeros(sheet.nodes.shape, dtype=np.bool_)
    run(_mark_leaving, len(leaves), sheet, labels, nearest, down, across, leaves, chunk=ROWS)
    nodes = np.flatnonzero(leaves).astype(np.int32)
    sources = np.full((len(nodes), 4), NOTHING, dtype=np.int32)
    run(_follow_back, len(nodes), sheet, labels, atlas.metric, flow, MOST_STEPS, MOST_SEAMS,
        nearest, down, across, nodes, sources)  # fmt: skip
    return StepsBeyond(nodes, sources)


@kernel
def _chart(sheet, labels, y, x):
    rows, columns = sheet.nodes.shape
    if not (0 <= y < rows and 0 <= x < columns):
        return NOTHING
    return chart_of(sheet, labels, y, x)


@kernel
def _stays(sheet, labels, nearest, y, x, down, across):
    # Whether a straight step from a node stays in the chart, and the nodes around its end have
    # values.
    label = labels[sheet.nodes[y, x]]
    parts = int(np.ceil(max(abs(down), abs(across))))
    for part in range(1, parts):
        row = int(np.rint(y + down * part / parts))
        column = int(np.rint(x + across * part / parts))
        if _chart(sheet, labels, row, column) != label or sheet.nodes[row, column] < 0:
            return False
    for row in range(y + int(np.floor(down)), y + int(np.ceil(down)) + 1):
        for column in range(x + int(np.floor(across)), x + int(np.ceil(across)) + 1):
            if _chart(sheet, labels, row, column) != label:
                return False
            if nearest[row * sheet.nodes.shape[1] + column] == NOTHING:
                return False
    return True


@kernel
def _mark_leaving(start, stop, sheet, labels, nearest, down, across, leaves):
    for y in range(start, stop):
        for x in range(leaves.shape[1]):
            if sheet.nodes[y, x] >= 0:
                leaves[y, x] = not _stays(
                    sheet, labels, nearest, y, x, -float(down[y, x]), -float(across[y, x])
                )


@kernel
def _follow_back(
    start, stop, sheet, labels, metric, flow, most_steps, most_seams, nearest, down, across, nodes,
    sources,
):  # fmt: skip
    # The flow is followed once. Steps in whole texels differ from it by less than a texel, and
    # this difference is mapped to the place where the flow comes from.
    columns = sheet.nodes.shape[1]
    b = np.empty(3)
    rotation, step_rotation, matrix = np.empty((2, 2)), np.empty((2, 2)), np.empty((2, 2))
    for i in range(start, stop):
        y, x = divmod(nodes[i], columns)
        end, row, column = _walk_back(
            sheet, metric, flow, most_steps, most_seams, y, x, b, rotation, step_rotation
        )
        if end >= 0:
            _transport(
                metric.jacobians, metric.inverse_jacobians, sheet.nodes[y, x], end, rotation, matrix
            )
        step, aside = float(down[y, x]), float(across[y, x])
        for k in range(4):
            whole_down = np.floor(step) + 1 - (k >> 1)
            whole_across = np.floor(aside) + 1 - (k & 1)
            if _stays(sheet, labels, nearest, y, x, -whole_down, -whole_across):
                there = (y - int(whole_down)) * columns + x - int(whole_across)
                sources[i, k] = nearest[there]
            elif end >= 0:
                p, q = step - whole_down, aside - whole_across
                source = _nearest(
                    sheet.nodes, nearest,
                    row + matrix[0, 0] * p + matrix[0, 1] * q,
                    column + matrix[1, 0] * p + matrix[1, 1] * q,
                )  # fmt: skip
                if source == NOTHING:  # beside the border of the surface
                    source = _nearest(sheet.nodes, nearest, row, column)
                sources[i, k] = source


@kernel
def _walk_back(sheet, metric, flow, most_steps, most_seams, y, x, b, rotation, step_rotation):
    # The face in which the walk from a node ends, -1 if the surface ends before, and the place.
    cells = sheet.cells
    for corner in range(4):
        place = begin(y, x, corner)
        if cells[place[0], place[1]] == NOTHING:
            continue
        walked = walk_cells(
            flow.potential, flow.vectors, cells, flow.metrics, 1.0, most_steps, place
        )
        place, _, _, _, ending = walked
        rotation[0, 0] = rotation[1, 1] = 1.0
        rotation[0, 1] = rotation[1, 0] = 0.0
        if ending != ENDED and ending != UNFINISHED:
            edge = seam_crossed(sheet.nodes, sheet.ghost_edges, place, ending)
            if edge < 0 or metric.ways.twins[edge // 3, edge % 3] < 0:
                break
            place, _ = walk_across_seams(
                flow, sheet, metric, walked, most_steps, most_seams, b, rotation, step_rotation
            )
        row, column, down, across = place
        return cells[row, column], row + down, column + across
    return -1, 0.0, 0.0


@kernel
def _nearest(nodes, nearest, row, column):
    # The nearest of the four nodes around a place that have a value.
    rows, columns = nodes.shape
    best, least = NOTHING, 8.0
    for k in range(4):
        y = int(np.floor(row)) + (k >> 1)
        x = int(np.floor(column)) + (k & 1)
        if 0 <= y < rows and 0 <= x < columns and nearest[y * columns + x] != NOTHING:
            square = (row - y) ** 2 + (column - x) ** 2
            if square < least:
                best, least = nearest[y * columns + x], square
    return best


@kernel
def _transport(jacobians, inverse_jacobians, f, g, rotation, matrix):
    # Maps steps in texels at face f to steps at face g: on the surface at f, in components along
    # the tangent of columns and its normal, by `rotation`, which maps g to f, to those at g.
    one, tangent_y, tangent_x = _tangent(jacobians, f)
    two, other_y, other_x = _tangent(jacobians, g)
    for axis in range(2):
        u, v = jacobians[f, 0, axis], jacobians[f, 1, axis]
        along = u * tangent_y + v * tangent_x
        beside = one * (v * tangent_y - u * tangent_x)
        back = rotation[0, 0] * along + rotation[1, 0] * beside
        aside = two * (rotation[0, 1] * along + rotation[1, 1] * beside)
        u, v = back * other_y - aside * other_x, back * other_x + aside * other_y
        for k in range(2):
            matrix[k, axis] = inverse_jacobians[g, k, 0] * u + inverse_jacobians[g, k, 1] * v


@kernel
def _tangent(jacobians, f):
    # The unit vector along columns, after a sign that is -1 if the texture is mirrored.
    u, v = jacobians[f, 0, 1], jacobians[f, 1, 1]
    length = np.sqrt(u * u + v * v)
    if length == 0:
        return 1.0, 1.0, 0.0
    left = u * jacobians[f, 1, 0] - v * jacobians[f, 0, 0] > 0
    return (1.0 if left else -1.0), u / length, v / length
