# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixel arrays as filters take them: checks, scales, channels and masks."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .errors import InvalidSignal
from .grid import Channels
from .settings import ImageSettings, TextureSettings
from .signals import LUMINANCE

SCALES = {"uint8": 1.0 / 255.0, "uint16": 1.0 / 65535.0, "float32": 1.0, "float64": 1.0}
"""What brings values of each supported type to [0, 1]."""

BAND = 256
"""Rows that are converted at once, so that an image mapped from disk is not copied as a whole."""


def checked_image(image: npt.ArrayLike) -> npt.NDArray:
    """Return an image as a contiguous (h, w) or (h, w, c) array, or raise `InvalidSignal`."""
    array = np.asarray(image)
    if array.dtype.name not in SCALES:
        raise InvalidSignal(
            f"The image is of type {array.dtype}; give uint8, uint16, float32 or float64."
        )
    if array.ndim not in (2, 3) or array.size == 0:
        raise InvalidSignal(f"The image has the shape {array.shape}; give (h, w) or (h, w, c).")
    array = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("="))
    if array.dtype.kind == "f":
        for start in range(0, len(array), BAND):
            if not np.isfinite(array[start : start + BAND]).all():
                raise InvalidSignal("The image holds NaN or infinity; replace these values first.")
    return array


def checked_weights(mask: npt.ArrayLike | None, given: npt.NDArray) -> npt.NDArray | None:
    """Return a mask as (h, w) float64 in [0, 1], or None, or raise `InvalidSignal`."""
    if mask is None:
        return None
    weights = np.asarray(mask)
    if weights.shape != given.shape[:2]:
        raise InvalidSignal(f"The mask has the shape {weights.shape}; give {given.shape[:2]}.")
    if weights.dtype.kind not in "bfiu" or not np.isfinite(weights).all():
        raise InvalidSignal("The mask holds NaN, infinity or no numbers; give weights in [0, 1].")
    if weights.min() < 0 or weights.max() > 1:
        raise InvalidSignal("The mask leaves the range 0 to 1; clip or rescale it.")
    return weights.astype(np.float64, copy=False)


def channel_groups(count: int, settings: ImageSettings | TextureSettings) -> list[Channels]:
    """Tell which of `count` channels are filtered together."""
    alpha = count - 1 if settings.alpha == "auto" and count in (2, 4) else -1
    colors = count - (alpha >= 0)
    none = np.empty(0, dtype=np.float32)
    if settings.channels == "independent":
        return [Channels(c, c + 1, alpha, none) for c in range(colors)]
    if settings.channels == "luminance":
        weights = LUMINANCE if colors >= 3 else np.full(colors, 1.0 / colors)
        return [Channels(0, colors, alpha, weights.astype(np.float32))]
    return [Channels(0, colors, alpha, none)]
