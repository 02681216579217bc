# SPDX-License-Identifier: GPL-3.0-or-later
"""Walks in a sheet of texels, in the surface's metric and across seams.

Inside a chart a walk is one on a grid (`core.grid.walk`): texels are nodes, and the flow is
constant in a cell. The shock filter's flow is u = h^-1 dP / 2 with the metric h of a face there;
other flows may be given. A walk that leaves its chart continues where the surface does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel
from ..errors import InvalidSignal
from ..grid.walk import ENDED, UNFINISHED, cell_velocity, ends_at_turn, walk_cells
from ..mesh.triangle_mesh import TriangleMesh
from .atlas import TextureAtlas
from .ghosts import place_beyond
from .metric import apply, store

MOST_SEAMS = 10_000
"""Most seams that a walk crosses; passed to kernels, as compiled code does not read it here."""

_TOUCH = 1e-6  # in texels
_SHORT = 1e-3  # in texels
_MOST_SHORT = 100  # crossings in a row with less than that between them


class SheetFlow(NamedTuple):
    """The flow that a walk on a sheet follows; its parts are those of `core.grid.walk`.

    Attributes
    ----------
    potential : (rows, columns) float32 or None
        None: it is a given flow.
    vectors : (rows - 1, columns - 1, 2) array of float or None
        None: it is the shock flow of the potential.
    faces : (rows - 1, columns - 1) or larger array of int
    metrics : (m, 3) or wider array of float or None
        None for a given flow.
    """

    potential: npt.NDArray[np.float32] | None
    vectors: npt.NDArray | None
    faces: npt.NDArray[np.integer]
    metrics: npt.NDArray | None


def shock_flow(atlas: TextureAtlas, potential: npt.NDArray[np.float32]) -> SheetFlow:
    """Return the shock filter's flow, which walks follow backwards.

    Parameters
    ----------
    atlas : TextureAtlas
    potential : (rows, columns) float32
        P at the nodes; see `texel_potential`.
    """
    return SheetFlow(potential, None, atlas.sheet.cells, atlas.metric.inverse_metrics)


def given_flow(atlas: TextureAtlas, vectors: npt.ArrayLike) -> SheetFlow:
    """Return a given flow on the surface, constant in each face; walks follow it forwards.

    Parameters
    ----------
    atlas : TextureAtlas
    vectors : (m, 3) array of float
        Velocity in space at each face of the mesh, in mean texel sizes; normal components are
        ignored.

    Raises
    ------
    InvalidSignal
        If the vectors do not fit the mesh or are not finite.
    """
    mesh, cells = atlas.mesh, atlas.sheet.cells
    given = np.asarray(vectors, dtype=np.float64)
    if given.shape != (mesh.face_count, 3) or not np.isfinite(given).all():
        raise InvalidSignal(
            f"The vectors have the shape {given.shape} or are not all finite; give"
            f" ({mesh.face_count}, 3) numbers."
        )
    steps = np.einsum("mij,mjk,mk->mi", atlas.metric.inverse_jacobians, face_axes(mesh), given)
    return SheetFlow(None, np.where(cells[..., None] >= 0, steps[cells], 0.0), cells, None)


def face_axes(mesh: TriangleMesh) -> npt.NDArray[np.float64]:
    """Return the axes of the faces' frames: (m, 2, 3), unit vectors in space."""
    along = mesh.scaled_vertices[mesh.faces[:, 1]] - mesh.scaled_vertices[mesh.faces[:, 0]]
    axes = np.stack([along, np.cross(mesh.normals, along)], axis=1)
    return axes / np.maximum(np.linalg.norm(axes, axis=2, keepdims=True), 1e-300)


@kernel
def seam_crossed(nodes, ghost_edges, place, axis):
    """Return the half-edge at which a point on a side of a cell leaves its chart, or -1.

    It is that of the nearest ghost at the side's ends; `axis` is the ending of `walk_cells`.
    """
    row, column, down, across = place
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
def walk_across_seams(
    flow, sheet, metric, walked, most_steps, most_seams, b, rotation, step_rotation
):
    """Continue where `walk_cells` left its chart, over any number of seams.

    Where both sides of a seam flow into it, a walk of the shock filter ends, also if it crosses the
    seam at a slant again and again; one along a given flow moves back and forth within a texel, and
    so along the seam, while time is left. As each chart reads its own texels beside a seam, a walk
    of the shock filter may also come back to the same place over two seams or more; it goes round
    while time is left, and ends there if time is infinite.

    Parameters
    ----------
    flow : SheetFlow
    sheet : Sheet
    metric : AtlasMetric
    walked
        The result of `walk_cells`.
    most_steps, most_seams : int
        Most cells crossed in a row inside a chart, and most seams in all.
    rotation : (2, 2) float64
        Rotation of tangent-space normals from the end of the walk to its start; overwritten.
    b, step_rotation : (3,) and (2, 2) float64
        Working memory.

    Returns
    -------
    place
        Where the walk ends.
    ending : int
        `ENDED` or `UNFINISHED`.
    """
    potential, vectors, inverse_metrics = flow.potential, flow.vectors, flow.metrics
    place, left, vy, vx, ending = walked
    store(rotation, 1.0, 0.0, 0.0, 1.0)
    short = 0
    known_edge, known, known_vy, known_vx = -1, place, vy, vx
    returns = False
    for number in range(most_seams):
        edge = seam_crossed(sheet.nodes, sheet.ghost_edges, place, ending)
        if edge < 0 or metric.ways.twins[edge // 3, edge % 3] < 0:
            return place, ENDED
        # Places are remembered after 1, 2, 4... seams, so that circles of any length are found
        # (Brent 1980).
        if edge == known_edge and place == known and vy == known_vy and vx == known_vx:
            returns = vectors is None
            if returns and left == np.inf:
                return place, ENDED
        if number & (number - 1) == 0:
            known_edge, known, known_vy, known_vx = edge, place, vy, vx
        # Start slightly before the line: if the charts' texels are aligned, the walk crosses it
        # there just as inside a chart.
        speed = abs(vy) + abs(vx)
        row, column, down, across = place
        y = row + down - _TOUCH * vy / speed
        x = column + across - _TOUCH * vx / speed
        face, y, x, cosine, sine = place_beyond(
            sheet.points, metric.ways, metric.shapes, metric.jacobians, sheet.cells, edge, y, x,
            b, step_rotation,
        )  # fmt: skip
        if face < 0:
            return place, ENDED
        u, v = apply(metric.jacobians, edge // 3, vy, vx)
        u, v = cosine * u - sine * v, sine * u + cosine * v
        vy, vx = apply(metric.inverse_jacobians, face, u, v)
        _compose(rotation, step_rotation)
        row = int(y)
        column = int(x)
        place = row, column, y - row, x - column
        _, _, p, q = cell_velocity(
            potential, vectors, sheet.cells, inverse_metrics, row, column, False
        )
        if ends_at_turn(vectors, vy, vx, p, q):
            return place, ENDED
        place, left, vy, vx, ending = walk_cells(
            potential, vectors, sheet.cells, inverse_metrics, left, most_steps, place
        )
        if ending == ENDED or ending == UNFINISHED:
            return place, ending
        row, column, down, across = place
        away = abs(row + down - y) + abs(column + across - x)
        short = short + 1 if away < _SHORT else 0
        if vectors is None and short > _MOST_SHORT:
            return place, ENDED
    return place, ENDED if returns else UNFINISHED


@kernel
def _compose(rotation, step):
    # rotation @ step, in place.
    for row in range(2):
        a = rotation[row, 0]
        c = rotation[row, 1]
        rotation[row, 0] = a * step[0, 0] + c * step[1, 0]
        rotation[row, 1] = a * step[0, 1] + c * step[1, 1]
