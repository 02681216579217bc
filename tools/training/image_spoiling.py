# SPDX-License-Identifier: GPL-3.0-or-later
"""Degrades synthetic pictures: by blur, reduction, noise and compression."""

from __future__ import annotations

import io
from typing import NamedTuple

import numpy as np
from image_examples import SIZE, as_bytes, labels, plain, truth
from image_patterns import patterned
from PIL import Image
from scipy import ndimage


class Copy(NamedTuple):
    """A degraded copy of a picture."""

    given: np.ndarray
    same: bool = False
    """True if it is not degraded."""
    square: float = 0.0
    """Squared sigma of the blur, in pixels; 0 if unknown."""


def disk(radius, thin=1.0, turn=0.0):
    n = int(np.ceil(radius)) + 1
    y, x = (np.mgrid[: 8 * (2 * n + 1), : 8 * (2 * n + 1)] + 0.5) / 8 - n - 0.5
    u, v = np.cos(turn) * x + np.sin(turn) * y, np.cos(turn) * y - np.sin(turn) * x
    w = (
        (np.hypot(u, v / thin) < radius)
        .reshape(2 * n + 1, 8, 2 * n + 1, 8)
        .sum((1, 3))
        .astype(float)
    )
    return w / w.sum()


def spoiled(random, image):
    """Degrade a picture in one of many ways, or not at all."""
    given, square = image.astype(np.float64), 0.0
    kind = random.random()
    if kind < 0.14:
        if random.random() < 0.6:
            return Copy(image.copy(), True)
    elif kind < 0.5:
        s = np.exp(random.uniform(np.log(0.4), np.log(3.7)))
        given, square = ndimage.gaussian_filter(given, (s, s, 0), mode="mirror"), s**2
    elif kind < 0.62:
        r = random.uniform(0.8, 4.5)
        given, square = ndimage.convolve(given, disk(r)[..., None], mode="mirror"), r**2 / 4
    elif kind < 0.67:
        size = int(random.integers(2, 7))
        given = ndimage.uniform_filter(given, (size, size, 0), mode="mirror")
    elif kind < 0.74:
        r = random.uniform(1.2, 4.5)
        given = ndimage.convolve(
            given, disk(r, 0.6 / r, random.uniform(0, np.pi))[..., None], mode="mirror"
        )
    else:
        if random.random() < 0.25:
            s = random.uniform(0.4, 1.2)
            given = ndimage.gaussian_filter(given, (s, s, 0), mode="mirror")
        factor = random.choice([1.5, 2, 2, 2.5, 3, 4, 4])
        ways = (
            Image.Resampling.BOX,
            Image.Resampling.BICUBIC,
            Image.Resampling.LANCZOS,
            Image.Resampling.BILINEAR,
        )
        down, up = ways[random.choice([0, 1, 2])], ways[random.choice([1, 1, 2, 3])]
        small = Image.fromarray(as_bytes(given)).resize((round(SIZE / factor),) * 2, down)
        if random.random() < 0.15:
            small = _jpeg(small, int(random.integers(50, 96)))
        given = np.asarray(small.resize((SIZE, SIZE), up)).astype(np.float64)
    gray = (image[..., 0] == image[..., 1]).all() and (image[..., 0] == image[..., 2]).all()
    if random.random() < 0.27:
        size = np.exp(random.uniform(np.log(0.5), np.log(10)))
        grain = random.normal(size=given.shape)
        if gray or random.random() < 0.4:
            grain[:] = grain[..., :1]
        if random.random() < 0.4:
            soft = random.uniform(0.4, 0.8)
            grain = ndimage.gaussian_filter(grain, (soft, soft, 0))
            grain /= grain.std()
        if random.random() < 0.3:
            grain *= 0.3 + given.mean(2, keepdims=True) / 160
        given = given + size * grain
    given = as_bytes(given)
    if random.random() < 0.3:
        given = np.asarray(_jpeg(Image.fromarray(given), int(random.integers(30, 96))))
    return Copy(given, square=square)


def _jpeg(image, quality):
    file = io.BytesIO()
    image.save(file, "JPEG", quality=quality)
    return Image.open(file).convert("RGB")


WIDELY = 30000
"""From this seed on, the pictures of the seeds from 10000 on are used again, with wide blur."""


def widely(random, image):
    given = image.astype(np.float64)
    if random.random() < 0.6:
        s = random.uniform(1.8, 4.5)
        given, square = ndimage.gaussian_filter(given, (s, s, 0), mode="mirror"), s**2
    else:
        r = random.uniform(3.0, 7.0)
        given, square = ndimage.convolve(given, disk(r)[..., None], mode="mirror"), r**2 / 4
    if random.random() < 0.3:
        given = given + random.uniform(0.5, 4.0) * random.normal(size=given.shape)
    given = as_bytes(given)
    if random.random() < 0.3:
        given = np.asarray(_jpeg(Image.fromarray(given), int(random.integers(60, 96))))
    return Copy(given, square=square)


SOFTLY = 50000
"""From this seed on, the pictures of the seeds from 10000 on are softened more than any blur that
is to be removed. They are targets: soft shapes, as of an airbrush, must stay soft."""


def softened(random, image):
    """Soften a whole picture, or one side of a line."""
    values = image.astype(np.float64)
    s = np.exp(random.uniform(np.log(7), np.log(22)))
    soft = ndimage.gaussian_filter(values, (s, s, 0), mode="mirror")
    middle = soft.mean((0, 1))
    most = np.abs(soft - middle).max() + 1
    soft = middle + (soft - middle) * (random.uniform(10, 130) / most)
    if random.random() < 0.4:
        y, x = np.mgrid[:SIZE, :SIZE] - SIZE / 2 + 0.5
        angle = random.uniform(0, 2 * np.pi)
        away = np.cos(angle) * x + np.sin(angle) * y + random.uniform(-40, 40)
        soft += (values - soft) * np.clip(away + 0.5, 0, 1)[..., None]
    return as_bytes(soft)


PLAINLY = 70000
"""From this seed on, pictures have a few plain shapes. In bytes, their blurred borders become
stairs, with steps of one level several pixels wide."""

WIDE = 5.0
"""Softer borders of plain shapes, with a larger sigma in pixels, belong to the target picture."""


def plainly(random, image):
    given = image.astype(np.float64)
    s = np.exp(random.uniform(np.log(1.0), np.log(4.2)))
    soft = ndimage.gaussian_filter(given, (s, s, 0), mode="mirror")
    if s < 3 and random.random() < 0.5:  # with long tails
        wide = ndimage.gaussian_filter(given, (1.5 * s, 1.5 * s, 0), mode="mirror")
        narrow = ndimage.gaussian_filter(given, (0.6 * s, 0.6 * s, 0), mode="mirror")
        soft = (wide + 2 * narrow) / 3
    if random.random() < 0.25:
        soft = soft + random.uniform(0.2, 2.0) * random.normal(size=soft.shape)
    given = as_bytes(soft)
    if random.random() < 0.15:
        given = np.asarray(_jpeg(Image.fromarray(given), int(random.integers(75, 96))))
    return Copy(given, square=s**2)


PATTERNED = 90000
"""From this seed on, pictures have patterns without borders; the first copy is not degraded."""


def narrowly(random, image):
    """Blur a picture narrowly, or not at all."""
    if random.random() < 0.25:
        return Copy(image.copy(), True)
    s = random.uniform(0.4, 3.5)
    given = ndimage.gaussian_filter(image.astype(float), (s, s, 0), mode="mirror")
    return Copy(as_bytes(given), square=s**2)


def backed(random, image, copies):
    """Cover parts of a picture and its copies by one color, with crisp rims, like an atlas."""
    label = labels(random, SIZE, random.integers(2, 7), SIZE / 5, SIZE / 2, random.uniform(1.2, 2))
    hidden = (label == label.max() if random.random() < 0.5 else label == 0)[..., None]
    color = random.choice([0, 128, 255, *random.integers(0, 256, 3)])
    return (
        np.where(hidden, np.uint8(color), image),
        [copy._replace(given=np.where(hidden, np.uint8(color), copy.given)) for copy in copies],
    )


SPOTTED, ALONE = 0.3, 0.15
"""Share of the pictures with soft spots on them, and of plain pictures with nothing else."""


def spotted(random, image, sigmas=(1.5, 8.0)):
    """Paint spots with soft rims on a picture, as an airbrush does, which must stay soft."""
    values = image.astype(np.float64)
    for _ in range(random.integers(1, 4)):
        label = labels(random, SIZE, int(random.integers(2, 16)), 3, random.uniform(10, 40), 2.0)
        some = random.random(label.max() + 1) < 0.8
        some[0] = False
        s = np.exp(random.uniform(*np.log(sigmas)))
        cover = ndimage.gaussian_filter(some[label].astype(float), s, mode="mirror")
        cover *= random.uniform(0.3, 1) / max(cover.max(), 0.3)
        color = random.uniform(0, 255, 3)
        if (image[..., 0] == image[..., 1]).all():
            color[:] = color[0]
        values += cover[..., None] * (color - values)
    return as_bytes(values)


TOLD, PARTLY = 0.25, 0.3
"""Share of the copies whose width of blur is given to the network; and the share of these from
which only a part of the blur is to be removed."""


def told(random, image, copy, most):
    """Choose the squared sigma that is given to the network, 0 for none, and the target for it."""
    if copy.square == 0 or random.random() > TOLD:
        return 0.0, image
    if random.random() < PARTLY or copy.square > most:
        square = min(copy.square * random.uniform(0.15, 0.8), most)
        left = np.sqrt(copy.square - square)
        soft = ndimage.gaussian_filter(image.astype(float), (left, left, 0), mode="mirror")
        return square, as_bytes(soft)
    return min(copy.square * random.uniform(0.93, 1.07), most), image


def example(seed, count=3):
    """Make a target picture, bytes (n, n, 3), and degraded copies of it."""
    random = np.random.default_rng(seed)
    again = lambda first: truth(np.random.default_rng(seed - first + 10000))  # noqa: E731
    if seed < WIDELY:
        image, ways = truth(random), [spoiled]
    elif seed < SOFTLY:
        image, ways = again(WIDELY), [widely]
    elif seed < PLAINLY:
        image = softened(random, again(SOFTLY))
        return image, [Copy(image, True), *(spoiled(random, image) for _ in range(count - 1))]
    elif seed >= PATTERNED:
        image = patterned(random)
        return image, [Copy(image, True), narrowly(random, image), spoiled(random, image)]
    else:
        image, ways = plain(random), [plainly, narrowly, spoiled]
    share = random.random()
    if seed >= PLAINLY and share < ALONE:
        image = spotted(random, np.full_like(image, image[0, 0]), (WIDE, 16.0))
    elif seed >= PLAINLY and share < ALONE + SPOTTED:
        image = spotted(random, image, (1.5, 16.0))
    elif share < SPOTTED:
        image = spotted(random, image)
    copies = [ways[i % len(ways)](random, image) for i in range(count)]
    if (seed < WIDELY or seed >= PLAINLY) and random.random() < 0.1:
        return backed(random, image, copies)
    return image, copies
