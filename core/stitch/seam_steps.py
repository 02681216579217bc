# SPDX-License-Identifier: GPL-3.0-or-later
"""Steps at seams, and the part of them that stands out from the detail beside them.

Not in the papers. On each side of a seam, the values of its chart are extrapolated to the seam.
Fine detail is extrapolated badly, so that a texture without steps seems to have one that changes
from texel to texel. A real step, by light or color, continues along the seam or is larger than the
detail. If one material is seen in two lights, both sides have the same detail; if two materials
meet, they do not. Without detail, lights seldom differ as much in tint as materials do, and all
seams together tell whether the steps were designed (see `design`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.checks import Floats
from ..elements.cut import Pieces
from ..elements.matrices import TextureSpace
from ..elements.surface_values import corner_values
from ..mixture.cells import MeansAround
from .design import DARK, SMALL, how_designed, steps_of

_WIDE, _NEAR = 40.0, 6.0
"""Sizes of the cells, in texels, over which steps are averaged along a seam: for the lasting part,
and for the size of the rest."""

_INDEPENDENT = 8.0, 40.0
"""Number of values at a seam per independent one; and the largest number of independent ones."""

_LONG = 160.0
"""Size of the cells, in texels, in which the detail of both sides is compared."""

_FAINT = 0.04
"""Contrast of detail, relative to that of all seams, that counts as chance."""

_AGREEMENT_RAMP = 0.6, 0.95
"""Ramp of the share of detail that agrees: up to the first value both sides are different
materials, from the second on the same."""

_UNEXPLAINED_RAMP = 0.05, 0.3
"""Ramp of the share of the squared steps along a seam that one factor or offset leaves: up to the
first value it is detail that does not quite fit, from the second on the steps were designed."""

_CONTRAST_RAMP = 1.6, 2.0
"""Ramp of the ratio of the contrasts of both sides: up to the first value it may be haze, which
takes up to two fifths of the contrast, from the second on the steps were designed."""

_TINT, _LIGHT = 0.8, 1.3
"""Differences of the logarithms of both sides, between channels and of their mean, at which a step
without detail is as likely to be of light as of materials. Lights of factors 0.6 to 1.35 differ by
0.8, colors of a palette by 1 to 2 in tint."""

_TINT_ADDED, _LIGHT_ADDED = 0.5, 0.8
"""The same for differences of values, relative to the mean value, for light that is added."""

_OF_ITSELF = 0.5
"""Share of these differences where a chart meets itself: it has one light for the most part."""

_ALIKE = 0.05
"""Share of these differences where steps were designed: what remains is at most an error of
exposure."""

_SAME_PLACE = 1e-3
"""Distance, in texels, up to which corners of one point in one chart are one side."""

_NOTHING = 1e-20


def clear_steps(
    space: TextureSpace,
    corners: Floats,
    rough: npt.NDArray[np.float32],
    believed: npt.NDArray[np.bool_],
    same_material: bool,
) -> tuple[Floats, Floats]:
    """Remove, from values at seams, the steps that do not stand out from the detail beside them.

    A step is the sum of its average along the seam and the rest. Let s be the square of either,
    divided by the squared step that the detail explains: s / (1 + s) of the average is kept, and
    s^2 / (1 + s^2) of the rest. The detail explains its squared second differences; for the
    average, these are divided by the number of independent values.

    Parameters
    ----------
    space : TextureSpace
    corners : (v, c) float64
        Values at the corners of the pieces, as their own chart shows them; NaN where unknown.
    rough : (rows, columns) float32
        Squared second differences at nodes, from `roughness`; NaN where unknown.
    believed : (v,) bool
        Corners that are interpolated from known texels only.
    same_material : bool
        Keep steps only where both sides have the same detail.

    Returns
    -------
    corners : (v, c) float64
        Both sides of a seam have the mean of both where no step stands out; NaN where unknown.
    share : (v,) float64
        How much of the largest step nearby stands out, from 0 to 1.
    """
    pieces, charts = space.cut_cells.pieces, space.atlas.charts
    ghosts = np.zeros(len(space.atlas.sheet.ghosts), dtype=np.bool_)
    errors = corner_values(space, rough[..., None], ghosts)[:, 0]
    chart = np.repeat(charts.labels[pieces.faces], np.diff(pieces.start)).astype(np.int64)
    at = np.flatnonzero(~np.isnan(corners[:, 0]) & believed & (chart >= 0))
    errors = _with_narrow(errors, at)
    count = len(charts.boxes)
    first, index = _sides(pieces.points[at] * count + chart[at], pieces.places[at])
    shown = _means(index, corners[at])
    point, side = pieces.points[at[first]], chart[at[first]]
    number, counts = np.unique(point, return_inverse=True, return_counts=True)[1:]
    seen = counts[number]
    seam = np.flatnonzero(seen > 1)
    if len(seam) == 0:
        return np.where(believed[:, None], corners, np.nan), np.zeros(len(corners))
    steps = (shown - _means(number, shown)[number])[seam]
    # The squared error of the mean of k sides, whose errors are independent: their sum / k^2.
    error = _means(number, _means(index, errors[at, None]))[number][seam] / seen[seam, None]
    places = pieces.places[at[first[seam]]]
    of_itself = _of_itself(number[seam], side[seam], places)
    group = _groups(number[seam], side[seam], of_itself)
    kept = _clear(steps, error, places, group)
    if same_material:
        other = shown[seam] - 2.0 * steps
        both = _both_sides(shown[seam], other, error, places, group)
        own = side[seam]
        two = np.flatnonzero((of_itself == 0) & (seen[seam] == 2))
        designed = _how_designed(both, two, np.column_stack([own, _neighbors(number[seam], own)]))
        scale = np.where(of_itself == 0, 1.0 - (1.0 - _ALIKE) * designed, _OF_ITSELF)
        kept *= _same_material(both, places, group, scale)
    clear = np.zeros_like(shown)
    clear[seam] = kept - steps
    found = np.where(believed[:, None], corners, np.nan)
    found[at] += clear[index]
    sizes = np.zeros((2, len(shown)))
    sizes[:, seam] = np.linalg.norm(kept, axis=1), np.linalg.norm(steps, axis=1)
    at_corners = np.zeros((2, len(corners)))
    at_corners[:, at] = sizes[:, index]
    largest, of_steps = (_largest_around(pieces, each) for each in at_corners)
    return found, np.minimum(largest / (of_steps + _NOTHING), 1.0)


def _largest_around(pieces: Pieces, sizes: Floats) -> Floats:
    # The largest size in each corner's piece, and in all pieces that share a point with it.
    piece = np.repeat(np.arange(len(pieces.faces)), np.diff(pieces.start))
    points = np.zeros(int(pieces.points.max(initial=-1)) + 1)
    for _ in range(2):
        np.maximum.at(points, pieces.points, sizes)
        largest = np.zeros(len(pieces.faces))
        np.maximum.at(largest, piece, points[pieces.points])
        sizes = largest[piece]
    return sizes


def _clear(steps: Floats, error: Floats, places: Floats, group: npt.NDArray[np.intp]) -> Floats:
    wide = _averaged(np.column_stack([steps, error]), places, group, _WIDE)
    lasting, explained = wide[:, :-1], wide[:, -1]
    independent = np.clip(np.bincount(group)[group] / _INDEPENDENT[0], 1.0, _INDEPENDENT[1])
    share = _standing_out((lasting**2).sum(axis=1), explained / independent, 1)
    rest = steps - lasting
    squares = np.column_stack([(rest**2).sum(axis=1), error])
    near = _averaged(squares, places, group, _NEAR)
    return share * lasting + _standing_out(near[:, 0], near[:, 1], 2) * rest


class _Sides(NamedTuple):
    # Both sides of seams, averaged over a few texels and over many.
    near: tuple[Floats, Floats]  # (n, c) each
    wide: tuple[Floats, Floats]
    error: Floats  # (n,): squared error of the mean of both near sides
    spread: float  # squared differences of all sides from their mean

    @property
    def error_of_steps(self) -> Floats:
        # The errors of both sides are independent.
        return 4.0 * self.error


def _both_sides(
    shown: Floats, other: Floats, error: Floats, places: Floats, group: npt.NDArray[np.intp]
) -> _Sides:
    both = np.column_stack([shown, other])
    near = _averaged(np.column_stack([both, error]), places, group, _NEAR)
    wide = _averaged(both, places, group, _LONG)
    channels = shown.shape[1]
    independent = np.clip(np.bincount(group)[group] / _INDEPENDENT[0], 1.0, _NEAR)
    return _Sides(
        (near[:, :channels], near[:, channels:-1]),
        (wide[:, :channels], wide[:, channels:]),
        near[:, -1] / independent,
        float(both.var(axis=0).sum()),
    )


def _how_designed(sides: _Sides, at: npt.NDArray[np.intp], charts: npt.NDArray) -> float:
    near, wide = ((one[at], two[at]) for one, two in (sides.near, sides.wide))
    return how_designed(near, wide, sides.error_of_steps[at], charts[at])


def _same_material(
    sides: _Sides, places: Floats, group: npt.NDArray[np.intp], scale: Floats
) -> Floats:
    # How well the detail of both sides along the seam agrees, up to an offset and a factor: from 0
    # to 1. Seams with little detail are judged by all seams, the more the larger their steps are:
    # a seam without a step tells nothing of light. Without detail, the step decides.
    one, two = (near - wide for near, wide in zip(sides.near, sides.wide, strict=True))
    # The error is half the squared error of a side, because the second differences it is measured
    # by contain detail that both sides may share.
    chance = sides.error + _FAINT**2 * sides.spread
    light = chance * _looks_like_light(*sides.wide, scale)
    products = [(one * two).sum(axis=1), (one**2).sum(axis=1), (two**2).sum(axis=1)]
    energies = np.column_stack([*products, chance, light])
    agreeing, own = _agreeing_and_own(*_averaged(energies, places, group, _LONG).T)
    weights = ((sides.wide[0] - sides.wide[1]) ** 2).sum(axis=1) + _NOTHING
    agreeing, own = (each + weights @ each / weights.sum() for each in (agreeing, own))
    same = _ramp(agreeing / (agreeing + own + _NOTHING), _AGREEMENT_RAMP)
    same *= 1.0 - _ramp(_unexplained(sides, places, group), _UNEXPLAINED_RAMP)
    return same[:, None]


def _unexplained(sides: _Sides, places: Floats, group: npt.NDArray[np.intp]) -> Floats:
    # The share of the squared steps along a seam that one factor, or one offset together with a
    # moderate change of contrast, leaves.
    level = float(np.abs(np.concatenate(sides.wide)).mean()) + _NOTHING
    factors, offsets = steps_of(sides.near, sides.error_of_steps, level)
    one, two = (each / level for each in sides.near)
    channels = one.shape[1]
    columns = np.column_stack([factors[0], one, two])
    energies = [(each**2).sum(axis=1) for each in (factors[0], one, two)]
    energies += [(one * two).sum(axis=1), (offsets[0] ** 2).sum(axis=1), factors[1], offsets[1]]
    means = _averaged(np.column_stack([columns, *energies]), places, group, _LONG)
    of_factors, of_one, of_two = np.split(means[:, : 3 * channels], 3, axis=1)
    by_factors, a, b, common, by_offsets, error, error_of_offsets = means[:, 3 * channels :].T
    left = by_factors - (of_factors**2).sum(axis=1) - error
    a = np.maximum(a - (of_one**2).sum(axis=1), _NOTHING)
    b = np.maximum(b - (of_two**2).sum(axis=1), _NOTHING)
    contrast = 0.5 * np.log(a / b)
    contrast = np.exp(contrast * (1.0 - _ramp(np.exp(np.abs(contrast)), _CONTRAST_RAMP)))
    common = common - (of_one * of_two).sum(axis=1)
    left_by_offsets = a / contrast + b * contrast - 2.0 * common - error_of_offsets
    return np.minimum(
        np.maximum(left, 0.0) / (by_factors + SMALL**2),
        np.maximum(left_by_offsets, 0.0) / (by_offsets + SMALL**2),
    )


def _ramp(values: Floats, between: tuple[float, float]) -> Floats:
    return np.clip((values - between[0]) / (between[1] - between[0]), 0.0, 1.0)


def _agreeing_and_own(
    common: Floats, one: Floats, two: Floats, chance: Floats, light: Floats
) -> tuple[Floats, Floats]:
    # The energy that both sides share, and that of each side's own. `chance` counts as detail that
    # agrees as far as colors look like those of two lights.
    own = np.maximum(np.sqrt(one * two) - common - chance, 0.0) + (chance - light)
    return np.maximum(common, 0.0) + light, own


def _looks_like_light(one: Floats, two: Floats, scale: Floats) -> Floats:
    # How likely two plain sides are one color in two lights, from 0 to 1, by a factor or an offset.
    # `scale` multiplies the differences at which materials are as likely.
    level = np.abs(np.concatenate([one, two])).mean() + _NOTHING
    dark = DARK * level
    factors = np.log(np.maximum(one, 0.0) + dark) - np.log(np.maximum(two, 0.0) + dark)
    return np.maximum(
        _likely(factors, _TINT * scale, _LIGHT * scale),
        _likely((one - two) / level, _TINT_ADDED * scale, _LIGHT_ADDED * scale),
    )


def _likely(apart: Floats, tint: Floats, light: Floats) -> Floats:
    mean = apart.mean(axis=1)
    rest = np.sqrt(((apart - mean[:, None]) ** 2).sum(axis=1))
    likely: Floats = 1.0 / (1.0 + (rest / tint) ** 6 + (mean / light) ** 6)
    return likely


def _sides(
    chart: npt.NDArray[np.int64], places: Floats
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    # The first corner of each side of a point, and the side of each corner. Where a chart meets
    # itself, its sides lie at different places of the texture.
    down, across = np.rint(places / _SAME_PLACE).astype(np.int64).T
    order = np.lexsort((across, down, chart))
    is_new = np.ones(len(order), dtype=np.bool_)
    for key in (chart[order], down[order], across[order]):
        is_new[1:] &= key[1:] == key[:-1]
    is_new[1:] = ~is_new[1:]
    index = np.empty(len(order), dtype=np.intp)
    index[order] = np.cumsum(is_new) - 1
    return order[is_new], index


def _with_narrow(errors: Floats, at: npt.NDArray[np.intp]) -> Floats:
    # Charts too narrow for second differences have the median of all others at seams.
    known = errors[at]
    known = known[~np.isnan(known)]
    return np.where(np.isnan(errors), np.median(known) if len(known) else 0.0, errors)


def _averaged(values: Floats, places: Floats, group: npt.NDArray[np.intp], size: float) -> Floats:
    # Averages along the seam between two charts; other seams are moved away in a third dimension.
    apart = np.column_stack([places, 4.0 * size * group])
    return MeansAround(apart, values, size).at(np.arange(len(places)))


def _standing_out(square: Floats, explained: Floats, power: int) -> Floats:
    share: Floats = square**power / (square**power + explained**power + _NOTHING)
    return share[:, None]


def _groups(
    point: npt.NDArray[np.intp], side: npt.NDArray[np.int64], of_itself: Floats
) -> npt.NDArray[np.intp]:
    # A label for each chart and the charts that it meets at a point: the same all along a seam.
    others = np.bincount(point, np.sqrt(side + 2.0))[point]
    keys = np.column_stack([side, np.round(others, 6), of_itself])
    found: npt.NDArray[np.intp] = np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1)
    return found


def _neighbors(point: npt.NDArray[np.intp], side: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    # The chart on the other side of each point that has two sides.
    found: npt.NDArray[np.int64] = np.bincount(point, side)[point].astype(np.int64) - side
    return found


def _of_itself(point: npt.NDArray[np.intp], side: npt.NDArray[np.int64], places: Floats) -> Floats:
    # 1 and -1 at the sides of a seam where a chart meets itself, by the direction from one to the
    # other; 0 elsewhere.
    pair = np.unique(np.column_stack([point, side]), axis=0, return_inverse=True)[1].reshape(-1)
    off = places - _means(pair, places)[pair]
    a, b, c = (
        np.bincount(side, each) for each in (off[:, 0] ** 2, off.prod(axis=1), off[:, 1] ** 2)
    )
    angle = 0.5 * np.arctan2(2.0 * b, a - c)[side]
    found: Floats = np.sign(off[:, 0] * np.cos(angle) + off[:, 1] * np.sin(angle))
    return found


def _means(index: npt.NDArray[np.intp], values: Floats) -> Floats:
    counts = np.bincount(index)
    return np.column_stack([np.bincount(index, column) / counts for column in values.T])
