# SPDX-License-Identifier: GPL-3.0-or-later
"""Mixing of two pictures of a surface by how smoothly each goes on across seams."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..atlas.ghosts import fill_ghosts
from ..atlas.sheet import ROWS
from ..base.parallel import kernel, run
from ..base.progress import ask
from ..texture.texels import Texture, read_ghosts, values_of

Singles = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]

_POWER = 4
"""Of the ratio of both roughnesses: where one is half of the other, it gets 94 %."""

FAINT = (0.5 / 255) ** 2
"""Squared second differences that nobody sees."""


def share_of_first(texture: Texture, first: npt.NDArray, second: npt.NDArray) -> Singles:
    """Tell how much of the first of two pictures of a surface to take at each texel.

    A fault at the rims of charts, as a dark line, makes a texture bend there. So of two pictures
    the one is taken whose second differences, which read across seams, are smaller: their squares
    are averaged over 3 x 3 texels with binomial weights. Where both are alike, they are mixed.

    Parameters
    ----------
    texture : Texture
        Its pixels do not matter; seams that its atlas closes are not looked across.
    first, second : (h, w, c) array
        Of the same type.

    Returns
    -------
    (h, w) float32
        1: all of the first; 0: all of the second, which is also beside the charts.
    """
    atlas = texture.atlas
    one, other = (roughness(texture, each) for each in (first, second))
    ratio = (one + FAINT) / (other + FAINT)
    shares = 1 / (1 + ratio**_POWER)
    inside = atlas.inside
    result = np.zeros(inside.shape, dtype=np.float32)
    result[inside] = shares.reshape(-1)[atlas.owners[inside]]
    return result


def roughness(texture: Texture, pixels: npt.NDArray, *, across: bool = True) -> Singles:
    """Average the squared second differences over 3 x 3 texels, with binomial weights.

    Parameters
    ----------
    texture : Texture
        Its own pixels do not matter.
    pixels : (h, w, c) array
    across : bool
        Whether to look across seams that are not closed; else each chart is by itself.

    Returns
    -------
    (rows, columns) float32
        At nodes inside charts, for white = 1: the mean of four directions, the sum of all channels.
    """
    sheet, sources = texture.atlas.sheet, texture.atlas.sources
    values = values_of(texture.atlas, pixels, texture.alpha)
    there = sheet.nodes >= 0
    if across:
        read_ghosts(texture, values)
        there.reshape(-1)[sheet.ghosts] = sources.cells >= 0
    ask()
    rough = np.zeros((*there.shape, 1), dtype=np.float32)
    run(_bend, len(rough), sheet.nodes, there, values, rough[..., 0], chunk=ROWS)
    if across:
        fill_ghosts(sheet, sources, rough)
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
