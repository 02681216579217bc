# SPDX-License-Identifier: GPL-3.0-or-later
"""Noise in space, which has no seams on any surface and needs no texture coordinates."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..rays.directions import mixed

_OCTAVES = 5

_GAIN = 0.6
"""Amplitude of each octave relative to the one before."""

_DEVIATION = 0.25
"""Standard deviation of the noise, relative to its range."""


def solid_noise(points: npt.NDArray, size: float, seed: int) -> npt.NDArray[np.float32]:
    """Return noise at places, in [0, 1] with a mean of about 0.5: (k,).

    Parameters
    ----------
    points : (k, 3) array of float
    size : float
        Size of the largest spots, in the units of the places.
    seed : int

    Notes
    -----
    Gradient noise (Perlin 2002, "Improving noise") in five octaves.
    """
    out = np.empty(len(points), dtype=np.float32)
    run(_fill, len(points), np.ascontiguousarray(points, dtype=np.float32), 1.0 / size,
        np.uint64(seed), out)  # fmt: skip
    return out


@kernel
def _fill(start, stop, points, frequency, seed, out):
    square = 0.0
    for octave in range(_OCTAVES):
        square += _GAIN ** (2 * octave)
    scale = _DEVIATION / (0.28 * np.sqrt(square))
    for i in range(start, stop):
        total, weight, often = 0.0, 1.0, frequency
        for octave in range(_OCTAVES):
            key = mixed(seed * np.uint64(1000003) + np.uint64(octave + 1))
            x, y, z = points[i, 0] * often, points[i, 1] * often, points[i, 2] * often
            total += weight * _noise(x, y, z, key)
            weight *= _GAIN
            often *= 2.03
        out[i] = min(max(0.5 + scale * total, 0.0), 1.0)


@kernel
def _noise(x, y, z, key):
    # Between the corners of a cell, each of which has a slope of its own.
    x0, y0, z0 = np.floor(x), np.floor(y), np.floor(z)
    u, v, w = x - x0, y - y0, z - z0
    total = 0.0
    for corner in range(8):
        i, j, k = corner & 1, (corner >> 1) & 1, corner >> 2
        cell = np.uint64(np.int64(x0) + i) * np.uint64(0x9E3779B97F4A7C15)
        cell ^= np.uint64(np.int64(y0) + j) * np.uint64(0xC2B2AE3D27D4EB4F)
        cell ^= np.uint64(np.int64(z0) + k) * np.uint64(0x165667B19E3779F9)
        bits = mixed(cell ^ key)
        # A point on the unit sphere.
        up = np.float64(bits & np.uint64(0xFFFF)) / 32767.5 - 1.0
        turn = np.float64((bits >> np.uint64(16)) & np.uint64(0xFFFF)) * (6.283185307179586 / 65536)
        flat = np.sqrt(max(1.0 - up * up, 0.0))
        du, dv, dw = u - i, v - j, w - k
        slope = flat * np.cos(turn) * du + flat * np.sin(turn) * dv + up * dw
        total += slope * _fade(1.0 - abs(du)) * _fade(1.0 - abs(dv)) * _fade(1.0 - abs(dw))
    return total


@kernel
def _fade(t):
    return t * t * t * (t * (6.0 * t - 15.0) + 10.0)
