# SPDX-License-Identifier: GPL-3.0-or-later
"""Reduces the pictures of `image_examples`, as examples for training to enlarge."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image
from scipy import ndimage

WAYS = {
    Image.Resampling.BICUBIC: 0.45,
    Image.Resampling.LANCZOS: 0.2,
    Image.Resampling.BOX: 0.25,
    Image.Resampling.BILINEAR: 0.1,
}
"""Filters that reduce pictures, and the probability of each."""


def _bytes(values):
    return np.rint(values).clip(0, 255).astype(np.uint8)


def reduced(random, image, times):
    """Reduce a picture as programs do, some with halos, light noise, or JPEG compression."""
    given = image.astype(np.float64)
    if random.random() < 0.12:
        s = random.uniform(0.2, 0.35) * times
        given = ndimage.gaussian_filter(given, (s, s, 0), mode="mirror")
    way = random.choice(list(WAYS), p=list(WAYS.values()))
    size = image.shape[1] // times, image.shape[0] // times
    small = Image.fromarray(_bytes(given)).resize(size, Image.Resampling(way))
    if random.random() < 0.1:
        small = _haloed(random, small)
    if random.random() < 0.12:
        noise = random.normal(size=(*np.shape(small)[:2], random.choice([1, 3])))
        small = Image.fromarray(_bytes(small + random.uniform(0.5, 3.0) * noise))
    if random.random() < 0.12:
        file = io.BytesIO()
        small.save(file, "JPEG", quality=int(random.integers(85, 98)))
        small = Image.open(file)
    return np.asarray(small.convert("RGB"))


def _haloed(random, small):
    values = np.asarray(small).astype(np.float64)
    s = random.uniform(0.5, 1.2)
    away = values - ndimage.gaussian_filter(values, (s, s, 0), mode="mirror")
    return Image.fromarray(_bytes(values + random.uniform(0.3, 1.0) * away))
