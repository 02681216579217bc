# SPDX-License-Identifier: GPL-3.0-or-later
"""Copying and blending images in bands of rows, so that those mapped from disk stay there."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.checks import BAND
from ..base.parallel import blocks


def copied(pixels: npt.NDArray) -> npt.NDArray:
    """Copy an image band by band; can be cancelled."""
    copy = np.empty_like(pixels, order="C")
    for band in blocks(len(pixels), BAND):
        copy[band] = pixels[band]
    return copy


def mix(pixels: npt.NDArray, weights: npt.NDArray, target: npt.NDArray) -> None:
    """Blend the result in `target` with the input; a weight of 0 keeps the input bit for bit."""
    for band in blocks(len(pixels), BAND):
        weight = weights[band, :, None]
        old = pixels[band].astype(np.float64)
        mixed = old + weight * (target[band] - old)
        if target.dtype.kind == "u":
            mixed = np.rint(mixed)
        same = (weight == 0) | (target[band] == pixels[band])  # equal bits, also the sign of 0
        target[band] = np.where(same, pixels[band], mixed)
