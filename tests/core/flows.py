# SPDX-License-Identifier: GPL-3.0-or-later
"""Velocities in the plane, and what pictures of them show."""

import numpy as np
from scipy.ndimage import gaussian_filter, sobel


def uniform(size, right, up):
    """The same velocity everywhere."""
    return np.full((*size, 2), [right, up], dtype=float)


def rotation(size):
    """Counterclockwise around the middle, at an angle of 1 in a unit of time."""
    rows, columns = size
    y, x = np.mgrid[:rows, :columns].astype(float)
    return np.stack([y - (rows - 1) / 2, x - (columns - 1) / 2], axis=-1)


def saddle(size):
    """In from left and right, out above and below."""
    return rotation(size)[..., ::-1] * [-1.0, -1.0]


def source(size):
    """Out from the middle."""
    return rotation(size)[..., ::-1] * [1.0, -1.0]


def angle_to_flow(image, velocity, inside=None):
    """Mean angle between streaks and the flow, in degrees, where there are streaks."""
    down, right = sobel(image, axis=0), sobel(image, axis=1)
    xx, yy, xy = (gaussian_filter(each, 4.0) for each in (right**2, down**2, right * down))
    # The direction of least change, with y up.
    streak = 0.5 * np.arctan2(-2 * xy, xx - yy) + np.pi / 2
    flow = np.arctan2(velocity[..., 1], velocity[..., 0])
    apart = np.abs((streak - flow + np.pi / 2) % np.pi - np.pi / 2)
    inside = np.ones(image.shape, bool) if inside is None else inside
    return float(np.degrees(apart[inside].mean()))


def correlation(a, b):
    """Correlation of two images."""
    return float(np.corrcoef(a.ravel(), b.ravel())[0, 1])


def haar_energies(values):
    """Mean square of the Haar coefficients in each band, from fine to coarse, of a square image."""
    image = values.astype(float) - 0.5
    bands = []
    while len(image) > 4:
        a, b, c, d = image[::2, ::2], image[::2, 1::2], image[1::2, ::2], image[1::2, 1::2]
        details = [(a - b + c - d) / 2, (a + b - c - d) / 2, (a - b - c + d) / 2]
        bands.append(float(np.mean(np.square(details))))
        image = (a + b + c + d) / 2
    return np.array(bands)
