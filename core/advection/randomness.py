# SPDX-License-Identifier: GPL-3.0-or-later
"""Counter-based random numbers: a hash of seed, frame and cell, without state or order.

A stream has a key, made by `stream`; each row of cells has a key made from that by `row_key`; and
`random_bits` returns the 32 bits of each column. Rows and columns may be any numbers.
"""

from __future__ import annotations

import numpy as np

from ..base.parallel import kernel

FIRST, CHANGED, BESIDE, BEYOND = range(4)
"""Uses of random numbers: the first noise, changing cells, the rim around the image, and inflow at
the borders of a surface."""

_WORD = (1 << 64) - 1


def stream(seed: int, frame: int, purpose: int) -> np.uint64:
    """Return the key of the random numbers of a frame; frames before the first are negative."""
    key = (seed * 0x9E3779B97F4A7C15 + (frame << 3) + purpose) & _WORD
    return np.uint64(_mixed(_mixed(key)))


def _mixed(key: int) -> int:
    # splitmix64 (Steele, Lea, Flood 2014).
    key = (key + 0x9E3779B97F4A7C15) & _WORD
    key = ((key ^ (key >> 30)) * 0xBF58476D1CE4E5B9) & _WORD
    key = ((key ^ (key >> 27)) * 0x94D049BB133111EB) & _WORD
    return key ^ (key >> 31)


@kernel
def row_key(key, row):
    """Mix the key of a stream with the number of a row."""
    key = key + np.uint64(row) * np.uint64(0x9E3779B97F4A7C15)
    key = (key ^ (key >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    key = (key ^ (key >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    key = key ^ (key >> np.uint64(31))
    return np.uint32(key), np.uint32(key >> np.uint64(32))


@kernel
def random_bits(keys, column):
    """Return 32 random bits of a column, in a row with these keys."""
    # Two rounds with the constants of lowbias32 (Chris Wellons), a key in each.
    bits = np.uint32(column) ^ keys[0]
    bits = np.uint32((bits ^ (bits >> np.uint32(16))) * np.uint32(0x7FEB352D))
    bits = np.uint32((bits ^ (bits >> np.uint32(15))) + keys[1])
    bits = np.uint32((bits ^ (bits >> np.uint32(15))) * np.uint32(0x846CA68B))
    return np.uint32(bits ^ (bits >> np.uint32(16)))
