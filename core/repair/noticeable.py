# SPDX-License-Identifier: GPL-3.0-or-later
"""Weights that keep only changes of a texture which stand out from their surroundings."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.parallel import run
from ..base.progress import ask
from ..grid.windows import gaussian, least_and_greatest, smooth
from ..texture.roughness import roughness
from ..texture.texels import Texture
from .smoothest import FAINT

Singles = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]

_REACH = 3
"""Radius in texels within which the contrast is measured."""

_SPREAD = 1.5
"""Standard deviation in texels of the Gaussian that averages changes and contrasts."""

_AROUND = 3.0
"""Standard deviation in texels of the Gaussian that averages the sizes of changes."""

_LITTLE = 0.04
"""Change, as a share of the contrast, that has the weight 1/2."""

_NOTHING = 1e-20


def beside_detail(texture: Texture, change: Singles) -> Singles:
    """Weigh changes at seams by how much they stand out from the detail beside them.

    A change as large as the second differences inside the chart has the weight 1/2: there the
    texture is so fine that a step is not visible in it.

    Parameters
    ----------
    texture : Texture
    change : (h, w, c) float32
        For white = 1.

    Returns
    -------
    (h, w) float32 in [0, 1]
        0 where nothing changes.
    """
    atlas = texture.atlas
    rough = roughness(texture, texture.pixels, across=False).reshape(-1)
    detail = np.where(atlas.inside, rough[atlas.owners], np.float32(0))
    squares = np.einsum("hwc,hwc->hw", change, change)
    return squares / np.maximum(squares + detail, np.float32(_NOTHING))


def among_small(inside: Bools, change: Singles, most: float) -> Singles:
    """Weigh changes at seams by how small they and those around them are.

    Where different materials meet at a seam, most changes are large, and some are small by chance.

    Parameters
    ----------
    inside : (h, w) bool
        Texels inside charts.
    change : (h, w, c) float32
    most : float
        Change that has the weight 1/2.

    Returns
    -------
    (h, w) float32 in [0, 1]
    """
    far = np.where(inside, (np.abs(change).max(axis=2) / np.float32(most)) ** 2, np.float32(0))
    weights = gaussian(_AROUND)
    count = smooth((far > 0).astype(np.float32), weights)
    around = smooth(far, weights) / np.maximum(count, np.float32(_NOTHING))
    return 1 / (1 + np.maximum(far, around) ** 2)


def beside_seams(texture: Texture) -> Singles:
    """Weigh the sharpening of texels beside seams, where a texture may have faults.

    A fault at the rims of charts, such as a dark line that a blur has left, makes second
    differences across the seam larger than inside the chart. Where their squares are twice as
    large, the weight is 1/2.

    Parameters
    ----------
    texture : Texture
        Differences do not reach across seams that its atlas closes.

    Returns
    -------
    (h, w) float32 in [0, 1]
        1 away from seams, and beside the charts.
    """
    atlas = texture.atlas
    across, within = (roughness(texture, texture.pixels, across=each) for each in (True, False))
    shares = 1 / (1 + (np.maximum(across - within, 0) / (within + np.float32(FAINT))) ** 2)
    return np.where(atlas.inside, shares.reshape(-1)[atlas.owners], np.float32(1))


def against_contrast(inside: npt.NDArray[np.bool_], values: Singles, change: Singles) -> Singles:
    """Weigh changes by sharpening by their size relative to the contrast around them.

    Blurred parts change by far more than parts that are soft on purpose and nearly as sharp as
    texels allow. There, a small change is more likely to be an error.

    Parameters
    ----------
    inside : (h, w) bool
        Texels inside charts.
    values, change : (h, w, c) float32
        The values before sharpening, and their change.

    Returns
    -------
    (h, w) float32 in [0, 1]
        0 where nothing changes.
    """
    moved, contrast = (np.zeros(inside.shape, dtype=np.float32) for _ in range(2))
    count = values.shape[2]
    ranges = [np.empty(0, dtype=np.float32)] * count

    def measure(start: int, stop: int) -> None:
        for c in range(start, stop):
            high = np.where(inside, values[..., c], np.float32(-np.inf))
            low = np.where(inside, values[..., c], np.float32(np.inf))
            least_and_greatest(low, high, _REACH)
            ranges[c] = np.where(inside, high - low, np.float32(0))

    run(measure, count, chunk=1)
    for c in range(count):
        contrast += ranges[c] ** 2
        moved += np.where(inside, change[..., c], np.float32(0)) ** 2
    ask()
    weights = gaussian(_SPREAD)
    moved, contrast = (smooth(each, weights) ** 2 for each in (moved, contrast))
    return moved / np.maximum(moved + np.float32(_LITTLE**4) * contrast, np.float32(_NOTHING))
