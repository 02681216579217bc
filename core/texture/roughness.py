# SPDX-License-Identifier: GPL-3.0-or-later
"""The roughness of a texture: squared second differences at each texel."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..atlas.ghosts import fill_ghosts
from ..atlas.sheet import ROWS
from ..base.parallel import kernel, run
from ..base.progress import ask
from .texels import Texture, read_ghosts, values_of

Singles = npt.NDArray[np.float32]


def roughness(texture: Texture, pixels: npt.NDArray, *, across: bool = True) -> Singles:
    """Average the squared second differences over 3 x 3 texels, with binomial weights.

    Parameters
    ----------
    texture : Texture
        Its own pixels are not used.
    pixels : (h, w, c) array
    across : bool
        Whether differences reach across seams that are not closed; else each chart is separate.

    Returns
    -------
    (rows, columns) float32
        At nodes inside charts, for white = 1: the mean of four directions, the sum of all channels.
    """
    atlas = texture.atlas
    values = values_of(atlas, pixels, texture.alpha)
    there = atlas.sheet.nodes >= 0
    if across:
        read_ghosts(texture, values)
        there.reshape(-1)[atlas.sheet.ghosts] = atlas.sources.cells >= 0
    ask()
    return roughness_of_values(atlas, values, there, across)


def roughness_of_values(
    atlas: TextureAtlas, values: Singles, there: npt.NDArray[np.bool_], across: bool
) -> Singles:
    """Compute `roughness` of values (rows, columns, c) at nodes and ghosts marked by `there`."""
    sheet = atlas.sheet
    rough = np.zeros((*there.shape, 1), dtype=np.float32)
    run(_bend, len(rough), sheet.nodes, there, values, rough[..., 0], chunk=ROWS)
    if across:
        fill_ghosts(sheet, atlas.sources, rough)
    mean = np.zeros(there.shape, dtype=np.float32)
    run(_average, len(mean), sheet.nodes, there, rough[..., 0], mean, chunk=ROWS)
    return mean


@kernel
def _bend(start, stop, nodes, there, values, out):
    for y in range(start, stop):
        for x in range(nodes.shape[1]):
            if nodes[y, x] < 0:
                continue
            count = 0
            total = 0.0
            for n in range(4):
                v, u = (0, 1) if n == 0 else (1, n - 2)
                if not (there[y - v, x - u] and there[y + v, x + u]):
                    continue
                count += 1
                for c in range(values.shape[2]):
                    both = values[y - v, x - u, c] + values[y + v, x + u, c]
                    total += (both - 2 * values[y, x, c]) ** 2
            out[y, x] = total / max(count, 1)


@kernel
def _average(start, stop, nodes, there, given, out):
    for y in range(start, stop):
        for x in range(nodes.shape[1]):
            if nodes[y, x] < 0:
                continue
            count = 0.0
            total = 0.0
            for v in range(y - 1, y + 2):
                for u in range(x - 1, x + 2):
                    if there[v, u]:
                        weight = (2 - abs(v - y)) * (2 - abs(u - x))
                        count += weight
                        total += weight * given[v, u]
            out[y, x] = total / count
