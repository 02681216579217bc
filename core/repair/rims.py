# SPDX-License-Identifier: GPL-3.0-or-later
"""How far rims of charts hold what lies beside the charts, as in textures that were reduced."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .missing import widened

Singles = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]

_NEAR = 3
"""Texels within which colors beside the rim are averaged."""

_FAR = 6
"""Texels along the rim over which its share is averaged, twice."""

_LEAST, _SURE = 0.25, 0.5
"""Slopes of the regression that are chance, and that are certain."""

_FAINT = 0.02
"""Contrast to the background, of 1, below which little is told."""


def background_in_rims(
    inside: Bools, outside: Singles, pixels: Singles, continued: Singles
) -> Singles:
    """Tell where the background beside charts is mixed into their rims.

    Reducing a texture by averaging mixes what lies beside the charts into their outermost texels.
    These then differ from the colors on both of their sides, inside the chart and across the seam,
    towards the background, by the share of each texel that lies beside the chart. How far that is
    so is the slope of a regression over a few texels, in which detail of the texture cancels.

    Parameters
    ----------
    inside : (h, w) bool
        Texels whose centres lie in charts.
    outside : (h, w) float32
        Share of each texel that lies in no chart.
    pixels : (h, w, c) float32
        The texture as it is, in [0, 1].
    continued : (h, w, c) float32
        The texture with a gutter that shows what the surface has across the seams.

    Returns
    -------
    (h, w) float32
        0 where rims hold nothing of the background, 1 where they certainly do, between these
        gradually.
    """
    mixed_up = (outside > 0) & (outside < 1)
    near = mixed_up | (inside & widened(~inside, 1)) | (~inside & widened(inside, 1))
    sides, has_sides = _mean(continued, ~near)
    ground, has_ground = _mean(pixels, ~inside & ~near)
    told = inside & mixed_up & has_sides & has_ground
    away = (ground - sides) * (outside * told)[..., None]
    expected = _spread(((pixels - sides) * away).sum(axis=2))
    whole = _spread((away * away).sum(axis=2))
    faint = pixels.shape[2] * _FAINT**2 * _spread(outside**2 * told)
    slope = expected / np.maximum(whole + faint, 1e-12)
    return np.clip((slope - _LEAST) / (_SURE - _LEAST), 0.0, 1.0).astype(np.float32)


def _mean(values: Singles, where: Bools) -> tuple[npt.NDArray[np.float64], Bools]:
    # Of the texels nearby that count, and whether there are any.
    count = _summed(_summed(where, _NEAR, 0), _NEAR, 1)
    sums = _summed(_summed(values * where[..., None], _NEAR, 0), _NEAR, 1)
    return sums / np.maximum(count, 0.5)[..., None], count > 0.5


def _spread(values: npt.NDArray) -> npt.NDArray[np.float64]:
    for axis in (0, 1, 0, 1):
        values = _summed(values, _FAR, axis)
    return values


def _summed(values: npt.NDArray, reach: int, axis: int) -> npt.NDArray[np.float64]:
    # Sums over windows along an axis.
    count = values.shape[axis]
    sums = np.cumsum(values, axis=axis, dtype=np.float64)
    sums = np.concatenate([np.zeros_like(sums.take([0], axis)), sums], axis)
    places = np.arange(count)
    high, low = np.minimum(places + reach + 1, count), np.maximum(places - reach, 0)
    return sums.take(high, axis) - sums.take(low, axis)
