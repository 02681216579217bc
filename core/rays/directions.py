# SPDX-License-Identifier: GPL-3.0-or-later
"""Directions that fill a hemisphere evenly: Sobol's points, scrambled anew at each place."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel

_BITS = 32

_TURNS = 6.283185307179586 * 2.0**-32


def sobol_points(count: int) -> npt.NDArray[np.uint32]:
    """Return the first points of Sobol's sequence in the unit square, as binary fractions: (k, 2).

    Parameters
    ----------
    count : int
        Powers of two fill the square most evenly.
    """
    numbers = np.arange(count, dtype=np.uint64)
    points = np.zeros((count, 2), dtype=np.uint64)
    steps = [1 << (_BITS - 1 - bit) for bit in range(_BITS)], [1 << (_BITS - 1)]
    for bit in range(1, _BITS):  # the polynomial x + 1
        before = steps[1][-1]
        steps[1].append(before ^ (before >> 1))
    for axis in range(2):
        for bit in range(_BITS):
            is_set = (numbers >> np.uint64(bit)) & np.uint64(1)
            points[:, axis] ^= is_set * np.uint64(steps[axis][bit])
    return points.astype(np.uint32)


@kernel
def mixed(x):
    """Scramble the bits of a number: the finalizer of splitmix64 (Steele, Lea, Flood 2014)."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


@kernel
def on_disk(points, i, scramble):
    """Turn a point to the unit disk: evenly, so that above it directions are cosine-weighted.

    The bits of `scramble`, a uint64, are exchanged in both coordinates, which keeps points evenly
    spread.
    """
    u = np.uint64(points[i, 0]) ^ (scramble & np.uint64(0xFFFFFFFF))
    v = np.uint64(points[i, 1]) ^ (scramble >> np.uint64(32))
    far = np.sqrt((np.float64(u) + 0.5) * 2.0**-32)
    turn = (np.float64(v) + 0.5) * _TURNS
    return far * np.cos(turn), far * np.sin(turn)
