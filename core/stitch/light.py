# SPDX-License-Identifier: GPL-3.0-or-later
"""Estimates whether charts or pictures differ by factors, as in another light, or by offsets."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np
import numpy.typing as npt

from ..base.checks import Floats
from ..elements.matrices import TextureSpace

_Single = npt.NDArray[np.float32]

_COMMON_WEIGHT = 0.2
"""Weight of the residual with one offset, or one factor, for all channels."""

_RESIDUAL_RAMP = 1.05, 1.1
"""Ramp of the residual by factors over that by offsets: up to the first value factors are taken,
because they are more usual, from the second on offsets."""

_EXACT = 1e-4
"""Residuals by offsets up to this share of the floor are rounding."""


def share_of_factors(
    space: TextureSpace,
    values: Sequence[_Single],
    corners: Sequence[Floats],
    known: Sequence[npt.NDArray[np.bool_]],
    floor: float,
) -> float:
    """Measure whether factors explain both sides of seams, or two pictures, better than offsets.

    The residuals of both are compared in units of the values, plus the floor, so that rounding does
    not decide.

    Parameters
    ----------
    space : TextureSpace
    values : sequence of (n, c) float32
        Values of each picture at the nodes.
    corners : sequence of (v, c) float64
        Values at the corners of the pieces, as their own chart shows them; NaN where unknown.
    known : sequence of (n,) bool
    floor : float
        Added before logarithms are taken.

    Returns
    -------
    float
        1 for factors, 0 for offsets; 0 also if there are no differences, or neither seams nor
        places that are known in two pictures.
    """
    by_offsets = by_factors = rounding = 0.0
    for one, other, group in (*_at_seams(space, corners), *_of_pictures(values, known)):
        a, b = np.maximum(one, 0.0) + floor, np.maximum(other, 0.0) + floor
        channels = [(a[:, k], b[:, k], group) for k in range(a.shape[1])]
        alike = a.T.reshape(-1), b.T.reshape(-1), np.tile(group, a.shape[1])
        for pairs, weight in (*((each, 1.0) for each in channels), (alike, _COMMON_WEIGHT)):
            left = _unexplained(*pairs)
            by_offsets += weight * left[0]
            by_factors += weight * left[1]
        rounding += (1.0 + _COMMON_WEIGHT) * floor * a.size
    if not by_offsets > _EXACT * rounding:
        return 0.0
    times = (by_factors + rounding) / (by_offsets + rounding)
    return min(max((_RESIDUAL_RAMP[1] - times) / (_RESIDUAL_RAMP[1] - _RESIDUAL_RAMP[0]), 0.0), 1.0)


def _unexplained(a: Floats, b: Floats, group: npt.NDArray[np.intp]) -> tuple[float, float]:
    # The sums of absolute residuals with an offset for each group, and with a factor for each.
    offset = _medians(b - a, np.ones_like(a), group)
    root = np.exp(0.5 * _medians(np.log(b / a), np.sqrt(a * b), group))
    return float(np.abs(b - a - offset).sum()), float(np.abs(b / root - a * root).sum())


_Pairs = tuple[Floats, Floats, npt.NDArray[np.intp]]


def _at_seams(space: TextureSpace, corners: Sequence[Floats]) -> Iterator[_Pairs]:
    # Values of both sides, and an index of the pair of charts and pictures.
    pieces, charts = space.cut_cells.pieces, space.atlas.charts
    chart = np.repeat(charts.labels[pieces.faces], np.diff(pieces.start)).astype(np.int64)
    count = len(charts.boxes)
    places, side, found = [], [], []
    for number, each in enumerate(corners):
        at = np.flatnonzero(~np.isnan(each[:, 0]) & (chart >= 0))
        places.append(pieces.points[at])
        side.append(chart[at] + number * count)
        found.append(each[at])
    sides = count * len(corners)
    key = np.concatenate(places) * sides + np.concatenate(side)
    key, index, counts = np.unique(key, return_inverse=True, return_counts=True)
    if len(key) < 2:
        return
    columns = np.concatenate(found).T
    means = np.stack([np.bincount(index, column) / counts for column in columns], axis=1)
    point, side_of = np.divmod(key, sides)
    first = np.flatnonzero(point[1:] == point[:-1])
    group = np.unique(side_of[first] * sides + side_of[first + 1], return_inverse=True)[1]
    yield means[first], means[first + 1], group


def _of_pictures(
    values: Sequence[_Single], known: Sequence[npt.NDArray[np.bool_]]
) -> Iterator[_Pairs]:
    for one, other in combinations(range(len(values)), 2):
        both = np.flatnonzero(known[one] & known[other])
        a, b = (values[k][both].astype(np.float64) for k in (one, other))
        yield a, b, np.zeros(len(both), dtype=np.intp)


def _medians(values: Floats, weights: Floats, group: npt.NDArray[np.intp]) -> Floats:
    # The weighted median of the group of each value, which ignores a few outliers.
    order = np.lexsort((values, group))
    values, weights, group = values[order], weights[order], group[order]
    sums = np.cumsum(weights)
    last = np.flatnonzero(np.diff(group, append=-1))
    before = np.concatenate([[0.0], sums[last[:-1]]])
    middle = np.searchsorted(sums, 0.5 * (before + sums[last]))
    out = np.empty_like(values)
    out[order] = values[np.minimum(middle, last)][group]
    return out
