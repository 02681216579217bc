# SPDX-License-Identifier: GPL-3.0-or-later
"""The potential in a sheet of texels, in the metric of the surface.

The scheme is that of images (`core.grid`): texels are vertices of a mesh of squares, gradients are
constant in a cell, and lengths are measured by the metric of a face in the cell.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..base.progress import phase
from ..grid.channels import Channels
from .atlas import TextureAtlas
from .ghosts import fill_ghosts
from .sheet import NOTHING, ROWS


def texel_potential(
    atlas: TextureAtlas,
    values: npt.NDArray[np.float32],
    channels: Channels,
    passes: int,
    *,
    normals: bool = False,
) -> npt.NDArray[np.float32]:
    """Compute P = sum over channels of the squared gradient, smoothed before and after.

    Parameters
    ----------
    atlas : TextureAtlas
    values : (rows, columns, c) float32
        Values of nodes and ghosts, in [0, 1].
    channels : Channels
        As for images.
    passes : int
        Smoothing passes on the signal and on P.
    normals : bool
        The first two channels are tangent-space directions around 1/2; they rotate across seams.

    Returns
    -------
    (rows, columns) float32
    """
    guides = 1 if channels.brightness.size else channels.stop - channels.start
    together = guides if normals else 1  # directions rotate together; else one channel at a time
    energy = np.zeros(atlas.sheet.nodes.shape, dtype=np.float32)
    signal = np.zeros((*energy.shape, together), dtype=np.float32)
    centre = np.float32(0.5 if normals else 0.0)
    share = 1.0 / (guides + together)
    for guide in range(0, guides, together):
        with phase(share * guide, share * (guide + together), "Computing the flow"):
            run(_take_guides, len(values), values, channels.start + guide, channels.alpha,
                channels.brightness, centre, signal, chunk=ROWS)  # fmt: skip
            signal = smooth_texels(atlas, signal, passes, 0.0 if normals else None)
            run(_add_energy, len(values) - 1, atlas.sheet.cells, atlas.metric.inverse_metrics,
                signal, energy, chunk=ROWS)  # fmt: skip
    with phase(share * guides, 1.0, "Computing the flow"):
        if normals:
            signal = np.zeros((*energy.shape, 1), dtype=np.float32)
        run(_average_energy, len(values), atlas.sheet.nodes, atlas.sheet.cells,
            atlas.metric.texel_areas, energy, signal[..., 0], chunk=ROWS)  # fmt: skip
        fill_ghosts(atlas.sheet, atlas.sources, signal)
        return smooth_texels(atlas, signal, passes)[..., 0]


def smooth_texels(
    atlas: TextureAtlas,
    values: npt.NDArray[np.float32],
    passes: int,
    directions: float | None = None,
) -> npt.NDArray[np.float32]:
    """Smooth values of nodes and ghosts, across seams: (rows, columns, c), overwritten.

    Parameters
    ----------
    directions : float, optional
        As in `fill_ghosts`.
    """
    spare = np.zeros_like(values)
    for _ in range(passes):
        run(_smooth_rows, len(values), atlas.sheet.nodes, atlas.sources.cells,
            atlas.metric.neighbour_weights, values, spare, chunk=ROWS)  # fmt: skip
        fill_ghosts(atlas.sheet, atlas.sources, spare, directions=directions)
        values, spare = spare, values
    return values


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
def _smooth_rows(start, stop, nodes, sources, weights, values, out):
    for y in range(start, stop):
        for x in range(nodes.shape[1]):
            face = nodes[y, x]
            if face < 0:
                continue
            # Inner nodes are never at the sheet's rim.
            down = weights[face, 0]
            across = weights[face, 1]
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
def _add_energy(start, stop, cells, inverse, signal, energy):
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
                    inverse[face, 0] * down * down
                    + np.float32(2.0) * inverse[face, 1] * down * across
                    + inverse[face, 2] * across * across
                )


@kernel
def _average_energy(start, stop, nodes, cells, areas, energy, potential):
    # At a node, the mean over the cells around it, weighted by their areas.
    for y in range(start, stop):
        for x in range(cells.shape[1]):
            if nodes[y, x] < 0:
                continue
            total = np.float32(0.0)
            area = np.float32(0.0)
            for dy in range(2):
                for dx in range(2):
                    face = cells[y - dy, x - dx]
                    if face != NOTHING:
                        total += areas[face] * energy[y - dy, x - dx]
                        area += areas[face]
            value = total / area if area > 0 else np.float32(0.0)
            potential[y, x] = value if abs(value) < np.float32(1e30) else np.float32(1e30)
