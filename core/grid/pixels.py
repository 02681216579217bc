# SPDX-License-Identifier: GPL-3.0-or-later
"""What the filters of images share: which images they take, and masks."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.parallel import Progress, blocks
from ..errors import InvalidSignal
from ..filters.signals import LUMINANCE
from ..mesh.calculus import as_array
from ..settings import ImageSettings, TextureSettings
from .walk import Channels

SCALES = {"uint8": 1.0 / 255.0, "uint16": 1.0 / 65535.0, "float32": 1.0, "float64": 1.0}
"""The types of images, with what brings their values to [0, 1]."""

BAND = 256
"""Rows of an image that numpy gets at once."""


def checked_image(image: npt.ArrayLike) -> npt.NDArray:
    """Return the image as a contiguous array; raises `InvalidSignal` if it cannot be filtered."""
    array = as_array(image, "image")
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


def checked_out(out: npt.NDArray | None, given: npt.NDArray) -> npt.NDArray:
    """Return where the result goes: a new array, or `out` if it fits."""
    if out is None:
        return np.empty_like(given)
    if out.shape != given.shape or out.dtype != given.dtype or not out.flags.c_contiguous:
        raise InvalidSignal(
            f"out is {out.dtype} of shape {out.shape}; give a contiguous {given.dtype} array of"
            f" shape {given.shape}."
        )
    if np.may_share_memory(out, given):
        raise InvalidSignal("out shares memory with the image; give another array.")
    return np.asarray(out)


def checked_weights(mask: npt.ArrayLike | None, given: npt.NDArray) -> npt.NDArray | None:
    """Return the mask as float64; raises `InvalidSignal` if it does not fit the image."""
    if mask is None:
        return None
    weights = as_array(mask, "mask")
    if weights.shape != given.shape[:2]:
        raise InvalidSignal(f"The mask has the shape {weights.shape}; give {given.shape[:2]}.")
    if weights.dtype.kind not in "bfiu" or not np.isfinite(weights).all():
        raise InvalidSignal("The mask holds NaN, infinity or no numbers; give weights in [0, 1].")
    if weights.min() < 0 or weights.max() > 1:
        raise InvalidSignal("The mask leaves the range 0 to 1; clip or rescale it.")
    return weights.astype(np.float64, copy=False)


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


def copied(pixels: npt.NDArray, progress: Progress) -> npt.NDArray:
    """Copy an image, asking whether to go on."""
    copy = np.empty_like(pixels)
    for band in blocks(len(pixels), BAND, progress):
        copy[band] = pixels[band]
    return copy


def mix(pixels: npt.NDArray, weights: npt.NDArray, target: npt.NDArray, progress: Progress) -> None:
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
