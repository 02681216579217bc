# SPDX-License-Identifier: GPL-3.0-or-later
"""Channels of an image as planes of float32, beside their opacity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...base.checks import BAND, SCALES
from ...base.parallel import blocks, kernel
from ...grid.channels import Channels
from ...grid.windows import least_and_greatest, smooth_rows

Singles = npt.NDArray[np.float32]

NONE = np.empty((0, 0), np.float32)


@dataclass(frozen=True)
class Planes:
    """Channels of an image.

    Attributes
    ----------
    values : (c, h, w) float32
        In the image's range; 0 where nothing is visible.
    opacity : (h, w) float32 in [0, 1], or (0, 0) if all is visible
    """

    values: Singles
    opacity: Singles

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

    def premultiplied(self) -> Planes:
        """Return the values times their opacity, all of which count alike."""
        return Planes(self.values * self.opacity, NONE) if self.opacity.size else self

    def with_opacity(self, energies: Singles, top: int, bottom: int) -> Singles:
        """Return energies of some rows, (k, rows, w), with the opacity if there is one."""
        if self.opacity.size:
            energies = np.concatenate([energies, self.opacity[None, top:bottom]])
        return np.ascontiguousarray(energies)

    def averaged(
        self, energies: Singles, first: int, weights: Singles, top: int, bottom: int
    ) -> Singles:
        """Smooth energies that were weighted by opacity: (k, rows from `first` on, w)."""
        count, rows, width = energies.shape
        height = self.values.shape[1]
        out = np.empty((count, bottom - top, width), np.float32)
        for energy, target in zip(energies, out, strict=True):
            smooth_rows(energy, first, height, weights, top, target)
        if not self.opacity.size:
            return out
        spread = np.empty(out.shape[1:], np.float32)
        smooth_rows(self.opacity[first : first + rows], first, height, weights, top, spread)
        return np.divide(out, spread, out=out, where=spread > 0)

    def smoothed(self, weights: Singles, top: int, bottom: int) -> Singles:
        """Smooth some rows, weighted by opacity: (c, rows, w)."""
        count, height, width = self.values.shape
        out = np.empty((count, bottom - top, width), np.float32)
        if not self.opacity.size:
            for plane, target in zip(self.values, out, strict=True):
                smooth_rows(plane, 0, height, weights, top, target)
            return out
        reach = len(weights) - 1
        first, last = max(top - reach, 0), min(bottom + reach, height)
        opacity, spread = self.opacity[first:last], np.empty(out.shape[1:], np.float32)
        smooth_rows(opacity, first, height, weights, top, spread)
        for plane, target in zip(self.values, out, strict=True):
            smooth_rows(plane[first:last] * opacity, first, height, weights, top, target)
            np.divide(target, spread, out=target, where=spread > 0)
        return out

    def ranges(self, reaches: tuple[int, ...], top: int, bottom: int) -> tuple[Singles, Singles]:
        """Find the least and greatest visible values in windows of growing reach.

        Returns
        -------
        low, high : (r, c, rows, w) float32
            Of the rows from `top` to `bottom`; what lies beyond does not count.
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
                least_and_greatest(least, most, reach - done)
            done = reach
        if hidden is not None:
            low[..., hidden], high[..., hidden] = 0, 0
        return low, high


@kernel
def keep_within(start, stop, first, base, d, shares, low, high, out):
    """Add differences times their shares to rows of the base, within a range.

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
