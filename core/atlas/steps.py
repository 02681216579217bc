# SPDX-License-Identifier: GPL-3.0-or-later
"""Where one comes by a step along a given flow from each node of a sheet, over seams.

Inside a chart that is arithmetic. Where a step leaves its chart, it is followed once; what lies
around its start lies likewise around its end, as parallel transport takes it there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..base.unfinished import MOST_STEPS
from ..grid.walk import ENDED, UNFINISHED, Field, begin, walk_cells
from ..mesh.triangle_mesh import Ints
from .atlas import TextureAtlas
from .sheet import NOTHING, ROWS
from .walk import MOST_SEAMS, seam_crossed, walk_across_seams

_Singles = npt.NDArray[np.float32]


class StepsBeyond(NamedTuple):
    """Steps that leave their chart.

    Attributes
    ----------
    nodes : (k,) int32
        Row times columns plus column of the nodes at which they begin.
    cells : (k,) int32
        Likewise of the cells in which they end; `NOTHING` where the surface ended before.
    places : (k, 2) float32
        Where in the cells, (down, across).
    matrices : (k, 2, 2) float32
        Take what lies (down, across) of the nodes to what lies so of the ends.
    """

    nodes: Ints
    cells: Ints
    places: _Singles
    matrices: _Singles


def steps_beyond(
    atlas: TextureAtlas, flow: Field, down: _Singles, across: _Singles, reach: float
) -> StepsBeyond:
    """Find the steps that leave their chart, and where they end.

    Parameters
    ----------
    atlas : TextureAtlas
    flow : Field
        What is followed for a time of 1, see `given_flow`.
    down, across : (rows, columns) float32
        The same step at the nodes, straight.
    reach : float
        So far around a step's end, in texels, has to be inside the chart, or a ghost of it.
    """
    sheet, labels = atlas.sheet, atlas.charts.labels
    leaves = np.zeros(sheet.nodes.shape, dtype=np.bool_)
    run(_mark_leaving, len(leaves), sheet, labels, down, across, reach, leaves, chunk=ROWS)
    nodes = np.flatnonzero(leaves).astype(np.int32)
    found = StepsBeyond(
        nodes,
        np.full(len(nodes), NOTHING, dtype=np.int32),
        np.zeros((len(nodes), 2), dtype=np.float32),
        np.zeros((len(nodes), 2, 2), dtype=np.float32),
    )
    run(_step, len(nodes), sheet, atlas.metric, flow, MOST_STEPS, MOST_SEAMS, found)
    return found


@kernel
def _chart(sheet, labels, y, x):
    rows, columns = sheet.nodes.shape
    if not (0 <= y < rows and 0 <= x < columns):
        return NOTHING
    node = sheet.nodes[y, x]
    if node >= 0:
        return labels[node]
    if node == NOTHING or sheet.ghost_edges[-2 - node] < 0:
        return NOTHING
    return labels[sheet.ghost_edges[-2 - node] // 3]


@kernel
def _stays(sheet, labels, y, x, down, across, reach):
    # Whether all of a straight step, and what is around its end, lies in the chart.
    label = labels[sheet.nodes[y, x]]
    parts = int(np.ceil(max(abs(down), abs(across))))
    for part in range(1, parts):
        row = int(np.rint(y + down * part / parts))
        column = int(np.rint(x + across * part / parts))
        if _chart(sheet, labels, row, column) != label or sheet.nodes[row, column] < 0:
            return False
    for row in range(int(np.floor(y + down - reach)), int(np.ceil(y + down + reach)) + 1):
        for column in range(
            int(np.floor(x + across - reach)), int(np.ceil(x + across + reach)) + 1
        ):
            if _chart(sheet, labels, row, column) != label:
                return False
    return True


@kernel
def _mark_leaving(start, stop, sheet, labels, down, across, reach, leaves):
    for y in range(start, stop):
        for x in range(leaves.shape[1]):
            if sheet.nodes[y, x] >= 0:
                leaves[y, x] = not _stays(
                    sheet, labels, y, x, float(down[y, x]), float(across[y, x]), reach
                )


@kernel
def _step(start, stop, sheet, metric, flow, most_steps, most_seams, found):
    columns = sheet.nodes.shape[1]
    cells = sheet.cells
    b = np.empty(3)
    turn, step_turn = np.empty((2, 2)), np.empty((2, 2))
    for i in range(start, stop):
        y, x = divmod(found.nodes[i], columns)
        face = sheet.nodes[y, x]
        for corner in range(4):
            place = begin(y, x, corner)
            if cells[place[0], place[1]] == NOTHING:
                continue
            walked = walk_cells(
                flow.potential, flow.vectors, cells, flow.metrics, 1.0, most_steps, place
            )
            place, _, _, _, ending = walked
            turn[0, 0] = turn[1, 1] = 1.0
            turn[0, 1] = turn[1, 0] = 0.0
            if ending != ENDED and ending != UNFINISHED:
                edge = seam_crossed(sheet.nodes, sheet.ghost_edges, place, ending)
                if edge < 0 or metric.ways.twins[edge // 3, edge % 3] < 0:
                    break
                place, _ = walk_across_seams(
                    flow, sheet, metric, walked, most_steps, most_seams, b, turn, step_turn
                )
            row, column, down, across = place
            end = cells[row, column]
            if end == NOTHING:
                break
            found.cells[i] = row * columns + column
            found.places[i, 0] = down
            found.places[i, 1] = across
            _transport(metric.jacobians, metric.inverse_jacobians, face, end, turn,
                       found.matrices[i])  # fmt: skip
            break


@kernel
def _transport(jacobians, inverse_jacobians, f, g, turn, matrix):
    # Steps in the texture at face f are those of the surface; these are told by the tangent along
    # columns and the normal to it, in which `turn` goes from g to f; and so back in g.
    one, tangent_y, tangent_x = _tangent(jacobians, f)
    two, other_y, other_x = _tangent(jacobians, g)
    for axis in range(2):
        u, v = jacobians[f, 0, axis], jacobians[f, 1, axis]
        along = u * tangent_y + v * tangent_x
        beside = one * (v * tangent_y - u * tangent_x)
        back = turn[0, 0] * along + turn[1, 0] * beside
        aside = two * (turn[0, 1] * along + turn[1, 1] * beside)
        u, v = back * other_y - aside * other_x, back * other_x + aside * other_y
        for k in range(2):
            matrix[k, axis] = inverse_jacobians[g, k, 0] * u + inverse_jacobians[g, k, 1] * v


@kernel
def _tangent(jacobians, f):
    # The unit vector along columns, and -1 where the texture is mirrored.
    u, v = jacobians[f, 0, 1], jacobians[f, 1, 1]
    length = np.sqrt(u * u + v * v)
    if length == 0:
        return 1.0, 1.0, 0.0
    left = u * jacobians[f, 1, 0] - v * jacobians[f, 0, 0] > 0
    return (1.0 if left else -1.0), u / length, v / length
