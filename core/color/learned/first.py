# SPDX-License-Identifier: GPL-3.0-or-later
"""The first stage: differences of smoothings, and unsharp masks that stay within the local range.

Features do not depend on directions, colors or the brightness of the image. They are ratios of
energies, products of differences, and positions within local ranges.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.parallel import kernel, run
from ...base.progress import aside
from .planes import Planes, gaussian_of
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
    BANDS,
    POOLED,
    STRIP,
    TOLD_AROUND,
    TOTAL,
    Singles,
    told_around,
)

SIGMAS = 0.6, 1.0, 1.6, 2.6, 4.5
"""Sigmas of the smoothings, in pixels."""

SLOPES = 0, 2
"""Indices of the smoothings whose gradients are compared."""

REACHES = 1, 2, 7
"""Radii of the windows of least and greatest values; results stay within the last."""

MASKS = (1, 2.0), (2, 3.0), (3, 4.0)
"""For each unsharp mask, the index of the smoothing and the factor of the difference to it. Its
result stays within the window of the same index in `REACHES`."""

DIFFERENCES = BANDS + len(MASKS)
"""Number of differences that the first network weighs."""

TOLD = (TOLD_AROUND + POOLED + BANDS * (BANDS + 1) // 2 + 3 * len(REACHES) + len(MASKS)
        + len(SLOPES))  # fmt: skip
"""Number of its features of each pixel."""

NEAR = 1.8
"""Sigma of the smoothing of near energies."""

HALO = max(len(gaussian_of(NEAR)), REACHES[-1] + 1)
"""Rows around a strip whose smoothings are needed: for near energies, whose gradients need one row
more, and for windows."""

REACH = HALO + len(gaussian_of(SIGMAS[-1]))
"""Radius in pixels within which an image affects near energies."""


class First:
    """The first stage for an image, whose strips are computed on demand.

    Parameters
    ----------
    planes : Planes
    floor : float
        Energy that counts as none.
    square : float
        Squared width of borders, as a Gaussian's sigma; 0 measures it everywhere.
    """

    told, differences = TOLD, DIFFERENCES

    def __init__(self, planes: Planes, floor: float, square: float = 0.0) -> None:
        self.planes = planes
        self.base = planes.values
        height = planes.values.shape[1]

        def energies(top: int, bottom: int) -> Singles:
            around = max(top - 1, 0), min(bottom + 1, height)
            smooth = planes.smoothed(SIGMAS, *around)
            found = _energies_of(planes, smooth, *around)[:, top - around[0] : bottom - around[0]]
            return planes.with_weights(found, top, bottom)

        weighted = planes.weighted
        self.surroundings = planes.surroundings()
        small = self.surroundings.means(POOLED + 2 + weighted, energies)
        sigmas = SIGMAS[SLOPES[0]], SIGMAS[SLOPES[1]]
        self.around = told_around(self.surroundings, small, weighted, floor,
                                  (sigmas[0] ** 2, sigmas[1] ** 2), square)  # fmt: skip

    def strip(self, top: int, bottom: int) -> FirstStrip:
        """Prepare a strip of rows."""
        height = self.base.shape[1]
        first, last = max(top - HALO, 0), min(bottom + HALO, height)
        smooth = self.planes.smoothed(SIGMAS, first, last)
        low, high = self.planes.ranges(REACHES, first, last)
        energies = _energies_of(self.planes, smooth, first, last)
        near = self.planes.averaged(energies[:POOLED], first, NEAR, top, bottom)
        return FirstStrip(self, top, first, smooth, low, high, energies, near)


@dataclass(frozen=True)
class FirstStrip:
    """A strip of rows. Arrays begin at row `first`, but those of near energies at row `top`."""

    stage: First
    top: int
    first: int
    smooth: Singles
    low: Singles
    high: Singles
    energies: Singles
    near: Singles

    @property
    def limits(self) -> tuple[int, Singles, Singles]:
        """The row that limits begin with, and the least and greatest values of results."""
        return self.first, self.low[-1], self.high[-1]

    def rows(self, start: int, stop: int) -> tuple[Singles, Singles]:
        """Compute the differences of some rows, (k, c, rows, w), and features, (f, rows, w)."""
        values = self.stage.base
        c, _, w = values.shape
        differences = np.empty((DIFFERENCES, c, stop - start, w), np.float32)
        told = np.empty((TOLD, stop - start, w), np.float32)
        opacity = self.stage.planes.opacity
        large = self.stage.surroundings.rows(self.stage.around, start, stop)
        _tell(start, stop, self.top, self.first, values, opacity, self.smooth, self.low, self.high,
              self.energies, self.near, large, differences, told)  # fmt: skip
        return differences, told


def _energies_of(planes: Planes, smooth: Singles, top: int, bottom: int) -> Singles:
    # Correct in all rows but the first and the last, unless the image ends there.
    out = np.empty((POOLED + 2, *smooth.shape[2:]), np.float32)
    slopes = planes.slopes(smooth[SLOPES[0]]), planes.slopes(smooth[SLOPES[1]])
    given = top, planes.values, planes.opacity, smooth, *slopes, out
    if planes.whole:
        with aside("Sharpening"):
            run(_energies, bottom - top, *given, chunk=STRIP)
    else:
        _energies(0, bottom - top, *given)
    return out


@kernel
def _energies(start, stop, top, values, opacity, smooth, fine_slopes, slopes, out):
    # Squared bands, squared gradients of two smoothings, and square roots of two band energies.
    c = values.shape[0]
    share = np.float32(1 / c)
    for n in range(start, stop):
        for k in range(BANDS):
            out[k, n] = 0
        out[BANDS, n], out[BANDS + 1, n] = fine_slopes[n], slopes[n]
        for i in range(c):
            before = values[i, top + n]
            for k in range(BANDS):
                now = smooth[k, i, n]
                add_squared_difference(share, before, now, out[k, n])
                before = now
        a, b, d = out[0, n], out[1, n], out[3, n]
        fine, coarse = out[BANDS + 2, n], out[BANDS + 3, n]
        for x in range(len(a)):
            fine[x] = np.sqrt(a[x] + b[x])
            coarse[x] = np.sqrt(d[x])
        if opacity.size > 0:
            for k in range(BANDS + 4):
                multiply(opacity[top + n], out[k, n])


@kernel
def _put_differences(y, n, first, values, smooth, low, high, d):
    for i in range(values.shape[0]):
        before = values[i, y]
        for k in range(BANDS):
            now = smooth[k, i, y - first]
            put_difference(before, now, d[k, i, n])
            before = now
        value = values[i, y]
        for k in range(len(MASKS)):
            at, times = MASKS[k]
            base, factor = smooth[at, i, y - first], np.float32(times)
            least, most, out = low[k, i, y - first], high[k, i, y - first], d[BANDS + k, i, n]
            for x in range(len(out)):
                v = value[x] + factor * (value[x] - base[x])
                out[x] = min(max(v, least[x]), most[x]) - value[x]


@kernel
def _tell(start, stop, top, first, values, opacity, smooth, low, high, energies, near, large,
          d, told):  # fmt: skip
    c, _, w = values.shape
    share = np.float32(1 / c)
    inverse, scale, spare = (
        np.empty(w, np.float32), np.empty(w, np.float32), np.empty(w, np.float32)
    )  # fmt: skip
    value, away = np.empty((c, w), np.float32), np.empty((c, w), np.float32)
    least, most = np.empty((c, w), np.float32), np.empty((c, w), np.float32)
    for y in range(start, stop):
        n = y - start
        _put_differences(y, n, first, values, smooth, low, high, d)
        for k in range(TOTAL):
            told[k, n] = large[k, n]
        total = large[TOTAL, n]
        scales_of(near, top, y, BANDS, share, total, inverse, scale)
        at = TOTAL
        for k in range(POOLED):
            put_logs(inverse, near[k, y - top], told[at, n])
            at += 1
        at = tell_products(scale, d, BANDS, n, told, at)
        for r in range(len(REACHES)):
            for i in range(c):
                value[i] = values[i, y]
                put_difference(value[i], smooth[1 + r, i, y - first], away[i])
                least[i], most[i] = low[r, i, y - first], high[r, i, y - first]
            tell_range(share, inverse, total, value, least, most, away, spare, told[at, n],
                       told[at + 1, n], told[at + 2, n])  # fmt: skip
            at += 3
        for k in range(len(MASKS)):
            spare[:] = 0
            for i in range(c):
                add_square(share, d[BANDS + k, i, n], spare)
            put_logs(inverse, spare, told[at, n])
            at += 1
        for k in range(2):
            spare[:] = energies[BANDS + k, y - first]
            if opacity.size > 0:
                for x in range(w):
                    spare[x] /= max(opacity[y, x], np.float32(1e-6))
            put_logs(inverse, spare, told[at, n])
            at += 1
