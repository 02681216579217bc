# SPDX-License-Identifier: GPL-3.0-or-later
"""Advection in a sheet of texels: values are sampled where the flow-lines come from."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..base.unfinished import MOST_STEPS, warn_of_unfinished
from ..grid.advect import split_time
from ..grid.channels import Channels
from ..grid.sample import add_value
from ..grid.walk import ENDED, UNFINISHED, begin, walk_cells
from .atlas import TextureAtlas
from .ghosts import turn_direction
from .sheet import NOTHING
from .walk import MOST_SEAMS, SheetFlow, walk_across_seams

_ROWS = 8


def advect_texels(
    atlas: TextureAtlas,
    values: npt.NDArray[np.float32],
    channels: Channels,
    flow: SheetFlow,
    time: float | npt.NDArray[np.float32],
    out: npt.NDArray[np.float32],
    *,
    nearest: bool = False,
    normals: bool = False,
) -> None:
    """Sample the values at the ends of flow-lines, like `core.grid.advect.advect_pixels`.

    Parameters
    ----------
    atlas : TextureAtlas
    values : (rows, columns, c) float32
        Values of nodes and ghosts.
    channels : Channels
        Only these channels of `out` are written.
    flow : SheetFlow
        See `shock_flow` and `given_flow`.
    time : float or (rows, columns) float32
        How long flow-lines are followed, from all nodes or from each. For a given flow, whose
        flow-lines may be closed, one finite number.
    out : (rows, columns, c) float32
        Receives the channels' values at nodes inside charts.
    nearest : bool
        Take the nearest node's value at the ends instead of interpolating linearly.
    normals : bool
        The first two channels are tangent-space directions around 1/2; they rotate with the
        charts that flow-lines come from.
    """
    same, times = split_time(time)
    if flow.vectors is not None and not (math.isfinite(same) and times.size == 0):
        raise ValueError(f"time is {time}; give a finite one, as flow-lines may be closed.")
    nodes, copies = atlas.sheet.nodes, atlas.copies
    skipped = np.zeros(nodes.shape, dtype=np.bool_)
    skipped.reshape(-1)[copies[:, 0]] = True
    unfinished = np.zeros(len(nodes), dtype=np.int64)
    run(_advect, len(nodes), skipped, atlas.sheet, atlas.metric, flow, same, times, MOST_STEPS,
        MOST_SEAMS, values, channels, nearest, normals, out, unfinished,
        chunk=_ROWS)  # fmt: skip
    warn_of_unfinished(unfinished)
    chosen = slice(channels.start, channels.stop)
    flat = out.reshape(skipped.size, -1)
    flat[copies[:, 0], chosen] = flat[copies[:, 1], chosen]


@kernel
def _advect(
    start, stop, skipped, sheet, metric, flow, time, times, most_steps, most_seams, values,
    channels, nearest, normals, out, unfinished,
):  # fmt: skip
    nodes, cells = sheet.nodes, sheet.cells
    potential, vectors, inverse_metrics = flow.potential, flow.vectors, flow.metrics
    total = np.empty(values.shape[2])
    sample = np.empty(values.shape[2])
    b = np.empty(3)
    rotation = np.empty((2, 2))
    step_rotation = np.empty((2, 2))
    for y in range(start, stop):
        for x in range(nodes.shape[1]):
            if nodes[y, x] < 0 or skipped[y, x]:
                continue
            total[:] = 0.0
            weight = 0.0
            if times.size > 0:
                time = float(times[y, x])
            for corner in range(4):
                place = begin(y, x, corner)
                if cells[place[0], place[1]] == NOTHING:
                    continue
                walked = walk_cells(
                    potential, vectors, cells, inverse_metrics, time, most_steps, place
                )
                place, _, _, _, ending = walked
                crosses = ending != ENDED and ending != UNFINISHED
                if crosses:
                    place, ending = walk_across_seams(
                        flow,
                        sheet,
                        metric,
                        walked,
                        most_steps,
                        most_seams,
                        b,
                        rotation,
                        step_rotation,
                    )
                unfinished[y] += ending == UNFINISHED
                if crosses and normals:
                    sample[:] = 0.0
                    part = add_value(values, channels, place, nearest, sample)
                    turn_direction(rotation, sample, 0.5 * part)
                    total += sample
                    weight += part
                else:
                    weight += add_value(values, channels, place, nearest, total)
            for c in range(channels.start, channels.stop):
                out[y, x, c] = total[c] / weight if weight > 0 else values[y, x, c]
