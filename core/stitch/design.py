# SPDX-License-Identifier: GPL-3.0-or-later
"""Judges whether the steps of a texture were designed, by all its seams together.

Not in the papers. A plain color on both sides of a seam does not tell whether the step between
them is of light or by design, but all seams together do. If each chart has a light of its own,
nearly all seams have a step, and one factor, or one offset, for each chart explains them. In a
designed texture many seams have no step, because both sides have the same color, or a seam has
steps of different sizes, as where a border runs along a part of it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from ..base.checks import Floats

_Ints = npt.NDArray[np.int64]

DARK = 0.04
"""Share of the mean value that is added before logarithms are taken."""

_NO_STEP = 0.1
"""Steps up to this share of their root mean square count as none."""

_FITTING_RAMP = 0.4, 0.65
"""Ramp of the share of the seams, by length, without a step: up to the first value it is chance,
from the second on the texture was made in one light, and its steps were designed. If three of
thirteen charts have one light by chance, a third of all seams can be without a step."""

_UNEXPLAINED_RAMP = 0.02, 0.1
"""Ramp of the share of the squared steps that one factor or offset for each chart leaves: up to
the first value lights differ, from the second on colors."""

SMALL = 0.02
"""Steps up to this share of the mean value are too small to tell what they are."""

_ITERATIONS = 200
_PRECISION = 1e-4
_NOTHING = 1e-20


def how_designed(
    near: tuple[Floats, Floats],
    wide: tuple[Floats, Floats],
    error: Floats,
    charts: _Ints,
) -> float:
    """Measure how likely the steps between charts were designed.

    Parameters
    ----------
    near, wide : pair of (n, c) float64
        Values of both sides at points along seams, averaged over a few texels, and over many.
    error : (n,) float64
        Squared error of the difference of the near ones, which is not counted as unexplained.
    charts : (n, 2) int
        The charts of both sides. Each point is there twice, once from each side.

    Returns
    -------
    float
        From 0 for lights that differ to 1 for colors that do.
    """
    if len(charts) == 0:
        return 0.0
    charts = np.unique(charts, return_inverse=True)[1].reshape(-1, 2)
    level = np.abs(np.concatenate(wide)).mean() + _NOTHING
    squares = ((_logarithms(wide[0], level) - _logarithms(wide[1], level)) ** 2).sum(axis=1)
    fitting = 1.0 / (1.0 + (squares / (_NO_STEP**2 * squares.mean() + _NOTHING)) ** 2)
    left = min(_unexplained(steps, off, charts) for steps, off in steps_of(near, error, level))
    likely = 1.0 - _ramp(float(fitting.mean()), _FITTING_RAMP)
    likely *= 1.0 - _ramp(left, _UNEXPLAINED_RAMP)
    return 1.0 - likely


def steps_of(
    sides: tuple[Floats, Floats], error: Floats, level: float
) -> Iterator[tuple[Floats, Floats]]:
    """Yield the differences of two sides, and their squared errors: of logarithms, of values.

    Parameters
    ----------
    sides : pair of (n, c) float64
    error : (n,) float64
        Squared error of the differences of the values.
    level : float
        The mean value.

    Yields
    ------
    steps : (n, c) float64
        Of values, they are relative to the mean one.
    error : (n,) float64
    """
    mean = 0.5 * (sides[0] + sides[1]).mean(axis=1)
    yield (
        _logarithms(sides[0], level) - _logarithms(sides[1], level),
        error / (np.maximum(mean, 0.0) + DARK * level) ** 2,
    )
    yield (sides[0] - sides[1]) / level, error / level**2


def _logarithms(values: Floats, level: float) -> Floats:
    found: Floats = np.log(np.maximum(values, 0.0) + DARK * level)
    return found


def _ramp(value: float, between: tuple[float, float]) -> float:
    return min(max((value - between[0]) / (between[1] - between[0]), 0.0), 1.0)


def _unexplained(steps: Floats, error: Floats, charts: _Ints) -> float:
    # The share of the squared steps that one value for each chart leaves.
    count = int(charts.max()) + 1
    first, last = charts.min(axis=1), charts.max(axis=1)
    signs = np.where(charts[:, 0] == first, 1.0, -1.0)
    pairs, index, lengths = np.unique(first * count + last, return_inverse=True, return_counts=True)
    sums: Floats = np.stack([np.bincount(index, signs * each) for each in steps.T], axis=1)
    lights = _lights(pairs // count, pairs % count, lengths, sums, count)
    left = steps - lights[charts[:, 0]] + lights[charts[:, 1]]
    unexplained = np.maximum((left**2).sum(axis=1) - error, 0.0)
    return float(unexplained.mean()) / (float((steps**2).sum(axis=1).mean()) + SMALL**2)


def _lights(one: _Ints, other: _Ints, lengths: _Ints, sums: Floats, count: int) -> Floats:
    # (count, c): the value of each chart whose differences are closest to the steps between one
    # and the other; by conjugate gradients, preconditioned by the diagonal.
    def gathered(values: Floats) -> Floats:
        columns = [
            np.bincount(one, column, count) - np.bincount(other, column, count)
            for column in values.T
        ]
        return np.stack(columns, axis=1)

    diagonal = (np.bincount(one, lengths, count) + np.bincount(other, lengths, count))[:, None]
    lights = np.zeros((count, sums.shape[1]))
    direction, before = np.zeros_like(lights), 1.0
    rest = gathered(sums)
    enough = _PRECISION**2 * float((rest**2 / diagonal).sum())
    for number in range(_ITERATIONS):
        scaled = rest / diagonal
        size = float((rest * scaled).sum())
        if size <= enough:
            break
        direction = scaled + (size / before if number else 0.0) * direction
        moved = (direction[one] - direction[other]) * lengths[:, None]
        product = gathered(moved)
        step = size / float((direction * product).sum())
        lights += step * direction
        rest -= step * product
        before = size
    return lights
