# SPDX-License-Identifier: GPL-3.0-or-later
"""Smoothing, minima and maxima in windows of any size, on a sheet of texels.

Windows reach across seams: they grow by a texel at a time, and after each step the ghosts are read
anew from beyond the seam. Lengths are in texels.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..base.progress import phase
from .atlas import TextureAtlas
from .ghosts import fill_ghosts
from .potential import smooth_texels
from .sheet import NOTHING, ROWS

_NEIGHBOUR = math.exp(-1.0)
_VARIANCE = 2.0 * _NEIGHBOUR / (1.0 + 4.0 * _NEIGHBOUR)  # of a smoothing pass, along an axis


def smooth_as_far(
    atlas: TextureAtlas, values: npt.NDArray[np.float32], sigma: float
) -> npt.NDArray[np.float32]:
    """Smooth nodes and ghosts by about a Gaussian: (rows, columns, c), overwritten."""
    return smooth_texels(atlas, values, max(round(sigma**2 / _VARIANCE), 1))


def texel_ranges(
    atlas: TextureAtlas,
    values: npt.NDArray[np.float32],
    reach: int,
    hidden: npt.NDArray[np.bool_] | None = None,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Return the minimum and maximum within `reach` texels: (rows, columns, c) each.

    Parameters
    ----------
    atlas : TextureAtlas
    values : (rows, columns, c) float32
    reach : int
    hidden : (rows, columns, 1) bool, optional
        Nodes and ghosts that do not count.
    """
    with phase(0.0, 0.5, "Measuring borders"):
        low = -values
        if hidden is not None:
            np.copyto(low, low.min(), where=hidden)
        low = _greatest(atlas, low, reach)
        np.negative(low, out=low)
    with phase(0.5, 1.0, "Measuring borders"):
        high = values.copy()
        if hidden is not None:
            np.copyto(high, high.min(), where=hidden)
        return low, _greatest(atlas, high, reach)


def _greatest(
    atlas: TextureAtlas, values: npt.NDArray[np.float32], reach: int
) -> npt.NDArray[np.float32]:
    # `values` are overwritten.
    spare = np.zeros_like(values)
    for _ in range(reach):
        run(_take_greatest, len(values), atlas.sheet.nodes, atlas.sources.cells, values, spare,
            chunk=ROWS)  # fmt: skip
        fill_ghosts(atlas.sheet, atlas.sources, spare)
        values, spare = spare, values
    return values


@kernel
def _take_greatest(start, stop, nodes, sources, values, out):
    for y in range(start, stop):
        for x in range(nodes.shape[1]):
            if nodes[y, x] < 0:
                continue
            for c in range(values.shape[2]):
                out[y, x, c] = values[y, x, c]
            # Inner nodes are never at the sheet's rim.
            for dy in range(-1, 2):
                for dx in range(-1, 2):
                    node = nodes[y + dy, x + dx]
                    if node == NOTHING or (node < NOTHING and sources[-2 - node] < 0):
                        continue
                    for c in range(values.shape[2]):
                        out[y, x, c] = max(out[y, x, c], values[y + dy, x + dx, c])
