# SPDX-License-Identifier: GPL-3.0-or-later
"""Weighted means over the texels of an atlas, across seams: `grid_smoothing` on patches."""

from __future__ import annotations

import logging
import math

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..atlas.ghosts import turn_direction
from ..atlas.patches import cut_tiles, lay_patch, next_chart, stretch_around, surface_of
from ..base.parallel import kernel, run
from ..grid.geodesics import MEASURED, MOST_SPLITS
from ..settings import BeltramiTextureSettings
from .grid_smoothing import FASTEST, REACHED, smooth_rows

log = logging.getLogger(__name__)

_TIMES = 3.0
"""A kernel reaches at most this factor more texels where they are stretched than where square."""

_TILE = 64
"""Most texels along a tile; tiles are small where kernels are large, so that cancelling is fast."""

_FARTHEST = np.float32(1e15)  # its square is far from the ends of float32

Texels = npt.NDArray[np.float32]


def smooth_texels_once(
    atlas: TextureAtlas,
    values: Texels,
    settings: BeltramiTextureSettings,
    out: Texels,
    *,
    alpha: int = -1,
    normals: bool = False,
) -> None:
    """Apply the kernel once.

    Parameters
    ----------
    atlas : TextureAtlas
    values : (rows, columns, c) float32
        Values of nodes and ghosts.
    settings : BeltramiTextureSettings
        `time` greater than 0.
    out : (rows, columns, c) float32
        Gets the means at nodes inside charts; opacity stays.
    alpha : int
        The last channel if it is opacity, which weights the others; -1 if there is none.
    normals : bool
        The first two channels are tangent-space directions around 1/2, which turn across seams.
    """
    radius = math.sqrt(settings.limit)
    size = min(max(int(math.sqrt(REACHED / (math.pi * settings.limit + 1.0))), 8), _TILE)
    tiles = cut_tiles(atlas, size, math.ceil(_TIMES * radius))
    skipped = np.zeros(atlas.sheet.nodes.shape, dtype=np.bool_)
    skipped.reshape(-1)[atlas.copies[:, 0]] = True
    count = len(tiles.starts) - 1
    unsplit = np.zeros(count, dtype=np.int64)
    run(_smooth_tiles, count, surface_of(atlas), tiles, skipped, values, alpha, normals,
        np.float32(settings.beta), np.float32(settings.limit), radius,
        np.float32(min(0.25 / settings.time, FASTEST)), unsplit, out, chunk=1)  # fmt: skip
    flat = out.reshape(skipped.size, -1)
    flat[atlas.copies[:, 0]] = flat[atlas.copies[:, 1]]
    if unsplit.any():
        log.info("Some obtuse triangles of texels are split into %d parts, and not to the end:"
                 " distances through them are too long.", MOST_SPLITS)  # fmt: skip


@kernel
def _smooth_tiles(
    start, stop, surface, tiles, skipped, values, alpha, normals, beta, limit, radius, rate,
    unsplit, out,
):  # fmt: skip
    box = np.empty((2, 2), np.int64)
    for tile in range(start, stop):
        chart = next_chart(surface, tiles, tile, skipped, -1, box)
        while chart >= 0:
            reach = int(np.ceil(radius * stretch_around(surface, tiles, chart, box) - 1e-6))
            window = -1
            if reach > tiles.reach:
                reach = tiles.reach
                window = reach
            patch = lay_patch(surface, tiles, tile, chart, box, reach, normals)
            signal, guide = _values_on(patch, values, alpha, normals, beta)
            height, width = patch.nodes.shape
            areas = np.ones((height, width), np.float32)
            rows = np.empty((height, 2), np.int64)
            wanted = np.zeros((height, width), np.bool_)
            for i in range(height):
                rows[i, 0] = max(i - reach, 0)
                rows[i, 1] = min(i + reach + 1, height)
            for i in range(reach, height - reach):
                for j in range(reach, width - reach):
                    wanted[i, j] = _is_wanted(surface, skipped, chart, box, reach, i, j)
            means = np.empty_like(signal)
            unfinished = np.zeros(height, np.int64)
            smooth_rows(reach, height - reach, signal, guide, MEASURED, areas, limit,
                        rate, window, rows, unfinished, wanted, means)  # fmt: skip
            unsplit[tile] += unfinished.sum()
            _write_means(patch.nodes, wanted, means, values, alpha, out)
            chart = next_chart(surface, tiles, tile, skipped, chart, box)


@kernel
def _is_wanted(surface, skipped, chart, box, reach, i, j):
    y, x = box[0, 0] + i - reach, box[0, 1] + j - reach
    face = surface.sheet.nodes[y, x]
    return face >= 0 and surface.labels[face] == chart and not skipped[y, x]


@kernel
def _values_on(patch, values, alpha, normals, beta):
    # The values to average, colors times opacity, and the coordinates in which distances are
    # measured: these colors, and positions in units of texels.
    height, width = patch.nodes.shape
    channels = values.shape[2]
    colors = alpha if alpha >= 0 else channels
    flat = values.reshape(-1, channels)
    signal = np.zeros((height, width, channels), np.float32)
    guide = np.full((height, width, colors + 4), np.nan, np.float32)
    for i in range(height):
        for j in range(width):
            node = patch.nodes[i, j]
            if node < 0:
                continue
            color = signal[i, j]
            color[:] = flat[node]
            if normals:
                turn_direction(patch.turns[i, j], color, np.float32(0.5))
            if alpha >= 0:
                color[:colors] *= color[alpha]
            for c in range(colors):
                guide[i, j, c] = min(max(beta * color[c], -_FARTHEST), _FARTHEST)
            guide[i, j, colors : colors + 3] = patch.points[i, j]
            guide[i, j, colors + 3] = np.float32(1.0) / patch.sizes[i, j]
    return signal, guide


@kernel
def _write_means(nodes, wanted, means, values, alpha, out):
    # Where nothing is opaque, colors stay.
    columns, channels = out.shape[1:]
    for i in range(nodes.shape[0]):
        for j in range(nodes.shape[1]):
            if not wanted[i, j]:
                continue
            y, x = divmod(nodes[i, j], columns)
            share = means[i, j, alpha] if alpha >= 0 else np.float32(1.0)
            for c in range(channels):
                if c != alpha:
                    out[y, x, c] = means[i, j, c] / share if share > 0 else values[y, x, c]
