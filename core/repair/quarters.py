# SPDX-License-Identifier: GPL-3.0-or-later
"""Textures at a quarter of the resolution, and interpolation of results to the full one."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..atlas.sheet import ROWS
from ..base.checks import SCALES
from ..base.parallel import kernel, run

Singles = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]

LESS = 4
"""Factor by which the height and the width are reduced."""


def reduced(pixels: npt.NDArray, known: Bools) -> tuple[Singles, Bools]:
    """Average the known texels of squares of `LESS` texels to a side.

    Parameters
    ----------
    pixels : (h, w, c) array
        Both sides are multiples of `LESS`.
    known : (h, w) bool

    Returns
    -------
    means : (h / LESS, w / LESS, c) float32
        For white = 1; 0 where no texel is known.
    lacking : (h / LESS, w / LESS) bool
        Squares without a known texel.
    """
    shape = pixels.shape[0] // LESS, pixels.shape[1] // LESS
    means = np.zeros((*shape, pixels.shape[2]), dtype=np.float32)
    lacking = np.zeros(shape, dtype=np.bool_)
    scale = SCALES[pixels.dtype.name]
    run(_average, shape[0], np.ascontiguousarray(pixels), known, scale, means, lacking, chunk=ROWS)
    return means, lacking


def enlarged(small: Singles, atlas: TextureAtlas, where: Bools) -> Singles:
    """Interpolate a texture reduced by `LESS` linearly at the nodes of some texels.

    Parameters
    ----------
    small : (h / LESS, w / LESS, c) float32
    atlas : TextureAtlas
    where : (h, w) bool
        Texels inside charts.

    Returns
    -------
    (rows, columns, c) float32
        0 at other nodes.
    """
    result = np.zeros((*atlas.sheet.nodes.shape, small.shape[2]), dtype=np.float32)
    nodes = result.reshape(-1, small.shape[2])
    run(_read, len(where), small, atlas.owners, where, nodes, chunk=ROWS)
    nodes[atlas.copies[:, 0]] = nodes[atlas.copies[:, 1]]
    return result


@kernel
def _average(start, stop, pixels, known, scale, means, lacking):
    total = np.empty(pixels.shape[2])
    for row in range(start, stop):
        for column in range(means.shape[1]):
            count = 0
            total[:] = 0.0
            for y in range(LESS * row, LESS * row + LESS):
                for x in range(LESS * column, LESS * column + LESS):
                    if known[y, x]:
                        count += 1
                        for c in range(len(total)):
                            total[c] += pixels[y, x, c]
            lacking[row, column] = count == 0
            if count > 0:
                for c in range(len(total)):
                    means[row, column, c] = scale * total[c] / count


@kernel
def _place(number, count):
    # The pixel before a place of the large image in the small one, and how far it lies behind.
    place = min(max((number + 0.5) / LESS - 0.5, 0.0), count - 1.0)
    low = min(int(place), count - 2)
    return low, np.float32(place - low)


@kernel
def _read(start, stop, small, owners, where, nodes):
    for y in range(start, stop):
        row, down = _place(y, small.shape[0])
        for x in range(owners.shape[1]):
            if not where[y, x]:
                continue
            column, across = _place(x, small.shape[1])
            node = owners[y, x]
            for c in range(small.shape[2]):
                upper = small[row, column, c]
                upper += across * (small[row, column + 1, c] - upper)
                lower = small[row + 1, column, c]
                lower += across * (small[row + 1, column + 1, c] - lower)
                nodes[node, c] = upper + down * (lower - upper)
