# SPDX-License-Identifier: GPL-3.0-or-later
"""Steps at seams, and the part of them that stands out from the detail beside them.

Not in the papers. On each side of a seam, the values of its chart are extrapolated to the seam.
Fine detail is extrapolated badly, so that a texture without steps seems to have one that changes
from texel to texel. A real step, by light or color, continues along the seam or is larger than the
detail. If one material is seen in two lights, both sides have the same detail; if two materials
meet, they do not. Without detail, lights seldom differ as much in tint as materials do.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.checks import Floats
from ..elements.matrices import TextureSpace
from ..elements.surface_values import corner_values
from ..mixture.cells import MeansAround

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

_TINT, _LIGHT = 0.8, 1.3
"""Differences of the logarithms of both sides, between channels and of their mean, at which a step
without detail is as likely to be of light as of materials. Lights of factors 0.6 to 1.35 differ by
0.8, colors of a palette by 1 to 2 in tint."""

_DARK = 0.04
"""Share of the mean value that is added before logarithms are taken."""

_NOTHING = 1e-20


def clear_steps(
    space: TextureSpace,
    corners: Floats,
    rough: npt.NDArray[np.float32],
    same_material: bool,
) -> Floats:
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
    same_material : bool
        Keep steps only where both sides have the same detail.

    Returns
    -------
    (v, c) float64
        Both sides of a seam have the mean of both where no step stands out.
    """
    pieces, charts = space.cut_cells.pieces, space.atlas.charts
    ghosts = np.zeros(len(space.atlas.sheet.ghosts), dtype=np.bool_)
    errors = corner_values(space, rough[..., None], ghosts)[:, 0]
    chart = np.repeat(charts.labels[pieces.faces], np.diff(pieces.start)).astype(np.int64)
    at = np.flatnonzero(~np.isnan(corners[:, 0]) & ~np.isnan(errors) & (chart >= 0))
    count = len(charts.boxes)
    sides, first, index = np.unique(
        pieces.points[at] * count + chart[at], return_index=True, return_inverse=True
    )
    shown = _means(index, corners[at])
    point, side = np.divmod(sides, count)
    number, counts = np.unique(point, return_inverse=True, return_counts=True)[1:]
    seen = counts[number]
    seam = np.flatnonzero(seen > 1)
    if len(seam) == 0:
        return corners
    steps = (shown - _means(number, shown)[number])[seam]
    # The squared error of the mean of k sides, whose errors are independent: their sum / k^2.
    error = _means(number, _means(index, errors[at, None]))[number][seam] / seen[seam, None]
    places = pieces.places[at[first[seam]]]
    group = _groups(number[seam], side[seam])
    kept = _clear(steps, error, places, group)
    if same_material:
        kept *= _same_material(shown[seam], (shown[seam] - 2.0 * steps), error, places, group)
    clear = np.zeros_like(shown)
    clear[seam] = kept - steps
    found = corners.copy()
    found[at] += clear[index]
    return found


def _clear(steps: Floats, error: Floats, places: Floats, group: npt.NDArray[np.intp]) -> Floats:
    wide = _averaged(np.column_stack([steps, error]), places, group, _WIDE)
    lasting, explained = wide[:, :-1], wide[:, -1]
    independent = np.clip(np.bincount(group)[group] / _INDEPENDENT[0], 1.0, _INDEPENDENT[1])
    share = _standing_out((lasting**2).sum(axis=1), explained / independent, 1)
    rest = steps - lasting
    squares = np.column_stack([(rest**2).sum(axis=1), error])
    near = _averaged(squares, places, group, _NEAR)
    return share * lasting + _standing_out(near[:, 0], near[:, 1], 2) * rest


def _same_material(
    shown: Floats, other: Floats, error: Floats, places: Floats, group: npt.NDArray[np.intp]
) -> Floats:
    # How well the detail of both sides along the seam agrees, up to an offset and a factor: from 0
    # to 1. Seams with little detail are judged by all seams; without detail, the step decides.
    both = np.column_stack([shown, other])
    near = _averaged(np.column_stack([both, error]), places, group, _NEAR)
    wide = _averaged(both, places, group, _LONG)
    one, two = np.split(near[:, :-1] - wide, 2, axis=1)
    independent = np.clip(np.bincount(group)[group] / _INDEPENDENT[0], 1.0, _NEAR)
    # `error` is half the squared error of a side, because the second differences it is measured by
    # contain detail that both sides may share.
    chance = near[:, -1] / independent + _FAINT**2 * both.var(axis=0).sum()
    light = chance * _looks_like_light(*np.split(wide, 2, axis=1))
    products = [(one * two).sum(axis=1), (one**2).sum(axis=1), (two**2).sum(axis=1)]
    energies = np.column_stack([*products, chance, light])
    common, of_one, of_two, chance, light = _averaged(energies, places, group, _LONG).T
    all_common, all_one, all_two, all_chance, all_light = energies.mean(axis=0)
    common, chance, light = common + all_common, chance + all_chance, light + all_light
    total = np.sqrt(of_one * of_two) + np.sqrt(all_one * all_two)
    own = np.maximum(total - common - chance, 0.0) + (chance - light)
    agreeing = np.maximum(common, 0.0) + light
    share = agreeing / (own + agreeing + _NOTHING)
    return np.clip(
        (share - _AGREEMENT_RAMP[0]) / (_AGREEMENT_RAMP[1] - _AGREEMENT_RAMP[0]), 0.0, 1.0
    )[:, None]


def _looks_like_light(one: Floats, two: Floats) -> Floats:
    # How likely two plain sides are one color in two lights, from 0 to 1.
    dark = _DARK * np.abs(np.concatenate([one, two])).mean() + _NOTHING
    apart = np.log(np.maximum(one, 0.0) + dark) - np.log(np.maximum(two, 0.0) + dark)
    light = apart.mean(axis=1)
    tint = np.sqrt(((apart - light[:, None]) ** 2).sum(axis=1))
    likely: Floats = 1.0 / (1.0 + (tint / _TINT) ** 4 + (light / _LIGHT) ** 4)
    return likely


def _averaged(values: Floats, places: Floats, group: npt.NDArray[np.intp], size: float) -> Floats:
    # Averages along the seam between two charts; other seams are moved away in a third dimension.
    apart = np.column_stack([places, 4.0 * size * group])
    return MeansAround(apart, values, size).at(np.arange(len(places)))


def _standing_out(square: Floats, explained: Floats, power: int) -> Floats:
    share: Floats = square**power / (square**power + explained**power + _NOTHING)
    return share[:, None]


def _groups(point: npt.NDArray[np.intp], side: npt.NDArray[np.int64]) -> npt.NDArray[np.intp]:
    # A label for each chart and the charts that it meets at a point: the same all along a seam.
    others = np.bincount(point, np.sqrt(side + 2.0))[point]
    keys = np.column_stack([side, np.round(others, 6)])
    found: npt.NDArray[np.intp] = np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1)
    return found


def _means(index: npt.NDArray[np.intp], values: Floats) -> Floats:
    counts = np.bincount(index)
    return np.column_stack([np.bincount(index, column) / counts for column in values.T])
