# SPDX-License-Identifier: GPL-3.0-or-later
"""Restores grain that is too strong to be noise, such as that of asphalt, fur and rough stone.

Not in the papers. The features of the networks do not depend on the brightness of an image, so
strong fine texture looks like noise to them. The noise of photos differs between channels, and is
weak compared with the range of the image. So the grain that the mean of all channels has lost is
compared with the range of the smoothed image.
"""

from __future__ import annotations

import numpy as np

from ...base.parallel import kernel, run
from ...base.progress import aside
from .planes import Planes, gaussian_of
from .surroundings import STRIP, Singles

NOISE = 0.06, 0.12
"""Ramp of the strength of grain, as a share of the range of the smoothed image: below the first
value it is removed, above the second it is restored fully. In a photo of full range, the first is
15 of 255 levels in the mean of the channels, or independent noise of 26 levels in each of three."""

NEAR = 4.0
"""Sigma of the smoothing of the lost energy, in pixels."""

REACH = len(gaussian_of(NEAR))
"""Radius in pixels within which a result affects how much grain is restored."""


def give_grain_back(planes: Planes, values: Singles, span: float) -> None:
    """Mix a result with its input, in place, where strong grain was smoothed away.

    Parameters
    ----------
    planes : Planes
        The input.
    values : (c, h, w) float32
        The result.
    span : float
        Range of the values of the smoothed image.
    """
    _, height, width = values.shape
    shares = np.empty((height, width), np.float32)

    def find_shares(start: int, stop: int) -> None:
        first, last = max(start - REACH, 0), min(stop + REACH, height)
        outer = slice(max(first - 1, 0), min(last + 1, height))
        lost, kept = (
            planes.slopes(each[:, outer].mean(axis=0, keepdims=True))
            for each in (planes.values, values)
        )
        lost -= kept
        if planes.opacity.size:
            lost *= _known(planes.opacity[outer])
        lost = np.ascontiguousarray(lost[first - outer.start : last - outer.start])
        _shares(planes.averaged(lost[None], first, NEAR, start, stop)[0], span, NOISE,
                shares[start:stop])  # fmt: skip

    def mix(start: int, stop: int) -> None:
        _mix(planes.values[:, start:stop], shares[start:stop], values[:, start:stop])

    with aside("Sharpening"):
        if planes.whole:
            find_shares(0, height)
        else:
            run(find_shares, height, chunk=STRIP)
        run(mix, height, chunk=STRIP)


def _known(opacity: Singles) -> Singles:
    # Opacity, but 0 beside hidden pixels, whose unknown values would enter the slopes.
    seen = opacity > 0
    known = seen.copy()
    for one, other in ((np.s_[1:], np.s_[:-1]), (np.s_[:, 1:], np.s_[:, :-1])):
        known[one] &= seen[other]
        known[other] &= seen[one]
    return opacity * known


@kernel
def _shares(lost, span, noise, shares):
    # Slopes are four times the squared gradient, which for white noise is four times its variance.
    for y in range(lost.shape[0]):
        for x in range(lost.shape[1]):
            shares[y, x] = 0
            if lost[y, x] > 0:
                strength = np.sqrt(np.float64(lost[y, x])) / (2.0 * max(span, 1e-30))
                if strength > noise[0]:
                    share = (strength - noise[0]) / (noise[1] - noise[0])
                    shares[y, x] = min(share, 1.0)


@kernel
def _mix(old, shares, values):
    for c in range(values.shape[0]):
        for y in range(values.shape[1]):
            for x in range(values.shape[2]):
                share, given, new = shares[y, x], old[c, y, x], values[c, y, x]
                if share == 1:
                    values[c, y, x] = given
                elif share > 0:
                    between = new + share * (given - new)
                    values[c, y, x] = min(max(between, min(given, new)), max(given, new))
