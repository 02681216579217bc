# SPDX-License-Identifier: GPL-3.0-or-later
"""Channels of an image as planes of float32, with their opacity.

All that depends on the neighbours of pixels is computed by `Planes`, so that the stages also work
for other kinds of neighbours, such as those of texels in an atlas, by a subclass.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...base.checks import BAND, SCALES
from ...base.parallel import blocks, kernel, run
from ...base.progress import aside, ask
from ...grid.advect import advect_pixels
from ...grid.channels import Channels
from ...grid.part import Part
from ...grid.potential import image_potential, smoothed_potential
from ...grid.windows import gaussian, least_and_greatest, smooth_rows
from .rows import add_slopes
from .surroundings import STRIP, Singles, Squares, Surroundings

NONE = np.empty((0, 0), np.float32)

gaussian_of = cache(gaussian)


def variance_of(sigma: float) -> float:
    """Return the variance of the weights of a Gaussian, which are truncated."""
    weights = gaussian_of(sigma).astype(np.float64)
    return float(2.0 * (np.arange(len(weights)) ** 2 @ weights))


class Plan(NamedTuple):
    """The flow of an image.

    Attributes
    ----------
    times : (h, w) float32
        Flow time of each pixel.
    shares : (h, w) float32
        Weight, from 0 to 1, of a potential that is smoothed further.
    passes : int
        Number of these further smoothing passes.
    """

    times: Singles
    shares: Singles
    passes: int


@dataclass(frozen=True)
class Planes:
    """Channels of an image.

    Attributes
    ----------
    values : (c, h, w) float32
        In the image's range; 0 at hidden pixels.
    opacity : (h, w) float32 in [0, 1], or (0, 0) if all is visible
    """

    values: Singles
    opacity: Singles

    whole = False
    """Whether all rows must be smoothed together."""

    @property
    def weighted(self) -> bool:
        """Whether energies have weights, which `with_weights` appends."""
        return self.opacity.size > 0

    @classmethod
    def of(cls, pixels: npt.NDArray, channels: Channels) -> Planes:
        """Take the filtered channels of an image (h, w, c)."""
        height, width = pixels.shape[:2]
        values = np.empty((channels.stop - channels.start, height, width), np.float32)
        opacity = np.empty((height, width) if channels.alpha >= 0 else (0, 0), np.float32)
        scale = SCALES[pixels.dtype.name]
        for band in blocks(height, BAND):
            colors = pixels[band, :, channels.start : channels.stop]
            values[:, band] = np.moveaxis(colors, 2, 0)
            if channels.alpha >= 0:
                opacity[band] = scale * pixels[band, :, channels.alpha]
                values[:, band][:, opacity[band] == 0] = 0
        return cls(values, opacity)

    def with_values(self, values: Singles) -> Planes:
        """Return other values of the same opacity."""
        return Planes(values, self.opacity)

    def forget(self) -> None:
        """Free what only the first stage needs."""

    def columns(self, start: int, stop: int) -> slice | npt.NDArray[np.bool_]:
        """Return the index of the pixels to compute among those of some rows, flattened."""
        return slice(None)

    def told(self, start: int, stop: int) -> Singles:
        """Return features of some rows in addition to those of the stages: (k, rows, w)."""
        return np.empty((0, stop - start, self.values.shape[2]), np.float32)

    def surroundings(self) -> Surroundings:
        """Return an object that computes means over wide surroundings."""
        return Squares(*self.values.shape[1:])

    def premultiplied(self) -> Planes:
        """Return the values times their opacity, as planes without opacity."""
        return Planes(self.values * self.opacity, NONE) if self.opacity.size else self

    def with_weights(self, energies: Singles, top: int, bottom: int) -> Singles:
        """Append the opacity, if there is one, to energies of some rows: (k, rows, w)."""
        if self.opacity.size:
            energies = np.concatenate([energies, self.opacity[None, top:bottom]])
        return np.ascontiguousarray(energies)

    def averaged(
        self, energies: Singles, first: int, sigma: float, top: int, bottom: int
    ) -> Singles:
        """Smooth energies that are weighted by opacity and begin at row `first`: (k, rows, w)."""
        weights = gaussian_of(sigma)
        count, rows, width = energies.shape
        height = self.values.shape[1]
        out = np.empty((count, bottom - top, width), np.float32)
        for energy, target in zip(energies, out, strict=True):
            ask()
            smooth_rows(energy, first, height, weights, top, target)
        if not self.opacity.size:
            return out
        spread = np.empty(out.shape[1:], np.float32)
        smooth_rows(self.opacity[first : first + rows], first, height, weights, top, spread)
        return np.divide(out, spread, out=out, where=spread > 0)

    def smoothed(self, sigmas: tuple[float, ...], top: int, bottom: int) -> Singles:
        """Smooth some rows by growing widths, weighted by opacity: (k, c, rows, w)."""
        count, _, width = self.values.shape
        out = np.empty((len(sigmas), count, bottom - top, width), np.float32)
        for smooth, sigma in zip(out, sigmas, strict=True):
            ask()
            self._smooth(gaussian_of(sigma), top, bottom, smooth)
        return out

    def _smooth(self, weights: Singles, top: int, bottom: int, out: Singles) -> None:
        height = self.values.shape[1]
        if not self.opacity.size:
            for plane, target in zip(self.values, out, strict=True):
                smooth_rows(plane, 0, height, weights, top, target)
            return
        reach = len(weights) - 1
        first, last = max(top - reach, 0), min(bottom + reach, height)
        opacity, spread = self.opacity[first:last], np.empty(out.shape[1:], np.float32)
        smooth_rows(opacity, first, height, weights, top, spread)
        for plane, target in zip(self.values, out, strict=True):
            smooth_rows(plane[first:last] * opacity, first, height, weights, top, target)
            np.divide(target, spread, out=target, where=spread > 0)

    def slopes(self, smooth: Singles) -> Singles:
        """Measure four times the squared gradient of values, averaged over channels.

        Parameters
        ----------
        smooth : (c, rows, w) float32
            At the first and the last row, one-sided differences are used.

        Returns
        -------
        (rows, w) float32
        """
        out = np.zeros(smooth.shape[1:], np.float32)
        if self.whole:
            with aside("Sharpening"):
                run(_slopes, len(out), smooth, out, chunk=STRIP)
        else:
            _slopes(0, len(out), smooth, out)
        return out

    def ranges(self, reaches: tuple[int, ...], top: int, bottom: int) -> tuple[Singles, Singles]:
        """Find the least and greatest visible values in windows of growing reach.

        Returns
        -------
        low, high : (r, c, rows, w) float32
            For the rows from `top` to `bottom`; rows outside are ignored.
        """
        band = self.values[:, top:bottom]
        low, high = (np.empty((len(reaches), *band.shape), np.float32) for _ in range(2))
        hidden = self.opacity[top:bottom] == 0 if self.opacity.size else None
        done = 0
        for r, reach in enumerate(reaches):
            low[r], high[r] = (low[r - 1], high[r - 1]) if r else (band, band)
            if hidden is not None and r == 0:
                low[r][:, hidden], high[r][:, hidden] = np.inf, -np.inf
            for least, most in zip(low[r], high[r], strict=True):
                ask()
                least_and_greatest(least, most, reach - done)
            done = reach
        if hidden is not None:
            low[..., hidden], high[..., hidden] = 0, 0
        return low, high

    def flowed(
        self,
        plan: Plan,
        brightness: Singles,
        passes: int,
        nearest: bool,
        part: Part | None,
    ) -> Planes:
        """Advect the values.

        Parameters
        ----------
        plan : Plan
        brightness : (k,) float32
            As in `Channels`.
        passes : int
            Smoothing passes on the flow.
        nearest : bool
            As in `advect_pixels`.
        part : Part, optional
            The pixels that are wanted, if the image is a part of another one; others stay.
        """
        pixels, channels = self.interleaved(brightness)
        potential = image_potential(pixels, 1.0, channels, passes)
        wide = smoothed_potential(potential.copy(), plan.passes)
        run(mix_potentials, len(wide), potential, wide, plan.shares, chunk=STRIP)
        out = pixels.copy()
        advect_pixels(pixels, channels, wide, plan.times, out, nearest=nearest, part=part)
        return self.with_values(planes_of(out[..., : channels.stop]))

    def interleaved(self, brightness: Singles) -> tuple[Singles, Channels]:
        """Return pixels (h, w, c), with opacity as the last channel if there is one."""
        count, height, width = self.values.shape
        alpha = count if self.opacity.size else -1
        pixels = np.empty((height, width, count + (alpha >= 0)), np.float32)
        pixels[..., :count] = np.moveaxis(self.values, 0, 2)
        if alpha >= 0:
            pixels[..., alpha] = self.opacity
        return pixels, Channels(0, count, alpha, brightness)


class WholePlanes(Planes, ABC):
    """Planes whose rows are smoothed together; smoothings and ranges are cached."""

    whole = True

    def forget(self) -> None:
        """Free all cached arrays except the widest ranges."""
        self._kept_smooth.clear()
        last = max(self._ranges, key=max)
        kept = tuple(each[-1:].copy() for each in self._ranges[last])
        self._ranges.clear()
        self._ranges[last[-1:]] = kept[0], kept[1]

    def smoothed(self, sigmas: tuple[float, ...], top: int, bottom: int) -> Singles:
        """Smooth all rows by growing widths, weighted by opacity: (k, c, rows, w)."""
        if sigmas not in self._kept_smooth:
            self._kept_smooth[sigmas] = self._smoothed(sigmas)
        return self._kept_smooth[sigmas]

    def ranges(self, reaches: tuple[int, ...], top: int, bottom: int) -> tuple[Singles, Singles]:
        """Find the least and greatest visible values within some steps: (r, c, rows, w)."""
        if reaches not in self._ranges:
            low, high = self._found_ranges(reaches)
            for r, reach in enumerate(reaches):
                self._ranges[(reach,)] = low[r, None], high[r, None]
            self._ranges[reaches] = low, high
        return self._ranges[reaches]

    @abstractmethod
    def _smoothed(self, sigmas: tuple[float, ...]) -> Singles: ...

    @abstractmethod
    def _found_ranges(self, reaches: tuple[int, ...]) -> tuple[Singles, Singles]: ...

    @cached_property
    def _kept_smooth(self) -> dict[tuple[float, ...], Singles]:
        return {}

    @cached_property
    def _ranges(self) -> dict[tuple[int, ...], tuple[Singles, Singles]]:
        return {}


def planes_of(pixels: Singles) -> Singles:
    """Return the channels of pixels (h, w, c) as separate planes: (c, h, w)."""
    return np.ascontiguousarray(np.moveaxis(pixels, 2, 0))


@kernel
def _slopes(start, stop, smooth, out):
    share = np.float32(1 / len(smooth))
    for y in range(start, stop):
        for i in range(len(smooth)):
            add_slopes(share, smooth[i], y, out[y])


@kernel
def mix_potentials(start, stop, fine, wide, shares):
    """Mix two potentials by the weights of the second, in place of the second."""
    for y in range(start, stop):
        for x in range(fine.shape[1]):
            wide[y, x] = fine[y, x] + shares[y, x] * (wide[y, x] - fine[y, x])


@kernel
def keep_within(start, stop, first, base, d, shares, low, high, out):
    """Add differences times their weights to rows of the base, clipped to a range.

    Parameters
    ----------
    start, stop : int
        Rows.
    first : int
        The row that `low` and `high` begin with.
    base, out : (c, h, w)
    d : (k, c, stop - start, w)
    shares : (k, stop - start, w)
    low, high : (c, rows, w)
    """
    c, _, w = base.shape
    total = np.empty(w, np.float32)
    for y in range(start, stop):
        n = y - start
        for i in range(c):
            b, least, most, o = base[i, y], low[i, y - first], high[i, y - first], out[i, y]
            total[:] = 0
            for k in range(len(shares)):
                share, difference = shares[k, n], d[k, i, n]
                for x in range(w):
                    total[x] += share[x] * difference[x]
            for x in range(w):
                o[x] = min(max(b[x] + total[x], least[x]), most[x])
