# SPDX-License-Identifier: GPL-3.0-or-later
"""Grain that is too strong for noise stays: that of asphalt, fur and rough stone.

Not in the papers. Networks are not told how bright an image is, so that strong fine texture looks
like noise to them. The noise of photos differs from channel to channel, and is weak beside what
they show. So the grain that the mean of all channels loses is compared with the range of the
smoothed image.
"""

from __future__ import annotations

import numpy as np

from ...base.parallel import kernel, run
from ...base.progress import aside
from .planes import Planes, gaussian_of
from .surroundings import STRIP, Singles

NOISE = 0.06, 0.12
"""Strength of grain, as a share of the range of the smoothed image, from which it is given back,
and fully. In a photo of full range the first is 15 levels of 255 in the mean of the channels: noise
of 26 levels in each of three. Images of one channel have no others that the noise cancels with."""

NEAR = 4.0
"""Sigma of the smoothing of what is lost."""

REACH = len(gaussian_of(NEAR))
"""Radius in pixels within which a result affects how much grain is given back."""


def give_grain_back(planes: Planes, values: Singles, span: float) -> None:
    """Bring a result nearer to its input, in place, where strong grain was smoothed away.

    Parameters
    ----------
    planes : Planes
        The input.
    values : (c, h, w) float32
        The result.
    span : float
        From the least to the greatest value of the smoothed image.
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
    # Opacity where slopes are known: not beside hidden pixels, whose values say nothing.
    seen = opacity > 0
    known = seen.copy()
    for one, other in ((np.s_[1:], np.s_[:-1]), (np.s_[:, 1:], np.s_[:, :-1])):
        known[one] &= seen[other]
        known[other] &= seen[one]
    return opacity * known


@kernel
def _shares(lost, span, noise, shares):
    # Slopes are four times the squared gradient: four times the variance of white noise.
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
