# SPDX-License-Identifier: GPL-3.0-or-later
"""Colors and arrows that show the flow."""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Values = npt.NDArray[np.float32]

MOST_ARROWS = 20_000

_SIZES = 0.5, 1.0
"""Length of arrows for a slow and a fast flow, relative to their distance."""

_CELL = 0.7
"""Size of the cells with one arrow each, relative to their distance."""

_WEAK = 0.01
"""Least speed with an arrow, relative to a fast flow."""

_STRONG = 0.98
"""Quantile of the potential, or of the speed, above which all look alike."""

_STOPS = np.array(
    [
        [0.02, 0.10, 0.36],
        [0.24, 0.27, 0.50],
        [0.45, 0.45, 0.47],
        [0.72, 0.66, 0.36],
        [1.00, 0.91, 0.25],
    ]
)
"""From dark blue to yellow: lightness rises evenly, also for color-blind people."""

_SHAFT, _HEAD = 0.09, 0.36
"""Half the width of shaft and head, relative to half the length."""

_RIM = 0.13
"""Width of the dark rim, which makes arrows visible on light and dark surfaces."""

LIGHT, DARK = (1.0, 1.0, 1.0, 1.0), (0.03, 0.03, 0.05, 1.0)
"""Colors of arrows and of their rims."""

_FAINT, _DENSE = 0.35, 0.85
"""Opacity of a weak and a strong potential."""


def potential_colors(potential: Values) -> Values:
    """Return colors and opacities of vertices from the root of the potential: (n,) -> (n, 4)."""
    strength = np.sqrt(np.maximum(potential, 0.0))
    return ramp(np.minimum(strength / _strong(strength), 1.0))


def ramp(shares: npt.NDArray) -> Values:
    """Colors and opacities from weak (0) to strong (1): (n,) -> (n, 4)."""
    stops = np.linspace(0.0, 1.0, len(_STOPS))
    channels = [np.interp(shares, stops, channel) for channel in _STOPS.T]
    return np.stack([*channels, _FAINT + (_DENSE - _FAINT) * shares], axis=1).astype(np.float32)


def bar(x: float, y: float, width: float, height: float) -> tuple[Values, Values]:
    """Make a legend of `ramp`: the corners (k, 2) and colors (k, 4) of a strip of triangles."""
    shares = np.repeat(np.linspace(0.0, 1.0, 9), 2)
    colors = ramp(shares)
    colors[:, 3] = 1.0
    corners = np.stack([x + width * shares, np.full(len(shares), y)], axis=1)
    corners[1::2, 1] += height
    return corners.astype(np.float32), colors


class Arrows(NamedTuple):
    """Triangles to draw; rims are drawn before arrows.

    Attributes
    ----------
    rims, arrows : (9 k, 3) float32
        Corners of three triangles of each arrow.
    """

    rims: Values
    arrows: Values


def arrows(
    centers: Values, normals: Values, flow: Values, distance: float, most: int = MOST_ARROWS
) -> Arrows:
    """Make arrows on the faces with the fastest flow, at about this distance from each other.

    They point along the flow. Their length grows with the speed up to a high quantile of it, so
    that a few very fast faces do not shorten all other arrows.

    Parameters
    ----------
    centers, normals, flow : (m, 3) array of float
        Data of the faces.
    distance : float
        In the unit of length of the centers; increased if there would be too many arrows.
    most : int, optional
        Number of arrows.
    """
    speed = np.linalg.norm(flow, axis=1)
    fast = _strong(speed)
    chosen = np.flatnonzero(speed > _WEAK * fast)
    chosen = chosen[np.argsort(-speed[chosen], kind="stable")]
    while True:
        kept = _thinned(chosen, centers, _CELL * distance)
        if len(kept) <= most:
            break
        distance *= 1.5
    along = flow[kept] / speed[kept, None]
    across = np.cross(normals[kept], along)
    share = np.sqrt(np.minimum(speed[kept] / fast, 1.0))
    half = 0.5 * distance * (_SIZES[0] + (_SIZES[1] - _SIZES[0]) * share)[:, None]
    places = centers[kept], half * along, half * across
    return Arrows(_shapes(*places, _RIM), _shapes(*places, 0.0))


def _thinned(chosen: npt.NDArray, centers: Values, size: float) -> npt.NDArray:
    """Keep the first arrow in each cell of a lattice.

    The lattice is shifted by half a cell along all axes, so that no two arrows are closer.
    """
    for shift in product((0.0, 0.5), repeat=3):
        cells = np.floor(centers[chosen] / size + shift).astype(np.int64) & 0x1FFFFF
        keys = (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]
        chosen = chosen[np.sort(np.unique(keys, return_index=True)[1])]
    return chosen


def _shapes(middle: Values, along: Values, across: Values, rim: float) -> Values:
    """Make a shaft and a head around each place, wider by a rim."""
    shaft, head = _SHAFT + rim, _HEAD + 1.6 * rim
    tail, neck, tip = -1.0 - rim, 0.05 - rim, 1.0 + 1.6 * rim
    corners = (
        *((tail, -shaft), (neck, -shaft), (neck, shaft)),
        *((tail, -shaft), (neck, shaft), (tail, shaft)),
        *((neck, -head), (tip, 0.0), (neck, head)),
    )
    placed = [middle + forward * along + aside * across for forward, aside in corners]
    return np.stack(placed, axis=1).reshape(-1, 3).astype(np.float32)


def _strong(values: npt.NDArray) -> float:
    some = values[values > 0]
    return float(np.quantile(some, _STRONG)) if len(some) else 1.0
