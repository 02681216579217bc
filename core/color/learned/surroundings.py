# SPDX-License-Identifier: GPL-3.0-or-later
"""Features of the surroundings of a pixel: energies at a quarter and a sixteenth of the resolution.

They are means over squares of 4 and of 16 pixels, which begin at the image's corner: a part of an
image has the same squares as the whole if it begins at a multiple of 16 pixels. Textures have a
`Surroundings` class of their own.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
import numpy.typing as npt

from ...base.parallel import kernel, run
from ...grid.windows import smooth
from .rows import half_log

Singles = npt.NDArray[np.float32]

CELL = 16
"""Side of the largest squares, in pixels."""

WIDE = np.array([5, 4, 3, 2, 1], np.float32) / np.float32(25)
"""Weights of the smoothing over squares, from the center outwards: a standard deviation of 2, but
with a smaller radius than a Gaussian."""

BANDS = 5
"""Number of bands: differences between one smoothing and the next."""

POOLED = BANDS + 2
"""Number of energies: of the bands, and two squared gradients."""

TOLD_AROUND = 2 * POOLED + 5
"""Number of features of the surroundings; the total energy follows after them."""

WIDTH, TOTAL = TOLD_AROUND - 1, TOLD_AROUND
"""Indices of the squared width of borders, and of that total."""

SOFTEST = 6.0
"""Upper limit of the measured blur, as a Gaussian's sigma in pixels."""

WIDEST = 4.5
"""The widest blur that networks are trained to remove, as a sigma; softer borders must stay."""

_SHARPEST = 0.2

STRIP = 128
"""Rows of an image per chunk of a thread; a multiple of `CELL`."""


def reach_of_surroundings() -> int:
    """Return the radius in pixels within which energies affect features of the surroundings."""
    squares = len(WIDE)  # and one more, because values are interpolated between centers
    return (squares + 1) * CELL + 2 * 4


def reach_of_wide() -> int:
    """Return the radius in pixels within which energies affect means over squares of 4 pixels."""
    return (len(WIDE) + 1) * 4


class Surroundings(Protocol):
    """Computes means of energies over wide surroundings.

    Means are arrays (k, ...) whose further axes are known to these methods only.
    """

    def means(self, count: int, energies: Callable[[int, int], Singles]) -> Singles:
        """Average energies over squares of 4 pixels.

        Parameters
        ----------
        count : int
            Number of energies.
        energies : callable
            ``energies(top, bottom)`` computes those of some rows: (count, rows, w).
        """

    def smoothed(self, means: Singles, weighted: bool) -> Singles:
        """Smooth means over about 8 pixels; if `weighted`, the last array holds their weights."""

    def of_region(self, means: Singles, weighted: bool) -> Singles:
        """Smooth means over about 32 pixels."""

    def rows(self, means: Singles, start: int, stop: int) -> Singles:
        """Interpolate means at the pixels of some rows: (k, rows, w)."""


class Squares:
    """Surroundings in an image; means are (k, ceil(h / 4), ceil(w / 4)) float32."""

    def __init__(self, height: int, width: int) -> None:
        self._height = height
        self._places = places(width)

    def means(self, count: int, energies: Callable[[int, int], Singles]) -> Singles:
        """Average energies over squares of 4 pixels, strip by strip."""
        width = len(self._places[0])
        small = np.empty((count, -(-self._height // 4), -(-width // 4)), np.float32)

        def work(start: int, stop: int) -> None:
            found = energies(start, stop)
            part = np.empty((count, -(-(stop - start) // 4), small.shape[2]), np.float32)
            _reduce(0, count, found, part)
            small[:, start // 4 : start // 4 + part.shape[1]] = part

        run(work, self._height, chunk=STRIP)
        return small

    def smoothed(self, means: Singles, weighted: bool) -> Singles:
        """Smooth means over about 8 pixels."""
        out = np.empty_like(means)

        def work(start: int, stop: int) -> None:
            for k in range(start, stop):
                out[k] = smooth(means[k], WIDE)

        run(work, len(means), chunk=1)
        return averages(out, weighted)

    def of_region(self, means: Singles, weighted: bool) -> Singles:
        """Smooth means over about 32 pixels, at a sixteenth of the resolution."""
        largest = np.empty((len(means), *(-(-n // 4) for n in means.shape[1:])), np.float32)
        run(_reduce, len(means), means, largest, chunk=1)
        out = np.empty_like(means[: len(means) - weighted])
        wide = self.smoothed(largest, weighted)
        run(_enlarge, means.shape[1], wide, *places(means.shape[2]), out, chunk=STRIP)
        return out

    def rows(self, means: Singles, start: int, stop: int) -> Singles:
        """Interpolate means between the centers of squares."""
        out = np.empty((len(means), stop - start, len(self._places[0])), np.float32)
        _rows(start, stop, means, *self._places, out)
        return out


def averages(sums: Singles, weighted: bool) -> Singles:
    """Divide smoothed values, in place, by their smoothed weights, the last array."""
    if not weighted:
        return sums
    values, weights = sums[:-1], sums[-1]
    return np.divide(values, weights, out=values, where=weights > 0)


def told_around(
    around: Surroundings,
    small: Singles,
    weighted: bool,
    floor: float,
    slopes: tuple[float, float],
    square: float,
) -> Singles:
    """Compute the features of the surroundings.

    Parameters
    ----------
    around : Surroundings
    small : (9, ...) float32
        Means over squares of 4 pixels: energies of the bands, squared gradients of two smoothings,
        and square roots of two energies.
    weighted : bool
        Whether all are multiplied by the opacity, which is appended.
    floor : float
        Energy that counts as none.
    slopes : (float, float)
        Squared sigmas of the smoothings of these gradients.
    square : float
        Squared width of borders, as a Gaussian's sigma; 0 measures it.

    Returns
    -------
    (20, ...) float32
    """
    wide, region = around.smoothed(small, weighted), around.of_region(small, weighted)
    told = np.empty((TOLD_AROUND + 1, *small.shape[1:]), np.float32)
    limits = np.array([_SHARPEST**2, SOFTEST**2] if square == 0 else [square, square], np.float32)
    run(_tell, small.shape[1], wide, region, np.float32(floor), np.array(slopes, np.float32),
        limits, told, chunk=STRIP)  # fmt: skip
    return told


def relative(wide: Singles, total: Singles) -> Singles:
    """Return half the logarithms of energies over the total."""
    out = np.empty_like(wide)
    run(_tell_relative, len(wide), wide, total, out, chunk=1)
    return out


def places(width: int) -> tuple[npt.NDArray[np.int32], Singles]:
    """Find, for the pixels of a row, cells and fractions between centers of squares of 4 pixels."""
    place = np.clip((np.arange(width) + 0.5) / 4 - 0.5, 0, -(-width // 4) - 1)
    cell = place.astype(np.int32)
    return cell, (place - cell).astype(np.float32)


@kernel
def enlarged_row(planes, y, place, rest, line, out):
    """Interpolate a row of the image from planes at a quarter of the resolution.

    `line` is a buffer, longer by one than the rows of the planes.
    """
    m, h, w = planes.shape
    v = min(max((y + np.float32(0.5)) / 4 - np.float32(0.5), np.float32(0)), np.float32(h - 1))
    i = int(v)
    k = min(i + 1, h - 1)
    v -= np.float32(i)
    for n in range(m):
        above, below = planes[n, i], planes[n, k]
        for x in range(w):
            line[x] = above[x] + v * (below[x] - above[x])
        line[w] = line[w - 1]
        o = out[n]
        for x in range(len(place)):
            a = line[place[x]]
            o[x] = a + rest[x] * (line[place[x] + 1] - a)


@kernel
def _rows(start, stop, planes, place, rest, out):
    line = np.empty(planes.shape[2] + 1, np.float32)
    for y in range(start, stop):
        enlarged_row(planes, y, place, rest, line, out[:, y - start])


@kernel
def _enlarge(start, stop, planes, place, rest, out):
    line = np.empty(planes.shape[2] + 1, np.float32)
    for y in range(start, stop):
        enlarged_row(planes, y, place, rest, line, out[:, y])


@kernel
def _reduce(start, stop, planes, out):
    # Means over squares of 4 x 4 pixels; squares at the border may be smaller.
    _, h, w = planes.shape
    line = np.empty(w, np.float32)
    for n in range(start, stop):
        for y in range(out.shape[1]):
            last = min(4 * y + 4, h)
            line[:] = planes[n, 4 * y]
            for v in range(4 * y + 1, last):
                row = planes[n, v]
                for x in range(w):
                    line[x] += row[x]
            rows = last - 4 * y
            for x in range(out.shape[2]):
                total, right = line[4 * x], min(4 * x + 4, w)
                for u in range(4 * x + 1, right):
                    total += line[u]
                out[n, y, x] = total / np.float32(rows * (right - 4 * x))


@kernel
def _tell(start, stop, wide, region, floor, slopes, limits, told):
    # Half logarithms of energies over the total of the region, and the squared width of borders;
    # the total comes last.
    tiny = floor + np.float32(1e-30)
    for y in range(start, stop):
        for x in range(wide.shape[2]):
            total = tiny
            for k in range(BANDS):
                total += region[k, y, x]
            for k in range(POOLED):
                told[k, y, x] = half_log(wide[k, y, x] / total)
                told[POOLED + k, y, x] = half_log(region[k, y, x] / total)
            at = 2 * POOLED
            for e in (wide, region):
                # How sparse fine and coarse bands are.
                a, b = e[POOLED, y, x], e[POOLED + 1, y, x]
                told[at, y, x] = half_log((a * a + tiny) / (e[0, y, x] + e[1, y, x] + tiny))
                told[at + 1, y, x] = half_log((b * b + tiny) / (e[3, y, x] + tiny))
                at += 2
            # Summed across a border, squared slopes are proportional to 1 / width.
            a = wide[BANDS, y, x] + np.float32(0.25) * region[BANDS, y, x] + tiny
            b = wide[BANDS + 1, y, x] + np.float32(0.25) * region[BANDS + 1, y, x] + tiny
            r = (a / b) ** 2
            square = (slopes[1] - slopes[0] * r) / max(r - np.float32(1), np.float32(1e-6))
            told[at, y, x] = min(max(square, limits[0]), limits[1])
            told[at + 1, y, x] = total


@kernel
def _tell_relative(start, stop, wide, total, out):
    for k in range(start, stop):
        for y in range(out.shape[1]):
            for x in range(out.shape[2]):
                out[k, y, x] = half_log(wide[k, y, x] / total[y, x])
