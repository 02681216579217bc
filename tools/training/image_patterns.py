# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of patterns without borders, waves, lumps and spots, which must not be sharpened.

Waves look much like blurred stripes, but stripes have flat areas between their borders.
"""

from __future__ import annotations

import numpy as np
from image_examples import SIZE, as_bytes, colors, labels
from scipy import ndimage


def _turned(random):
    # Coordinates along a random direction and across it, straight or bent.
    y, x = np.mgrid[:SIZE, :SIZE].astype(float)
    if random.random() < 0.4:
        for axis in (y, x):
            bend = ndimage.gaussian_filter(random.normal(size=(SIZE, SIZE)), random.uniform(8, 30))
            axis += bend / bend.std() * np.exp(random.uniform(np.log(0.3), np.log(6)))
    a = random.choice([0, np.pi / 4, random.uniform(0, np.pi), random.uniform(0, np.pi)])
    return np.cos(a) * x + np.sin(a) * y, np.cos(a) * y - np.sin(a) * x


def waves(random):
    """Waves in one direction, in two, or in rings of a zone plate; lengths are 2.3 to 60 pixels."""
    along, across = _turned(random)
    length = np.exp(random.uniform(np.log(2.3), np.log(60)))
    k = 2 * np.pi / length
    kind = random.integers(4)
    if kind == 0:
        return np.sin(k * along)
    other = k * random.choice([1.0, 1.0, random.uniform(0.3, 1.0)])
    if kind == 1:
        return np.sin(k * along) + np.sin(other * across)
    if kind == 2:
        return np.sin(k * along) * np.sin(other * across)
    away = (along - random.uniform(0, SIZE)) ** 2 + (across - random.uniform(0, SIZE)) ** 2
    return np.sin(0.5 * k * away / SIZE)


def lumps(random):
    """Noise smoothed by a Gaussian, or the sum of two scales of it."""
    sigma = np.exp(random.uniform(np.log(1), np.log(10)))
    field = ndimage.gaussian_filter(random.normal(size=(SIZE, SIZE)), sigma, mode="wrap")
    field /= field.std()
    if random.random() < 0.4:
        fine = ndimage.gaussian_filter(random.normal(size=(SIZE, SIZE)), 0.5 * sigma, mode="wrap")
        field += random.uniform(0.2, 0.6) * fine / fine.std()
    return field if random.random() < 0.7 else np.abs(field)


def spots(random):
    """Round spots without a rim."""
    field = np.zeros((SIZE, SIZE))
    y, x = np.mgrid[:SIZE, :SIZE]
    for _ in range(random.integers(5, 120)):
        sigma = np.exp(random.uniform(np.log(0.7), np.log(9)))
        away = (x - random.uniform(0, SIZE)) ** 2 + (y - random.uniform(0, SIZE)) ** 2
        field += random.uniform(0.2, 1) * np.exp(-away / (2 * sigma**2))
    return field


def patterned(random):
    """Make a picture of one pattern, or of several with crisp borders: bytes, (n, n, 3)."""
    count = 1 if random.random() < 0.6 else int(random.integers(2, 6))
    label = labels(random, SIZE, 6, SIZE / 6, SIZE / 2) % count
    image = np.zeros((SIZE, SIZE, 3))
    for number in range(count):
        make = (waves, waves, lumps, spots)[random.integers(4)]
        field = make(random)
        field = (field - field.min()) / max(np.ptp(field), 1e-9)
        ends = colors(random, 2, random.choice([1.0, 1.0, 0.5])).astype(float)
        if random.random() < 0.3:  # little contrast
            ends[1] = ends[0] + (ends[1] - ends[0]) * random.uniform(0.05, 0.4)
        shown = ends[0] + field[..., None] * (ends[1] - ends[0])
        image = np.where((label == number)[..., None], shown, image)
    if random.random() < 0.3:
        image[:] = image.mean(2, keepdims=True)
    return as_bytes(255 * image)
