# SPDX-License-Identifier: GPL-3.0-or-later
"""Evenly distributed directions in a hemisphere: Sobol sequences shared by neighbouring places."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel

_BITS = 32

_SHARING = 64
"""Most places that share a sequence."""

_LONGEST = 1 << 18
"""Most points of a sequence."""

_TURN = 6.283185307179586

_SWAPS = (1, 0x55555555), (2, 0x33333333), (4, 0x0F0F0F0F), (8, 0x00FF00FF)
"""Neighbouring bits, pairs and so on, which exchanged reverse the order of bits."""


def sobol_points(count: int) -> npt.NDArray[np.uint32]:
    """Return the first points of Sobol's sequence in the unit square: (k, 2).

    As binary fractions with the bits in reverse order, which `scrambled` takes.

    Parameters
    ----------
    count : int
        Powers of two fill the square most evenly.
    """
    numbers = np.arange(count, dtype=np.uint64)
    points = np.zeros((count, 2), dtype=np.uint64)
    steps = [1 << (_BITS - 1 - bit) for bit in range(_BITS)], [1 << (_BITS - 1)]
    for _ in range(1, _BITS):  # the polynomial x + 1
        before = steps[1][-1]
        steps[1].append(before ^ (before >> 1))
    for axis in range(2):
        for bit in range(_BITS):
            is_set = (numbers >> np.uint64(bit)) & np.uint64(1)
            points[:, axis] ^= is_set * np.uint64(steps[axis][bit])
    return _reversed(points.astype(np.uint32))


def _reversed(x: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint32]:
    x = x.copy()
    for shift, mask in _SWAPS:
        x = ((x >> np.uint32(shift)) & np.uint32(mask)) | (
            (x & np.uint32(mask)) << np.uint32(shift)
        )
    return (x >> np.uint32(16)) | (x << np.uint32(16))


@kernel
def scrambled(x, seed):
    """Scramble a coordinate by nested random exchanges (Owen), and return it in [0, 1).

    The hash is that of Laine and Karras (2011), "Stratified sampling for stochastic transparency",
    with the constants of Vegdahl (2021).
    """
    mask = np.uint64(0xFFFFFFFF)
    x = np.uint64(x)
    x = x ^ ((x * np.uint64(0x3D20ADEA)) & mask)
    x = (x + seed) & mask
    x = (x * ((seed >> np.uint64(16)) | np.uint64(1))) & mask
    x = x ^ ((x * np.uint64(0x05526C56)) & mask)
    x = x ^ ((x * np.uint64(0x53A22864)) & mask)
    x = ((x >> np.uint64(1)) & np.uint64(0x55555555)) | (
        (x & np.uint64(0x55555555)) << np.uint64(1)
    )
    x = ((x >> np.uint64(2)) & np.uint64(0x33333333)) | (
        (x & np.uint64(0x33333333)) << np.uint64(2)
    )
    x = ((x >> np.uint64(4)) & np.uint64(0x0F0F0F0F)) | (
        (x & np.uint64(0x0F0F0F0F)) << np.uint64(4)
    )
    x = ((x >> np.uint64(8)) & np.uint64(0x00FF00FF)) | (
        (x & np.uint64(0x00FF00FF)) << np.uint64(8)
    )
    x = ((x >> np.uint64(16)) | (x << np.uint64(16))) & mask
    return (np.float64(x) + 0.5) * 2.0**-32


@kernel
def mixed(x):
    """Scramble the bits of a number: the finalizer of splitmix64 (Steele, Lea, Flood 2014)."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


def ray_points(rays: int) -> npt.NDArray[np.uint32]:
    """Return the points of the rays of places that share a sequence, for `ray_of`: (k, 2)."""
    part = 1 << (rays - 1).bit_length()
    return sobol_points(part * max(min(_SHARING, _LONGEST // part), 1))


@kernel
def ray_of(points, rays, turn, i):
    """Return the place on the unit disk below ray i of a place.

    Successive places on a curve have successive parts of one scrambled sequence, so that neighbours
    cover the directions that a place lacks. Their errors have high frequency and vanish when they
    are averaged (Ahmed and Wonka 2020, "Screen-space blue-noise diffusion of Monte Carlo sampling
    error via hierarchical ordering of pixels").

    Parameters
    ----------
    points : (k, 2) uint32
        The result of `ray_points`.
    rays : int
    turn : int64
        The position of the place on the curve.
    i : int
        From 0 to `rays` - 1.
    """
    part = 1
    while part < rays:
        part *= 2
    sharing = len(points) // part
    group = np.uint64(turn // sharing + 1)
    scramble = mixed(group * np.uint64(0x9E3779B97F4A7C15))
    return on_disk(points, turn % sharing * part + i, scramble)


@kernel
def on_disk(points, i, scramble):
    """Turn a point to the unit disk: evenly, so that above it directions are cosine-weighted.

    The map keeps squares around the middle together (Shirley and Chiu 1997). Both halves of
    `scramble`, a uint64, scramble a coordinate each.
    """
    x = 2.0 * scrambled(points[i, 0], scramble & np.uint64(0xFFFFFFFF)) - 1.0
    y = 2.0 * scrambled(points[i, 1], scramble >> np.uint64(32)) - 1.0
    if abs(x) > abs(y):
        turn = _TURN / 8.0 * y / x
        return x * np.cos(turn), x * np.sin(turn)
    if y == 0.0:
        return 0.0, 0.0
    turn = _TURN / 8.0 * x / y
    return y * np.sin(turn), y * np.cos(turn)


def grid_codes(places: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return the places of points of a grid (k, 2) on a curve that fills it, Morton's."""
    codes = np.zeros(len(places), dtype=np.int64)
    for axis in range(2):
        bits = places[:, axis].astype(np.int64)
        for shift, mask in (
            (16, 0x0000FFFF0000FFFF),
            (8, 0x00FF00FF00FF00FF),
            (4, 0x0F0F0F0F0F0F0F0F),
            (2, 0x3333333333333333),
            (1, 0x5555555555555555),
        ):
            bits = (bits | (bits << shift)) & mask
        codes |= bits << axis
    return codes
