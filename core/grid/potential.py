# SPDX-License-Identifier: GPL-3.0-or-later
"""The potential of an image, of which the flow is half the gradient (paper A, section 3.2)."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..base.progress import phase
from .channels import Channels

ROWS = 16
"""Rows of an image that a kernel processes at once."""

_NEIGHBOUR = math.exp(-1.0)  # the Gaussian umbrella's weight at distance 1


def image_potential(
    image: npt.NDArray, scale: float, channels: Channels, passes: int
) -> npt.NDArray[np.float32]:
    """Compute P = sum over channels of the squared gradient, smoothed before and after.

    Parameters
    ----------
    image : (h, w, c) array of any real type
        h and w at least 2.
    scale : float
        Factor that brings values to [0, 1], such as 1 / 255.
    channels : Channels
        Colors are weighted by opacity.
    passes : int
        Smoothing passes on the signal and on P.

    Returns
    -------
    (h, w) float32
    """
    potential = np.empty(image.shape[:2], dtype=np.float32)
    with phase(0.0, 0.8, "Computing the flow"):
        run(_potential_rows, len(image), image, np.float32(scale), channels, passes, potential,
            chunk=ROWS)  # fmt: skip
    with phase(0.8, 1.0, "Computing the flow"):
        return smoothed_potential(potential, passes)


def smoothed_potential(potential: npt.NDArray[np.float32], passes: int) -> npt.NDArray[np.float32]:
    """Smooth a potential that is overwritten: (h, w)."""
    spare = np.empty_like(potential) if passes else potential
    for done in range(passes):
        with phase(done / passes, (done + 1) / passes, "Computing the flow"):
            run(_smooth_rows, len(potential), potential, spare, chunk=ROWS)
        potential, spare = spare, potential
    return potential


def flow_reach(passes: int) -> int:
    """Distance in pixels within which the image affects P at a pixel."""
    return 2 * passes + 1


@kernel
def _potential_rows(start, stop, image, scale, channels, passes, potential):
    # Planar working copy of the rows that this band depends on.
    height, width = image.shape[:2]
    first_channel, last_channel, alpha, brightness = channels
    first = max(start - 1 - passes, 0)
    last = min(stop + 1 + passes, height)
    rows = last - first
    signal = np.empty((rows, width), np.float32)
    spare = np.empty((rows, width), np.float32)
    top = max(start - 1, 0)  # squares top .. bottom - 1 touch the band
    bottom = min(stop, height - 1)
    energy = np.zeros((bottom - top, width - 1), np.float32)
    guides = 1 if brightness.size > 0 else last_channel - first_channel
    for guide in range(guides):
        for y in range(rows):
            if brightness.size > 0:
                for x in range(width):
                    total = np.float32(0.0)
                    for c in range(brightness.size):
                        total += brightness[c] * np.float32(image[first + y, x, first_channel + c])
                    signal[y, x] = scale * total
            else:
                for x in range(width):
                    signal[y, x] = scale * np.float32(image[first + y, x, first_channel + guide])
            if alpha >= 0:
                for x in range(width):
                    signal[y, x] *= scale * np.float32(image[first + y, x, alpha])
        for _ in range(passes):
            for y in range(rows):
                _smooth_row(signal, y, spare)
            signal, spare = spare, signal
        for r in range(bottom - top):
            y = top + r - first
            for x in range(width - 1):
                across = signal[y, x + 1] - signal[y, x] + signal[y + 1, x + 1] - signal[y + 1, x]
                down = signal[y + 1, x] - signal[y, x] + signal[y + 1, x + 1] - signal[y, x + 1]
                energy[r, x] += np.float32(0.25) * (across * across + down * down)
    for y in range(start, stop):
        above = max(y - 1, 0) - top
        below = min(y, height - 2) - top
        for x in range(width):
            left = max(x - 1, 0)
            right = min(x, width - 2)
            # At borders the same square counts twice, so that the mean is of the existing ones.
            total = energy[above, left] + energy[above, right]
            total += energy[below, left] + energy[below, right]
            potential[y, x] = min(np.float32(0.25) * total, np.float32(1e30))


@kernel
def _smooth_row(values, y, out):
    # One umbrella pass on a row; neighbours are the pixels up, down, left and right.
    height, width = values.shape
    weight = np.float32(_NEIGHBOUR)
    vertical = np.float32(0.0)
    up, down = max(y - 1, 0), min(y + 1, height - 1)
    has_up = np.float32(up != y)
    has_down = np.float32(down != y)
    vertical = has_up + has_down
    inner = np.float32(1.0) / (np.float32(1.0) + weight * (vertical + np.float32(2.0)))
    outer = np.float32(1.0) / (np.float32(1.0) + weight * (vertical + np.float32(1.0)))
    for x in range(1, width - 1):
        around = values[y, x - 1] + values[y, x + 1]
        around += has_up * values[up, x] + has_down * values[down, x]
        out[y, x] = (values[y, x] + weight * around) * inner
    for x, beside in ((0, 1), (width - 1, width - 2)):
        around = values[y, beside] + has_up * values[up, x] + has_down * values[down, x]
        out[y, x] = (values[y, x] + weight * around) * outer


@kernel
def _smooth_rows(start, stop, values, out):
    for y in range(start, stop):
        _smooth_row(values, y, out)
