# SPDX-License-Identifier: GPL-3.0-or-later
"""Walks in a sheet of texels, on the surface's metric and across seams.

Inside a chart a walk is one on a grid (`core.grid.walk`): texels are nodes, and the flow is
constant in a cell. The shock filter's flow is u = h^-1 dP / 2 with the metric h of a face there;
other fields may be given. A walk that leaves its chart goes on where the surface does.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.checks import BAND
from ..base.parallel import blocks, kernel
from ..errors import InvalidSignal
from ..grid.walk import ENDED, UNFINISHED, Field, turns_back, velocity, walk
from .atlas import TextureAtlas
from .ghosts import place_beyond
from .metric import apply

MOST_SEAMS = 10_000
"""Seams that a walk may cross; handed to the kernels, as compiled code does not look it up."""

_TOUCH = 1e-6  # in texels


def shock_flow(atlas: TextureAtlas, potential: npt.NDArray[np.float32]) -> Field:
    """Return the flow of the shock filter, which walks follow backwards.

    Parameters
    ----------
    atlas : TextureAtlas
    potential : (rows, columns) float32
        P at the nodes; see `texel_potential`.
    """
    return Field(potential, faces=atlas.sheet.cells, metrics=atlas.metric.inverse_metrics)


def given_flow(atlas: TextureAtlas, vectors: npt.ArrayLike) -> Field:
    """Return a flow that is given on the surface, constant in each face.

    Parameters
    ----------
    atlas : TextureAtlas
    vectors : (m, 3) array of float
        Velocity in space at each face of the mesh, in mean texel sizes; what points out of the
        face is left out. Walks follow it: to carry values along, give its opposite.

    Raises
    ------
    InvalidSignal
        If the vectors do not fit the mesh or are not finite.
    """
    given = np.asarray(vectors, dtype=np.float64)
    if given.shape != (atlas.mesh.face_count, 3) or not np.isfinite(given).all():
        raise InvalidSignal(
            f"The vectors have the shape {given.shape} or are not all finite; give"
            f" ({atlas.mesh.face_count}, 3) numbers."
        )
    steps = np.einsum("mij,mj->mi", atlas.metric.inverse_jacobians, _in_frames(atlas, given))
    cells = np.zeros((*atlas.sheet.cells.shape, 2))
    for rows in blocks(len(cells), BAND):
        faces = atlas.sheet.cells[rows]
        cells[rows] = np.where(faces[..., None] >= 0, steps[faces], 0.0)
    return Field(vectors=cells, faces=atlas.sheet.cells)


def _in_frames(atlas: TextureAtlas, vectors: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    # Components in the faces' frames, of which the first axis runs along the first edge: (m, 2).
    a, b, c = np.moveaxis(atlas.mesh.scaled_vertices[atlas.mesh.faces], 1, 0)
    normals = np.cross(b - a, c - a)
    axes = np.stack([b - a, np.cross(normals, b - a)], axis=1)
    lengths = np.linalg.norm(axes, axis=2, keepdims=True)
    axes = np.divide(axes, lengths, out=np.zeros_like(axes), where=lengths > 0)
    return np.einsum("mij,mj->mi", axes, vectors)


@kernel
def _seam(nodes, ghost_edges, row, column, down, across, axis):
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
    return ghost_edges[-2 - node] if node < -1 else -1


@kernel
def _cross_seam(sheet, metric, edge, y, x, vy, vx, b, turn):
    # Over a seam: (face or -1, row, column) on the other side, and the velocity (vy, vx) there.
    face, row, column, cosine, sine = place_beyond(
        sheet.points, metric.twins, metric.shapes, metric.jacobians, sheet.cells, edge, y, x, b,
        turn,
    )  # fmt: skip
    if face < 0:
        return -1, row, column, vy, vx
    u, v = apply(metric.jacobians, edge // 3, vy, vx)
    u, v = cosine * u - sine * v, sine * u + cosine * v
    vy, vx = apply(metric.inverse_jacobians, face, u, v)
    return face, row, column, vy, vx


@kernel
def walk_across_seams(
    field, sheet, metric, left, most_steps, most_seams, row, column, down, across, vy, vx, ending,
    b, turn, step_turn,
):  # fmt: skip
    """Go on where `walk` left its chart, over as many seams as it takes.

    Where both sides of a seam flow into it, a walk of the shock filter ends; one along a given
    field goes to and fro within a texel, and so along the seam, while time is left.

    Parameters
    ----------
    field : Field
    sheet : Sheet
    metric : AtlasMetric
    left, row, column, down, across, vy, vx, ending
        What `walk` returned.
    most_steps, most_seams : int
        Cells that may be crossed in a row inside a chart, and seams in all.
    turn : (2, 2) float64
        What turns tangent-space normals from where the walk ends to where it began; overwritten.
    b, step_turn : (3,) and (2, 2) float64
        Scratch.

    Returns
    -------
    row, column, down, across
        Where the walk ends.
    ending : int
        `ENDED` or `UNFINISHED`.
    """
    turn[0, 0] = turn[1, 1] = 1.0
    turn[0, 1] = turn[1, 0] = 0.0
    for _ in range(most_seams):
        edge = _seam(sheet.nodes, sheet.ghost_edges, row, column, down, across, ending)
        if edge < 0 or metric.twins[edge // 3, edge % 3] < 0:
            return row, column, down, across, ENDED
        # A touch before the line: should the charts' texels line up, the walk crosses it there
        # as it would have done here.
        speed = abs(vy) + abs(vx)
        y = row + down - _TOUCH * vy / speed
        x = column + across - _TOUCH * vx / speed
        face, y, x, vy, vx = _cross_seam(sheet, metric, edge, y, x, vy, vx, b, step_turn)
        if face < 0:
            return row, column, down, across, ENDED
        _join_turns(turn, step_turn)
        row = int(y)
        column = int(x)
        down = y - row
        across = x - column
        _, _, p, q = velocity(field, row, column, False)
        if turns_back(field, vy, vx, p, q):
            return row, column, down, across, ENDED
        row, column, down, across, left, vy, vx, ending = walk(
            field, left, most_steps, row, column, down, across
        )
        if ending == ENDED or ending == UNFINISHED:
            return row, column, down, across, ending
    return row, column, down, across, UNFINISHED


@kernel
def _join_turns(turn, step):
    # turn times step, in place.
    for row in range(2):
        a = turn[row, 0]
        c = turn[row, 1]
        turn[row, 0] = a * step[0, 0] + c * step[1, 0]
        turn[row, 1] = a * step[0, 1] + c * step[1, 1]
