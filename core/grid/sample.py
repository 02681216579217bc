# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of an image between its pixels, with colors weighted by opacity."""

from __future__ import annotations

import numpy as np

from ..base.parallel import kernel


@kernel
def add_value(image, channels, place, nearest, total):
    """Add some channels at a place, times opacity, to `total`; return the opacity."""
    first, last, alpha, _ = channels
    row, column, down, across = place
    if nearest:
        row += down > 0.5
        column += across > 0.5
        opacity = 1.0 if alpha < 0 else float(image[row, column, alpha])
        for c in range(first, last):
            total[c] += opacity * image[row, column, c]
        return opacity
    k = down * across
    j = down - k
    i = across - k
    h = 1.0 - down - i
    if alpha >= 0:
        h *= image[row, column, alpha]
        i *= image[row, column + 1, alpha]
        j *= image[row + 1, column, alpha]
        k *= image[row + 1, column + 1, alpha]
    for c in range(first, last):
        total[c] += (
            h * image[row, column, c] + i * image[row, column + 1, c]
            + j * image[row + 1, column, c] + k * image[row + 1, column + 1, c]
        )  # fmt: skip
    return h + i + j + k


@kernel
def put_mean(image, y, x, channels, total, opacity, rounded, out):
    """Set a pixel's channels to `total` over `opacity`, or to its own values if that is zero."""
    for c in range(channels.start, channels.stop):
        if opacity > 0:
            value = total[c] / opacity
            out[y, x, c] = np.floor(value + 0.5) if rounded else value
        else:
            out[y, x, c] = image[y, x, c]
