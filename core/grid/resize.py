# SPDX-License-Identifier: GPL-3.0-or-later
"""Resizing of images: weighted means when shrinking, linear interpolation when enlarging."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ..sparse.matrix import Sparse, applied, from_triples

Pixels = npt.NDArray[np.float32]


def resized(pixels: Pixels, size: tuple[int, int]) -> Pixels:
    """Resize an image to another height and width.

    Parameters
    ----------
    pixels : (h, w, c) float32
        The last of two or four channels is opacity; transparent pixels lend no color.
    size : (int, int)
        Height and width.
    """
    if pixels.shape[:2] == size:
        return pixels
    colors = pixels.shape[2] - (pixels.shape[2] in (2, 4))
    large = pixels.copy()
    large[..., :colors] *= pixels[..., colors:] if colors < pixels.shape[2] else 1.0
    rows, columns = (_weights(new, old) for new, old in zip(size, pixels.shape, strict=False))
    out = np.stack(
        [applied(columns, applied(rows, plane).T).T for plane in np.moveaxis(large, 2, 0)], axis=-1
    )
    if colors < pixels.shape[2]:
        opacity = out[..., colors:]
        np.divide(out[..., :colors], opacity, out=out[..., :colors], where=opacity > 0)
    return out


def _weights(new: int, old: int) -> Sparse:
    # A tent around each new pixel's centre, as wide as the larger of new and old pixels.
    reach = max(old / new, 1.0)
    places = (np.arange(new) + 0.5) * old / new - 0.5
    first = np.floor(places - reach).astype(int)
    found = first[:, None] + np.arange(math.ceil(2.0 * reach) + 2)
    weights = np.maximum(1.0 - np.abs(found - places[:, None]) / reach, 0.0)
    weights /= weights.sum(axis=1, keepdims=True)
    rows = np.repeat(np.arange(new), found.shape[1])
    columns = np.clip(found, 0, old - 1).ravel()
    return from_triples(rows, columns, weights.ravel().astype(np.float32), (new, old))
