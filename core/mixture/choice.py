# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances between candidates, and their mixture."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from .network import Singles

FAINT = 0.02
"""Added to distances before their logarithm is taken: smaller distances are hardly told apart."""


def pair_count(candidates: int) -> int:
    """Return the number of pairs of candidates."""
    return candidates * (candidates - 1) // 2


def tell_pairs(candidates: Singles, told: Singles) -> None:
    """Write the logarithms of the distances of all pairs into the first columns of `told`.

    Parameters
    ----------
    candidates : (n, k, d) float32
    told : (n, k (k - 1) / 2 or more) float32
        The features for a network.
    """
    run(_tell_pairs, len(candidates), candidates, told)


def mixture(
    candidates: Singles, scores: Singles, first: int = 0
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Mix unit vectors by the softmax of their scores.

    Parameters
    ----------
    candidates : (n, k, 3) float32
        Unit vectors.
    scores : (n, k) float32
    first : int
        Candidates before this index have weight 0.

    Returns
    -------
    mixed : (n, 3) float64
        Unit vectors; candidate 0 where the weighted sum is zero.
    shares : (n, k) float64
        The weights, which add up to 1.
    """
    mixed = np.empty((len(candidates), 3))
    shares = np.empty(scores.shape)
    run(_mix, len(candidates), candidates, scores, first, mixed, shares)
    return mixed, shares


def free_mixture(candidates: Singles, scores: Singles) -> npt.NDArray[np.float64]:
    """Mix unit vectors by the softmax of their scores plus a free term, which may extrapolate.

    Parameters
    ----------
    candidates : (n, k, 3) float32
        Unit vectors.
    scores : (n, 2 k) float32
        The weights are the softmax of the first half plus the second half.

    Returns
    -------
    (n, 3) float64
        Unit vectors; candidate 0 where the weighted sum is zero.
    """
    mixed = np.empty((len(candidates), 3))
    run(_mix_freely, len(candidates), candidates, scores, mixed)
    return mixed


@kernel
def logarithm(x):
    """Natural logarithm of a positive float32, within 1.1e-6 from 1e-5 to 20; it vectorizes.

    With x = m 2^e and m between sqrt(1/2) and sqrt(2): log m = 2 atanh((m - 1) / (m + 1)), by five
    terms of its series.
    """
    bits = np.float32(x).view(np.int32)
    e = (bits - np.int32(0x3F3504F3)) >> 23  # 0x3F3504F3 are the bits of sqrt(1/2)
    m = np.int32(bits - (e << 23)).view(np.float32)
    s = (m - np.float32(1)) / (m + np.float32(1))
    q = s * s
    series = np.float32(2 / 7) + q * np.float32(2 / 9)
    series = np.float32(2 / 3) + q * (np.float32(2 / 5) + q * series)
    return np.float32(e) * np.float32(np.log(2)) + s * (np.float32(2) + q * series)


@kernel
def _tell_pairs(start, stop, candidates, told):
    # Coordinate by coordinate, so that the compiler vectorizes the inner loops.
    k, size = candidates.shape[1], candidates.shape[2]
    places = np.empty((size, k), np.float32)
    for f in range(start, stop):
        for i in range(k):
            for x in range(size):
                places[x, i] = candidates[f, i, x]
        row, c = told[f], 0
        for i in range(k):
            squares, c = row[c : c + k - i - 1], c + k - i - 1
            squares[:] = 0
            for x in range(size):
                own, others = places[x, i], places[x, i + 1 :]
                for j in range(len(squares)):
                    squares[j] += (own - others[j]) ** 2
        for i in range(c):
            row[i] = logarithm(np.sqrt(row[i]) + np.float32(FAINT)) + np.float32(2)


@kernel
def _mix(start, stop, candidates, scores, first, mixed, shares):
    k = scores.shape[1]
    for f in range(start, stop):
        most = scores[f, first]
        for i in range(first + 1, k):
            most = max(most, scores[f, i])
        total = 0.0
        for i in range(k):
            shares[f, i] = np.exp(np.float64(scores[f, i] - most)) if i >= first else 0.0
            total += shares[f, i]
        x = y = z = 0.0
        for i in range(k):
            shares[f, i] /= total
            x += shares[f, i] * candidates[f, i, 0]
            y += shares[f, i] * candidates[f, i, 1]
            z += shares[f, i] * candidates[f, i, 2]
        length = np.sqrt(x * x + y * y + z * z)
        if length > 1e-9:
            mixed[f, 0], mixed[f, 1], mixed[f, 2] = x / length, y / length, z / length
        else:
            for i in range(3):
                mixed[f, i] = candidates[f, 0, i]


@kernel
def _mix_freely(start, stop, candidates, scores, mixed):
    k = candidates.shape[1]
    for f in range(start, stop):
        most = scores[f, 0]
        for i in range(1, k):
            most = max(most, scores[f, i])
        total = 0.0
        for i in range(k):
            total += np.exp(np.float64(scores[f, i] - most))
        x = y = z = 0.0
        for i in range(k):
            share = np.exp(np.float64(scores[f, i] - most)) / total + scores[f, k + i]
            x += share * candidates[f, i, 0]
            y += share * candidates[f, i, 1]
            z += share * candidates[f, i, 2]
        length = np.sqrt(x * x + y * y + z * z)
        if length > 1e-9:
            mixed[f, 0], mixed[f, 1], mixed[f, 2] = x / length, y / length, z / length
        else:
            for i in range(3):
                mixed[f, i] = candidates[f, 0, i]
