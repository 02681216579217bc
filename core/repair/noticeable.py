# SPDX-License-Identifier: GPL-3.0-or-later
"""How far changes of a texture stand out from what is around them, so that others can be left."""

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
"""Texels to each side within which the contrast is measured."""

_SPREAD = 1.5
"""Standard deviation in texels of the Gaussian that averages changes and contrasts."""

_AROUND = 3.0
"""Standard deviation in texels of the Gaussian that averages how far changes go."""

_LITTLE = 0.04
"""Change of a border, as a share of its contrast, of which half is taken."""

_NOTHING = 1e-20


def beside_detail(texture: Texture, change: Singles) -> Singles:
    """Tell how far changes at seams stand out from the detail beside them.

    A change as large as the second differences inside the chart counts half: there the texture
    is too fine for a step to be told from it.

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
    """Tell how far changes at seams are small, and those around them.

    Where what meets at a seam has nothing in common, most changes are large, and some are small by
    chance.

    Parameters
    ----------
    inside : (h, w) bool
        The texels to look at.
    change : (h, w, c) float32
    most : float
        Change of which half is taken.

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
    """Tell how far a texture beside seams is sound enough to be sharpened.

    A fault at the rims of charts, as a dark line that a blur has left, makes a texture bend more
    across the seam than it does inside the chart. Where its squared second differences are twice
    as large, half of a change is taken.

    Parameters
    ----------
    texture : Texture
        Seams that its atlas closes are not looked across.

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
    """Tell how far changes by sharpening stand out from the contrast around them.

    What is blurred changes by far more than what is soft by intention and nearly as sharp as its
    texels allow: there a small change is rather an error.

    Parameters
    ----------
    inside : (h, w) bool
        The texels to look at.
    values, change : (h, w, c) float32
        What changes and by how much.

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
