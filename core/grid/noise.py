# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures the noise of an image, and distinguishes it from texture.

Noise is everywhere, and texture is not, so a low quantile over patches all over the image is used.
Texture is also stronger at twice the distance between pixels, unlike noise, so each patch is
measured at both distances.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from .borders import windows_to_measure

_PATCH = 12
_QUANTILE = 0.1  # of the patches
_BIAS = 0.733  # the variance found there in white noise, whose variance is 1
_EVEN = 2.0  # how many times more variance at two pixels' distance is still noise
_RIM = 2  # pixels at the rim that have no second distance
_CUT = 0.75  # share of pixels at the ends of the range from which patches count less
_LEAST = 0.1  # how much those count that are all at the ends
_CUTTING = 1.5  # power of the share inside the range: how the range's ends lower a variance
_NONE = 1e-30


def measure_noise(
    image: Any, scale: float, alpha: int, *, inside: npt.NDArray[np.bool_] | None = None
) -> float | None:
    """Measure the standard deviation of the noise in an image, of values in [0, 1].

    Parameters
    ----------
    image : (h, w, c) array of any real type
        Or an object with a shape whose windows are read as those of arrays.
    scale : float
        Factor that brings values to [0, 1].
    alpha : int
        The last channel if it is opacity, or -1. Transparent pixels do not count.
    inside : (h, w) bool, optional
        The pixels to measure.

    Returns
    -------
    float or None
        The root of the channels' mean square. None if there are too few pixels to tell.

    Notes
    -----
    Immerkaer's mask removes linear values. For noise, its mean square is the same at distances of
    one and of two pixels. Where it is far larger at two, there is texture or a border, and the
    patch has less weight, by the square of the quotient. Values clipped at 0 or 1 vary less, which
    is corrected.
    """
    colors = image.shape[2] if alpha < 0 else alpha
    found: list[npt.NDArray] = []
    for rows, columns in windows_to_measure(image.shape[:2]):
        part = image[rows, columns].astype(np.float64) * scale
        seen = np.ones(part.shape[:2]) if alpha < 0 else part[..., alpha].clip(0.0, 1.0)
        if inside is not None:
            seen = seen * inside[rows, columns]
        if min(seen.shape) > 2 * _RIM:
            found.append(np.stack([_patches(part[..., c], seen) for c in range(colors)]))
    if not found:
        return None
    together = np.concatenate(found, axis=2)
    squares = [_low(values, weights) for values, weights in together if weights.sum() > 0]
    return math.sqrt(sum(squares) / len(squares)) if squares else None


def _patches(plane: npt.NDArray, seen: npt.NDArray) -> npt.NDArray:
    # The variance of noise in each patch, and how much it counts: (2, n).
    inner = slice(_RIM, -_RIM)
    known = _least_around(seen)
    near = _masked(plane, 1)[1:-1, 1:-1] ** 2
    far = _masked(plane, 2) ** 2
    cut = ((plane <= 0.0) | (plane >= 1.0))[inner, inner]
    weights = _summed(known)
    near, far, cut = (
        _summed(known * each) / np.maximum(weights, _NONE) for each in (near, far, cut)
    )
    variance = near * np.minimum(_EVEN * near / np.maximum(far, _NONE), 1.0) ** 2
    variance /= np.maximum(1.0 - cut, 1.0 - _CUT) ** _CUTTING
    varied = np.clip((1.0 - cut) / (1.0 - _CUT), 0.0, 1.0)
    return np.stack([variance, weights * (_LEAST + (1.0 - _LEAST) * varied)])


def _masked(plane: npt.NDArray, step: int) -> npt.NDArray:
    # The second difference along both axes, which keeps the variance of white noise.
    rows = plane[: -2 * step] - 2.0 * plane[step:-step] + plane[2 * step :]
    return (rows[:, : -2 * step] - 2.0 * rows[:, step:-step] + rows[:, 2 * step :]) / 6.0


def _least_around(seen: npt.NDArray) -> npt.NDArray:
    size = 2 * _RIM + 1
    return np.lib.stride_tricks.sliding_window_view(seen, (size, size)).min(axis=(2, 3))


def _starts(length: int) -> npt.NDArray[np.intp]:
    # Patches count from both ends, and the rest lies in the middle, so that turns change nothing.
    before = np.arange(0, length // (2 * _PATCH) * _PATCH, _PATCH)
    after = length - _PATCH - before[::-1]
    middle = [len(before) * _PATCH] if length > 2 * len(before) * _PATCH else []
    return np.concatenate([before, middle, after]).astype(np.intp)


def _summed(plane: npt.NDArray) -> npt.NDArray:
    starts = [_starts(length) for length in plane.shape]
    return np.add.reduceat(np.add.reduceat(plane, starts[0], axis=0), starts[1], axis=1).ravel()


def _low(values: npt.NDArray, weights: npt.NDArray) -> float:
    # The quantile of weighted values.
    order = np.argsort(values, kind="stable")
    counted = weights[order]
    places = np.cumsum(counted) - 0.5 * counted
    return float(np.interp(_QUANTILE * counted.sum(), places, values[order])) / _BIAS
