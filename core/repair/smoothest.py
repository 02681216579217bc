# SPDX-License-Identifier: GPL-3.0-or-later
"""Mixing of two pictures of a surface by how smoothly each goes on across seams."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..texture.roughness import roughness
from ..texture.texels import Texture

Singles = npt.NDArray[np.float32]

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
