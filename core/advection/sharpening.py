# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpening of dye, which each interpolation blurs (paper D, 5.3, and a shock filter)."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..settings import DyeSettings
from .velocity import ROWS

_Singles = npt.NDArray[np.float32]

_MOST = 0.25
"""Largest share of a cell that flows through each of its sides in a pass, for stability."""


def sharpen_dye(shares: _Singles, settings: DyeSettings, joined: tuple[bool, bool]) -> _Singles:
    """Sharpen the shares of all dyes, (k, h, w).

    The default is a shock filter in conservative form: dye flows up its own gradient,
    dc/dt = -div(c (1 - c) grad c / |grad c|), so that spread dye gathers again and none is lost.

    Parameters
    ----------
    shares : (k, h, w) float32
        In [0, 1]; overwritten.
    settings : DyeSettings
    joined : (bool, bool)
        As returned by `wraps`.

    Returns
    -------
    (k, h, w) float32
    """
    if settings.sharpness == 0 or shares.size == 0:
        return shares
    rows = shares.shape[1]
    passes = math.ceil(settings.sharpness / _MOST)
    new = np.empty_like(shares)
    for _ in range(passes):
        gain = np.float32(settings.sharpness / passes)
        run(_gather, rows, gain, joined, shares, new, chunk=ROWS)
        shares, new = new, shares
    return shares


@kernel
def _gather(start, stop, gain, joined, old, new):
    kinds, rows, columns = old.shape
    padded = np.empty((3, columns + 2), dtype=np.float32)
    across = np.empty(columns + 1, dtype=np.float32)
    above, below = np.empty(columns, dtype=np.float32), np.empty(columns, dtype=np.float32)
    for kind in range(kinds):
        for i in range(start, stop):
            # Values at a border are repeated beyond it, so that nothing flows across it.
            for k in range(3):
                row = i + k - 1
                row = row % rows if joined[1] else min(max(row, 0), rows - 1)
                for j in range(columns):
                    padded[k, j + 1] = old[kind, row, j]
                padded[k, 0] = old[kind, row, columns - 1 if joined[0] else 0]
                padded[k, columns + 1] = old[kind, row, 0 if joined[0] else columns - 1]
            upper, middle, lower = padded[0], padded[1], padded[2]
            _flow_across(gain, upper, middle, lower, across)
            _flow_down(gain, upper, middle, above)
            _flow_down(gain, middle, lower, below)
            for j in range(columns):
                left = middle[j + 1] + (across[j] - across[j + 1]) + (above[j] - below[j])
                new[kind, i, j] = max(left, np.float32(0))


@kernel
def _flow_across(gain, upper, middle, lower, flow):
    for j in range(len(flow)):
        along = np.float32(0.5) * (middle[j + 1] - middle[j]) + np.float32(0.25) * (
            (upper[j + 1] - upper[j]) + (lower[j + 1] - lower[j])
        )
        beside = np.float32(0.25) * ((lower[j] - upper[j]) + (lower[j + 1] - upper[j + 1]))
        flow[j] = _flow(gain, middle[j], middle[j + 1], along, beside)


@kernel
def _flow_down(gain, upper, lower, flow):
    for j in range(len(flow)):
        along = np.float32(0.5) * (lower[j + 1] - upper[j + 1]) + np.float32(0.25) * (
            (lower[j] - upper[j]) + (lower[j + 2] - upper[j + 2])
        )
        beside = np.float32(0.25) * ((upper[j + 2] - upper[j]) + (lower[j + 2] - lower[j]))
        flow[j] = _flow(gain, upper[j + 1], lower[j + 1], along, beside)


@kernel
def _flow(gain, first, second, along, beside):
    # The flux from the first cell to the second, limited by the dye in the one and the room in the
    # other. The small number keeps faint smoke at rest, which would break up.
    one = np.float32(1)
    velocity = gain * along / np.sqrt(along * along + beside * beside + np.float32(1e-2))
    there = first * (one - second)
    back = second * (one - first)
    return velocity * (there if velocity > 0 else back)
