# SPDX-License-Identifier: GPL-3.0-or-later
"""Dye that stays sharp although each reading blurs it (paper D, section 5.3, and our own)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...base.parallel import kernel, run
from ...settings import DyeSettings, ImageSettings
from ..images import sharpen_image
from .velocity import ROWS

_Singles = npt.NDArray[np.float32]

_FULL_TIME = 32.0
"""Time of the shock filter in a frame, at a sharpness of 1."""


def sharpen_dye(shares: _Singles, settings: DyeSettings) -> None:
    """Sharpen the shares of all dyes in place: (h, w, k)."""
    if settings.sharpness == 0 or shares.size == 0:
        return
    if settings.sharpening == "rational":
        run(_push, len(shares), np.float32(settings.sharpness), shares, chunk=ROWS)
        return
    shock = ImageSettings(
        what="drawing",
        time=_FULL_TIME * settings.sharpness,
        channels="independent",
        alpha="none",
    )
    shares[...] = sharpen_image(shares, shock)


@kernel
def _push(start, stop, sharpness, shares):
    one = np.float32(1)
    half = np.float32(0.5)
    for i in range(start, stop):
        for j in range(shares.shape[1]):
            for c in range(shares.shape[2]):
                # Values above 1/2 are pushed up as far as those below are pushed down. Written
                # so that a sharpness of 1 divides nothing by zero.
                centered = np.float32(2) * min(shares[i, j, c], one) - one
                size = abs(centered)
                below = one - sharpness * (one - size)
                pushed = centered / below if below > 0 else np.float32(0)
                shares[i, j, c] = half + half * pushed
