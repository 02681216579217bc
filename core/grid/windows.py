# SPDX-License-Identifier: GPL-3.0-or-later
"""Gaussian smoothing, minima and maxima in windows of any size, on planes of an image.

A plane is (h, w) float32. Windows are square and filters separable, so that the cost per pixel
hardly depends on the window's size. Each function is compiled, serial and without the GIL: threads
process bands of an image, with as many rows around them as the window reaches.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel

Plane = npt.NDArray[np.float32]

_TAIL = 3.5  # sigmas; beyond, a Gaussian's weights count as nothing


def gaussian(sigma: float) -> npt.NDArray[np.float32]:
    """Compute the weights of a Gaussian, from its middle outwards."""
    distances = np.arange(max(math.ceil(_TAIL * sigma), 1) + 1)
    weights = np.exp(-0.5 * (distances / max(sigma, 1e-6)) ** 2)
    return (weights / (2.0 * weights.sum() - weights[0])).astype(np.float32)


@kernel
def _mirrored(i, n):
    i %= 2 * n
    return i if i < n else 2 * n - 1 - i


@kernel
def smooth_rows(plane, first, height, weights, top, out):
    """Smooth some rows of a plane, mirrored at its borders.

    Parameters
    ----------
    plane : (n, w) float32
        Rows of the plane from `first` on: those of the result, and as many around as weights reach.
    first, height : int
        Which row of the plane is the first one here, and how many it has in all.
    weights : (k,) float32
    top : int
        The first row of the result.
    out : (m, w) float32
    """
    width = plane.shape[1]
    reach = weights.size - 1
    wide = np.empty(width + 2 * reach, np.float32)
    row = wide[reach : reach + width]
    for number in range(len(out)):
        y = top + number
        middle = plane[y - first]
        for x in range(width):
            row[x] = weights[0] * middle[x]
        for k in range(1, reach, 2):
            _add_four(
                weights[k],
                plane[_mirrored(y - k, height) - first],
                plane[_mirrored(y + k, height) - first],
                weights[k + 1],
                plane[_mirrored(y - k - 1, height) - first],
                plane[_mirrored(y + k + 1, height) - first],
                row,
            )
        if reach % 2:
            up = plane[_mirrored(y - reach, height) - first]
            _add_two(weights[reach], up, plane[_mirrored(y + reach, height) - first], row)
        for x in range(reach):
            wide[x] = row[_mirrored(x - reach, width)]
            wide[width + reach + x] = row[_mirrored(width + x, width)]
        line = out[number]
        for x in range(width):
            line[x] = weights[0] * row[x]
        for k in range(1, reach, 2):
            left, right = reach - k, reach + k
            _add_four(weights[k], wide[left:], wide[right:],
                      weights[k + 1], wide[left - 1 :], wide[right + 1 :], line)  # fmt: skip
        if reach % 2:
            _add_two(weights[reach], wide, wide[2 * reach :], line)


@kernel
def _add_two(weight, a, b, out):
    for x in range(len(out)):
        out[x] += weight * (a[x] + b[x])


@kernel
def _add_four(weight, a, b, other, c, d, out):
    # Sums are read and written half as often.
    for x in range(len(out)):
        out[x] = (out[x] + weight * (a[x] + b[x])) + other * (c[x] + d[x])


@kernel
def smooth(plane, weights):
    """Smooth a plane, mirrored at its borders: (h, w) -> (h, w)."""
    out = np.empty(plane.shape, np.float32)
    smooth_rows(plane, 0, len(plane), weights, 0, out)
    return out


@kernel
def least_and_greatest(low, high, reach):
    """Take the minimum of `low` and the maximum of `high` within `reach`, in place: (h, w) each.

    Along rows, windows of doubled sizes are taken, which become code for vectors. Along columns run
    the extrema of van Herk and of Gil and Werman: blocks as long as the window are accumulated in
    both directions, and a window is the end of one block and the start of the next.
    """
    height, width = low.shape
    if reach == 0:
        return
    line, spare = np.empty((2, width + 2 * reach), np.float32)
    for y in range(height):
        _run_row(np.float32(1.0), high[y], reach, line, spare)
        _run_row(np.float32(-1.0), low[y], reach, line, spare)
    _run_columns(np.float32(1.0), high, reach)
    _run_columns(np.float32(-1.0), low, reach)


@kernel
def _run_row(sign, row, reach, line, spare):
    width, size = row.size, 2 * reach + 1
    count = line.size
    line[:reach] = -np.inf
    line[reach + width :] = -np.inf
    for x in range(width):
        line[reach + x] = sign * row[x]
    now, then = line, spare
    half = 1  # the size of the windows that begin at each place of `now`
    while 2 * half <= size:
        count -= half
        shifted = now[half:]
        for x in range(count):
            then[x] = max(now[x], shifted[x])
        now, then = then, now
        half *= 2
    shifted = now[size - half :]
    for x in range(width):
        row[x] = sign * max(now[x], shifted[x])


@kernel
def _run_columns(sign, plane, reach):
    # The same for all columns at once; holds only two blocks of rows.
    size = 2 * reach + 1
    height, width = plane.shape
    lines = np.full((size, width), np.float32(-np.inf))
    to_end = np.empty((size, width), np.float32)
    ahead = np.empty((size, width), np.float32)
    _take_rows(sign, plane, -reach, lines)
    for first in range(0, height, size):
        # Rows first .. first + size - 1 of the result: their windows begin in this block.
        for x in range(width):
            to_end[size - 1, x] = lines[size - 1, x]
        for i in range(size - 2, -1, -1):
            for x in range(width):
                to_end[i, x] = max(lines[i, x], to_end[i + 1, x])
        _take_rows(sign, plane, first + size - reach, ahead)
        for i in range(size):
            for x in range(width):
                lines[i, x] = ahead[i, x]
        for i in range(1, size):
            for x in range(width):
                ahead[i, x] = max(ahead[i, x], ahead[i - 1, x])
        for i in range(min(size, height - first)):
            row = plane[first + i]
            for x in range(width):
                greatest = to_end[i, x]
                if i > 0:
                    greatest = max(greatest, ahead[i - 1, x])
                row[x] = sign * greatest


@kernel
def _take_rows(sign, plane, first, lines):
    height, width = plane.shape
    for i in range(len(lines)):
        y = first + i
        if 0 <= y < height:
            for x in range(width):
                lines[i, x] = sign * plane[y, x]
        else:
            for x in range(width):
                lines[i, x] = -np.inf
