# SPDX-License-Identifier: GPL-3.0-or-later
"""Bicubic enlarging of images by a whole number, without values that were not nearby."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run

_ROWS = 32


def enlarged(pixels: npt.NDArray, times: int, scale: float = 1.0, alpha: int = -1) -> npt.NDArray:
    """Enlarge an image by the Catmull-Rom cubic, clamped to the range of the 16 pixels around.

    Parameters
    ----------
    pixels : (h, w, c) array
    times : int
        How many pixels one pixel becomes, along each side.
    scale : float
        Factor of the values.
    alpha : int
        The channel that is opacity, or -1; transparent pixels lend no color to others.

    Returns
    -------
    (times * h, times * w, c) array
        float64 if `pixels` are, otherwise float32.
    """
    height, width, channels = pixels.shape
    kind = np.float64 if pixels.dtype == np.float64 else np.float32
    out = np.empty((times * height, times * width, channels), kind)
    run(_enlarge, len(out), pixels, cubic_weights(times), scale, alpha, out, chunk=_ROWS)
    return out


def cubic_weights(times: int) -> npt.NDArray[np.float64]:
    """Weights of an old pixel's neighbors for the new ones within, in the Catmull-Rom cubic.

    Returns
    -------
    (times, 5) array
        Weights of the neighbors from two before to two behind, one of which is 0.
    """
    places = (np.arange(times) + 0.5) / times - 0.5
    away = np.abs(places[:, None] - np.arange(-2, 3))
    near = 1.0 + away**2 * (1.5 * away - 2.5)
    far = 2.0 - away * (4.0 - away * (2.5 - 0.5 * away))
    return np.where(away < 1, near, np.where(away < 2, far, 0.0))


@kernel
def _enlarge(start, stop, image, weights, scale, alpha, out):
    height, width, channels = image.shape
    times = weights.shape[0]
    total = np.empty(channels)
    low = np.empty(channels)
    high = np.empty(channels)
    for y in range(start, stop):
        row = y // times
        down = weights[y % times]
        for x in range(out.shape[1]):
            column = x // times
            across = weights[x % times]
            total[:] = 0.0
            low[:] = np.inf
            high[:] = -np.inf
            visible = 0.0
            for j in range(5):
                if down[j] == 0.0:
                    continue
                r = min(max(row + j - 2, 0), height - 1)
                for i in range(5):
                    if across[i] == 0.0:
                        continue
                    q = min(max(column + i - 2, 0), width - 1)
                    weight = down[j] * across[i]
                    opacity = 1.0
                    if alpha >= 0:
                        opacity = float(image[r, q, alpha])
                    visible += weight * opacity
                    for c in range(channels):
                        value = float(image[r, q, c])
                        if c == alpha:
                            total[c] += weight * value
                        elif opacity > 0.0:
                            total[c] += weight * opacity * value
                        else:
                            continue
                        low[c] = min(low[c], value)
                        high[c] = max(high[c], value)
            for c in range(channels):
                value = float(image[row, column, c])
                if low[c] < high[c]:
                    if c == alpha:
                        value = total[c]
                    elif visible > 0.0:
                        value = total[c] / visible
                    value = min(max(value, low[c]), high[c])
                elif low[c] == high[c]:
                    value = low[c]
                out[y, x, c] = scale * value
