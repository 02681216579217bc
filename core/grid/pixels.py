# SPDX-License-Identifier: GPL-3.0-or-later
"""What the filters of images share: which images they take, and masks."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.checks import BAND
from ..base.parallel import Progress, blocks
from ..settings import ImageSettings, TextureSettings
from .walk import Channels


def opacity_channel(channels: int, alpha: str) -> int:
    """Find the channel that is opacity, or -1; `alpha` is as in `ImageSettings`."""
    return channels - 1 if alpha == "auto" and channels in (2, 4) else -1


def channel_groups(count: int, settings: ImageSettings | TextureSettings) -> list[Channels]:
    """Tell which of `count` channels follow one flow."""
    alpha = opacity_channel(count, settings.alpha)
    colors = count - (alpha >= 0)
    none = np.empty(0, dtype=np.float32)
    if settings.channels == "independent":
        return [Channels(c, c + 1, alpha, none) for c in range(colors)]
    if settings.channels == "luminance":
        weights = LUMINANCE if colors >= 3 else np.full(colors, 1.0 / colors)
        return [Channels(0, colors, alpha, weights.astype(np.float32))]
    return [Channels(0, colors, alpha, none)]


def copied(pixels: npt.NDArray, progress: Progress = Progress(None)) -> npt.NDArray:
    """Copy an image, asking whether to go on."""
    copy = np.empty_like(pixels)
    for band in blocks(len(pixels), BAND, progress):
        copy[band] = pixels[band]
    return copy


def mix(
    pixels: npt.NDArray,
    weights: npt.NDArray,
    target: npt.NDArray,
    progress: Progress = Progress(None),
) -> None:
    """Mix the result in `target` with the input; a weight of 0 keeps the input bit for bit."""
    # In bands of rows, so that an image mapped from disk is not copied as a whole.
    for band in blocks(len(pixels), BAND, progress):
        weight = weights[band, :, None]
        old = pixels[band].astype(np.float64)
        mixed = old + weight * (target[band] - old)
        if target.dtype.kind == "u":
            mixed = np.rint(mixed)
        same = (weight == 0) | (target[band] == pixels[band])  # to the last bit, the sign of 0 too
        target[band] = np.where(same, pixels[band], mixed)


LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Weights of linear red, green and blue in the brightness (ITU-R BT.709)."""
