# SPDX-License-Identifier: GPL-3.0-or-later
"""Mixes two pictures of a surface by how smooth each is across seams."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..texture.roughness import roughness
from ..texture.texels import Texture

Singles = npt.NDArray[np.float32]

_POWER = 4
"""Power of the ratio of both roughnesses: where one is half of the other, it has 94 % weight."""

FAINT = (0.5 / 255) ** 2
"""Squared second differences that are invisible."""


def share_of_first(texture: Texture, first: npt.NDArray, second: npt.NDArray) -> Singles:
    """Return the weight of the first of two pictures of a surface at each texel.

    A fault at the rims of charts, such as a dark line, causes large second differences. So the
    picture whose second differences, measured also across seams, are smaller has more weight: their
    squares are averaged over 3 x 3 texels with binomial weights. Where both are alike, they are
    mixed.

    Parameters
    ----------
    texture : Texture
        Its pixels are not used. Differences do not reach across seams that its atlas closes.
    first, second : (h, w, c) array
        Both pictures, of the same type.

    Returns
    -------
    (h, w) float32
        1 for the first picture only, 0 for the second only; 0 beside the charts.
    """
    atlas = texture.atlas
    one, other = (roughness(texture, each) for each in (first, second))
    ratio = (one + FAINT) / (other + FAINT)
    shares = 1 / (1 + ratio**_POWER)
    inside = atlas.inside
    result = np.zeros(inside.shape, dtype=np.float32)
    result[inside] = shares.reshape(-1)[atlas.owners[inside]]
    return result
