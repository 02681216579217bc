# SPDX-License-Identifier: GPL-3.0-or-later
"""The second stage: the result of the first is advected to its borders, and smoothed a little."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...base.parallel import kernel, run
from ...base.progress import aside
from .first import DIFFERENCES as FIRST_DIFFERENCES
from .first import NEAR, REACHES, First
from .planes import Plan, Planes, gaussian_of
from .rows import (
    add_square,
    add_squared_difference,
    multiply,
    put_difference,
    put_logs,
    scales_of,
    tell_products,
    tell_range,
)
from .surroundings import (
    STRIP,
    TOLD_AROUND,
    TOTAL,
    WIDTH,
    Singles,
    reach_of_wide,
    relative,
)

DIFFERENCES = 5
"""Number of differences that the second network weighs."""

TOLD = (TOLD_AROUND + FIRST_DIFFERENCES + DIFFERENCES * (DIFFERENCES + 1) // 2
        + 2 * DIFFERENCES + 3)  # fmt: skip
"""Number of its features of each pixel."""

SPAN = 1
"""Index, in `REACHES`, of the window whose range is the contrast of a border."""

RATE, CELLS, TEXTURE = 0.7, 3.0, 0.3
"""A border closes in the time `RATE` * width^4 / contrast^2. `CELLS` is added to squared widths for
the coarseness of the grid. `TEXTURE` times the total energy around is added to squared contrasts,
so that pure texture hardly flows."""

SOFT = 0.7, 1.5
"""Sigmas of two smoothings of the first stage's result."""

FLOWED = 0.5
"""Sigma of the smoothing of the advected image."""

SMOOTHER, WIDELY = 16, 3.0
"""Further smoothing passes on the potential of wide borders, where small errors of values would
divert flow-lines; and the width, as a Gaussian's sigma, at which that potential has half of the
weight."""

_SQUARED_WIDTH = 6.57
"""Squared width, from 10 to 90 percent, of a border blurred by a Gaussian of sigma 1."""

_FAINT = 0.05
"""Least opacity in the computation of flow times; less opaque pixels count as having this one."""

_CONTRAST = REACHES[SPAN] / 2

REACH = reach_of_wide() + len(gaussian_of(FLOWED)) + len(gaussian_of(NEAR))
"""Radius in pixels within which the flowed image affects a pixel."""


def flow_plan(first: First) -> Plan:
    """Find the flow time of each pixel, and the weight of the smoother potential."""
    _, height, width = first.base.shape
    times, shares = (np.empty((height, width), np.float32) for _ in range(2))
    premultiplied = first.planes.premultiplied()
    reach = REACHES[SPAN]
    around = len(gaussian_of(_CONTRAST)) - 1

    def find_contrasts(start: int, stop: int) -> None:
        top, bottom = max(start - around, 0), min(stop + around, height)
        outer = max(top - reach, 0), min(bottom + reach, height)
        low, high = premultiplied.ranges((reach,), *outer)
        contrast = np.empty((bottom - top, width), np.float32)
        _contrasts(top, bottom, outer[0], low[0], high[0], contrast)
        times[start:stop] = premultiplied.averaged(contrast[None], top, _CONTRAST, start, stop)[0]

    def find_times(start: int, stop: int) -> None:
        large = first.surroundings.rows(first.around[WIDTH:], start, stop)
        _times(start, stop, large, first.planes.opacity, times, shares)

    with aside("Computing the flow"):
        if first.planes.whole:
            find_contrasts(0, height)
        else:
            run(find_contrasts, height, chunk=STRIP)
        run(find_times, height, chunk=STRIP)
    return Plan(times, shares, SMOOTHER)


class Second:
    """The second stage for an image, whose strips are computed on demand.

    Parameters
    ----------
    first : First
    result : Planes
        The first stage's result.
    shares : (k, h, w) float16
        The weights of its differences.
    moved : Planes
        The advected result.
    """

    told, differences = TOLD, DIFFERENCES

    def __init__(
        self, first: First, result: Planes, shares: npt.NDArray[np.float16], moved: Planes
    ) -> None:
        self.first, self.result, self.shares, self.moved = first, result, shares, moved
        self.planes = first.planes
        self.base = result.values
        weighted = result.weighted
        self.surroundings = first.surroundings
        small = self.surroundings.means(DIFFERENCES + weighted, self._energies)
        wide = relative(self.surroundings.smoothed(small, weighted), first.around[TOTAL])
        self.around = np.concatenate([first.around[:TOTAL], wide, first.around[TOTAL:]])

    def _smoothed(self, top: int, bottom: int) -> tuple[Singles, Singles]:
        soft = self.result.smoothed(SOFT, top, bottom)
        (flowed,) = self.moved.smoothed((FLOWED,), top, bottom)
        return soft, np.stack([self.moved.values[:, top:bottom], flowed])

    def _energies(self, top: int, bottom: int) -> Singles:
        found = self._energies_of(top, bottom, *self._smoothed(top, bottom))
        return self.result.with_weights(found, top, bottom)

    def _energies_of(self, top: int, bottom: int, soft: Singles, moved: Singles) -> Singles:
        out = np.empty((DIFFERENCES, bottom - top, self.base.shape[2]), np.float32)
        planes = self.planes
        given = top, planes.values, planes.opacity, self.base, soft, moved, out
        if planes.whole:
            with aside("Sharpening"):
                run(_energies, bottom - top, *given, chunk=STRIP)
        else:
            _energies(0, bottom - top, *given)
        return out

    def strip(self, top: int, bottom: int) -> SecondStrip:
        """Prepare a strip of rows."""
        height = self.base.shape[1]
        reach = max(len(gaussian_of(NEAR)) - 1, REACHES[-1])
        first, last = max(top - reach, 0), min(bottom + reach, height)
        soft, moved = self._smoothed(first, last)
        energies = self._energies_of(first, last, soft, moved)
        near = self.result.averaged(energies, first, NEAR, top, bottom)
        low, high = self.result.ranges((1,), first, last)
        least, most = self.planes.ranges((REACHES[-1],), first, last)
        limits = first, least[0], most[0]
        return SecondStrip(self, top, first, soft, moved, near, low[0], high[0], limits)


@dataclass(frozen=True)
class SecondStrip:
    """A strip of rows. Arrays begin at row `first`, but those of near energies at row `top`."""

    stage: Second
    top: int
    first: int
    soft: Singles
    moved: Singles
    near: Singles
    low: Singles
    high: Singles
    limits: tuple[int, Singles, Singles]

    def rows(self, start: int, stop: int) -> tuple[Singles, Singles]:
        """Compute the differences of some rows, (k, c, rows, w), and features, (f, rows, w)."""
        stage = self.stage
        c, _, w = stage.base.shape
        differences = np.empty((DIFFERENCES, c, stop - start, w), np.float32)
        told = np.empty((TOLD, stop - start, w), np.float32)
        shares = stage.shares[:, start:stop].astype(np.float32)
        large = stage.surroundings.rows(stage.around, start, stop)
        _tell(start, stop, self.top, self.first, stage.first.base, stage.base, self.soft,
              self.moved, shares, self.low, self.high, self.near, large, differences,
              told)  # fmt: skip
        return differences, told


@kernel
def _contrasts(top, bottom, first, low, high, out):
    for y in range(top, bottom):
        o = out[y - top]
        o[:] = 0
        for i in range(len(low)):
            add_squared_difference(np.float32(1), high[i, y - first], low[i, y - first], o)
        for x in range(len(o)):
            o[x] = np.sqrt(o[x])


@kernel
def _times(start, stop, large, opacity, times, shares):
    # On input, `times` holds contrasts.
    width = times.shape[1]
    for y in range(start, stop):
        row, squared, total = times[y], large[0, y - start], large[1, y - start]
        if opacity.size > 0:
            for x in range(width):
                total[x] *= max(opacity[y, x], np.float32(_FAINT)) ** 2
        for x in range(width):
            s = np.float32(_SQUARED_WIDTH) * squared[x] + np.float32(CELLS)
            contrast = row[x] * row[x] + np.float32(TEXTURE) * total[x]
            row[x] = np.float32(RATE) * s * s / contrast
            fourth = squared[x] * squared[x]
            shares[y, x] = fourth / (fourth + np.float32(WIDELY**4))


@kernel
def _put_differences(y, n, first, values, base, soft, moved, d):
    for i in range(base.shape[0]):
        at = y - first
        put_difference(moved[0, i, at], base[i, y], d[0, i, n])
        put_difference(moved[1, i, at], moved[0, i, at], d[1, i, n])
        put_difference(base[i, y], soft[0, i, at], d[2, i, n])
        put_difference(soft[0, i, at], soft[1, i, at], d[3, i, n])
        put_difference(values[i, y], base[i, y], d[4, i, n])


@kernel
def _energies(start, stop, top, values, opacity, base, soft, moved, out):
    c, _, w = base.shape
    d = np.empty((DIFFERENCES, c, 1, w), np.float32)
    share = np.float32(1 / c)
    for y in range(top + start, top + stop):
        _put_differences(y, 0, top, values, base, soft, moved, d)
        for k in range(DIFFERENCES):
            o = out[k, y - top]
            o[:] = 0
            for i in range(c):
                add_square(share, d[k, i, 0], o)
            if opacity.size > 0:
                multiply(opacity[y], o)


@kernel
def _tell(start, stop, top, first, values, base, soft, moved, shares, low, high, near, large,
          d, told):  # fmt: skip
    c, _, w = base.shape
    share = np.float32(1 / c)
    last = len(large) - 1
    inverse, scale, spare = (
        np.empty(w, np.float32), np.empty(w, np.float32), np.empty(w, np.float32)
    )  # fmt: skip
    value, other = np.empty((c, w), np.float32), np.empty((c, w), np.float32)
    least, most = np.empty((c, w), np.float32), np.empty((c, w), np.float32)
    for y in range(start, stop):
        n = y - start
        _put_differences(y, n, first, values, base, soft, moved, d)
        for k in range(last):
            told[k, n] = large[k, n]
        total = large[last, n]
        at = last
        for k in range(len(shares)):
            told[at, n] = shares[k, n]
            at += 1
        scales_of(near, top, y, DIFFERENCES, share, total, inverse, scale)
        at = tell_products(scale, d, DIFFERENCES, n, told, at)
        for k in range(DIFFERENCES):
            put_logs(inverse, near[k, y - top], told[at, n])
            at += 1
        for i in range(c):
            value[i] = base[i, y]
            other[i] = d[0, i, n]
            least[i], most[i] = low[i, y - first], high[i, y - first]
        tell_range(share, inverse, total, value, least, most, other, spare, told[at, n],
                   told[at + 1, n], told[at + 2, n])  # fmt: skip
