# SPDX-License-Identifier: GPL-3.0-or-later
"""Synthetic pictures for training to sharpen images, made from seeds.

They are overlapping shapes with flat, shaded and textured fills, plain textures, drawings with
lines and text, and mixtures of these. They are drawn at four times the size and averaged.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from scipy import ndimage
from scipy.spatial import cKDTree

SIZE = 160
FINE = 4
BIG = 768


def power_field(random, n, slope):
    f = np.hypot(np.fft.fftfreq(n)[:, None], np.fft.rfftfreq(n)[None])
    f[0, 0] = 1
    spectrum = f**-slope * np.exp(2j * np.pi * random.random(f.shape))
    spectrum[0, 0] = 0
    field = np.fft.irfft2(spectrum, (n, n)).astype(np.float32)
    return field / field.std()


def cells(random, n, count):
    """Make cells around random points, each of its own brightness, with darker gaps."""
    places = random.uniform(0, n, (count, 2))
    y, x = np.mgrid[0:n:2, 0:n:2]
    away, own = cKDTree(places).query(np.stack([y, x], 2).reshape(-1, 2), k=2)
    size = n / np.sqrt(count)
    value = random.normal(size=count)[own[:, 0]] * random.uniform(0.2, 1)
    gap = np.clip((away[:, 1] - away[:, 0]) / (random.uniform(0.08, 0.5) * size), 0, 1)
    round_ = 1 - (away[:, 0] / size) ** 2 * random.uniform(0, 2)
    field = (value + 2 * gap * round_).reshape(y.shape).astype(np.float32)
    field = field.repeat(2, 0).repeat(2, 1)
    return (field - field.mean()) / field.std()


def strokes(random, n, count, curved=False):
    """Draw many short lines of different brightness, like grass or fur."""
    image = Image.new("F", (n, n), 0.0)
    draw = ImageDraw.Draw(image)
    way, spread = random.uniform(0, np.pi), random.choice([0.15, 0.5, 3.0])
    length = random.uniform(20, 160)
    width = random.uniform(2, 12)
    for _ in range(count):
        x, y = random.uniform(0, n, 2)
        a = way + random.normal() * spread
        step = length * random.uniform(0.4, 1.5)
        points = [(x, y)]
        for _ in range(4 if curved else 1):
            x, y = x + step * np.cos(a), y + step * np.sin(a)
            points.append((x, y))
            a += random.normal() * 0.4
        draw.line(
            points, fill=float(random.normal()), width=max(int(width * random.uniform(0.5, 1.5)), 1)
        )
    field = np.asarray(image)
    return (field - field.mean()) / (field.std() + 1e-6)


def stripes(random, n):
    y, x = np.mgrid[:n, :n].astype(np.float32)
    a, period = random.uniform(0, np.pi), random.uniform(10, 80)
    bend = power_field(random, n, 2.5) * random.choice([0, 0, 0.3, 1.5])
    phase = (np.cos(a) * x + np.sin(a) * y) * (2 * np.pi / period) + bend
    wave = np.sin(phase)
    if random.random() < 0.6:
        wave = np.tanh(wave * random.uniform(2, 30) + random.uniform(-1, 1))
    if random.random() < 0.4:
        across = np.sin(
            (np.cos(a) * y - np.sin(a) * x) * (2 * np.pi / period / random.uniform(0.5, 3))
        )
        wave = np.minimum(wave, np.tanh(across * 10 + 8))
    return ((wave - wave.mean()) / (wave.std() + 1e-6)).astype(np.float32)


@cache
def bank():
    """Make the textures that all pictures share, at four times the size."""
    random = np.random.default_rng(77)
    found = [power_field(random, BIG, slope) for slope in np.linspace(0.6, 2.2, 12)]
    for _ in range(6):
        field = power_field(random, BIG, random.uniform(0.8, 1.8))
        bent = random.random() < 0.5
        found.append(np.tanh(field * random.uniform(1, 4)) if bent else np.abs(field) - 0.8)
    found += [cells(random, BIG, count) for count in (300, 1000, 3000, 8000, 2000, 5000)]
    found += [strokes(random, BIG, 3000, curved=i % 2 == 1) for i in range(8)]
    return found + [stripes(random, BIG) for _ in range(8)]


def piece(random, n):
    """Cut a random part out of a random texture, rotate it, and perhaps enlarge it."""
    field = bank()[random.integers(len(bank()))]
    zoom = random.choice([1, 1, 2])
    m = n // zoom
    y, x = random.integers(0, BIG - m + 1, 2)
    part = np.rot90(field[y : y + m, x : x + m], random.integers(4))
    if zoom > 1:
        part = ndimage.zoom(part, zoom, order=1)
    return part[:n, :n]


def colors(random, count, grayness):
    """Choose random colors that differ more in brightness than in hue."""
    gray = random.uniform(0, 1, (count, 1))
    return np.clip(gray + (1 - grayness) * random.normal(size=(count, 3)) * 0.25, 0, 1).astype(
        np.float32
    )


def outline(random, x, y, r):
    kind = random.integers(5)
    n = 24
    t = np.linspace(0, 2 * np.pi, n, endpoint=False)
    turn, thin = random.uniform(0, np.pi), random.uniform(0.25, 1)
    if kind == 0:
        rad = np.ones(n)
    elif kind == 1:
        rad = 1 + 0.35 * sum(
            random.normal() / k * np.sin(k * t + random.uniform(0, 6)) for k in (2, 3, 4, 5)
        )
    elif kind == 2:
        t = np.array([0.25, 0.75, 1.25, 1.75]) * np.pi
        rad = np.ones(4)
    elif kind == 3:
        t = np.sort(random.uniform(0, 2 * np.pi, random.integers(3, 7)))
        rad = random.uniform(0.5, 1.3, len(t))
    else:
        rad, thin = np.ones(n), random.uniform(0.04, 0.2)
    u, v = r * rad * np.cos(t), r * thin * rad * np.sin(t)
    c, s = np.cos(turn), np.sin(turn)
    return list(zip((x + c * u - s * v).tolist(), (y + s * u + c * v).tolist(), strict=True))


def labels(random, n, count, least, most, power=3.0):
    """Make a label map of overlapping shapes whose sizes follow a power law."""
    image = Image.new("I", (n, n), 0)
    draw = ImageDraw.Draw(image)
    u = random.random(count)
    a = 1 - power
    sizes = (least**a + u * (most**a - least**a)) ** (1 / a)
    if random.random() < 0.5:  # small ones above
        sizes[: count // 3] = np.sort(sizes[: count // 3])[::-1]
    for number, r in enumerate(sizes, 1):
        x, y = random.uniform(-r / 2, n + r / 2, 2)
        draw.polygon(outline(random, x, y, r), fill=number)
    return np.asarray(image)


def filled(random, label, grayness, textured, shaded):
    """Fill each label with a color, a gradient and a texture: (n, n, 3)."""
    n, count = label.shape[0], label.max() + 1
    base = colors(random, count, grayness)
    if random.random() < 0.3:  # few colors
        base = base[random.integers(0, min(count, 6), count)]
    image = base[label]
    y, x = (np.mgrid[:n, :n] / n - 0.5).astype(np.float32)
    if shaded > 0:
        slopes = (
            random.normal(size=(count, 2)).astype(np.float32)
            * shaded
            * (random.random((count, 1)) < 0.6)
        )
        slopes = slopes.astype(np.float32)
        image += (slopes[label, 0] * x + slopes[label, 1] * y)[..., None]
    if textured > 0:
        own = random.integers(0, 5, count)
        size = np.exp(random.uniform(np.log(0.004), np.log(textured), count)).astype(np.float32)
        size *= random.random(count) < 0.85
        chosen = own[label]
        for k in range(5):
            at = chosen == k
            if at.any():
                tint = np.clip(1 + 0.3 * random.normal(size=3), 0, 2).astype(np.float32)
                image[at] += (piece(random, n)[at] * size[label[at]])[:, None] * tint
    return image


def text(random, image, n):
    """Write lines of random letters on an image, in place."""
    mask = Image.new("L", (n, n), 0)
    draw = ImageDraw.Draw(mask)
    size = int(FINE * np.exp(random.uniform(np.log(7), np.log(50))))
    font = ImageFont.load_default(size)
    letters = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789 .,;()   "
    y = random.uniform(0, size)
    while y < n:
        line = "".join(random.choice(list(letters), 60))
        draw.text((random.uniform(-size, size), y), line, fill=255, font=font)
        y += size * random.uniform(1.1, 2.0)
    if random.random() < 0.3:
        mask = mask.rotate(random.uniform(-40, 40), fillcolor=0)
    image[np.asarray(mask) > 128] = (
        colors(random, 1, 0.5)[0] if random.random() < 0.6 else random.choice([0.0, 1.0])
    )


def lines(random, image, n, count):
    mask = Image.new("L", (n, n), 0)
    draw = ImageDraw.Draw(mask)
    for _ in range(count):
        width = int(FINE * np.exp(random.uniform(np.log(0.7), np.log(6))))
        points = random.uniform(-0.1 * n, 1.1 * n, (random.integers(2, 5), 2))
        if random.random() < 0.4:
            t = np.linspace(0, 1, 24)[:, None]
            p = points[[0, 1, -1]]
            points = (1 - t) ** 2 * p[0] + 2 * t * (1 - t) * p[1] + t * t * p[2]
        draw.line([tuple(p) for p in points.tolist()], fill=255, width=max(width, 1))
    image[np.asarray(mask) > 128] = colors(random, 1, 0.5)[0]


def leaves(random, n, photo=True):
    grayness = random.choice([1.0, 0.8, 0.5])
    least = FINE * random.choice([0.7, 1.5, 4, 10])
    most = n * random.uniform(0.15, 0.5)
    count = int(
        np.clip(random.choice([100, 400, 1200, 2500]) * (1.5 * FINE / least) ** 0.5, 30, 2500)
    )
    label = labels(random, n, count, least, most, random.uniform(2, 3.2))
    textured = random.choice([0.02, 0.08, 0.25]) if photo else 0
    image = filled(random, label, grayness, textured, random.choice([0, 0.3, 1.0]))
    if photo and random.random() < 0.35:  # in front of a soft background
        soft = FINE * random.uniform(1.5, 8)
        back = filled(random, labels(random, n, 200, 8 * FINE, n / 2), grayness, 0.05, 0.5)
        back = np.stack([ndimage.gaussian_filter(back[..., c], soft) for c in range(3)], 2)
        front = labels(random, n, random.integers(3, 30), 4 * FINE, n / 3) > 0
        image = np.where(front[..., None], image, back)
    if photo and random.random() < 0.4:  # soft light and shadow
        light = power_field(random, n, 2.2) * random.uniform(0.05, 0.25)
        image = image * (1 + light[..., None])
    return image


def drawing(random, n):
    grayness = random.choice([1.0, 0.3, 0.0])
    label = labels(
        random,
        n,
        random.integers(1, 60),
        FINE * random.uniform(2, 12),
        n / 2,
        random.uniform(1.2, 3),
    )
    image = filled(random, label, grayness, 0, random.choice([0, 0, 0.3, 0.8]))
    kind = random.random()
    if kind < 0.3:
        image[:] = colors(random, 1, 0.5)[0] if random.random() < 0.5 else 1.0
    if random.random() < 0.5:
        lines(random, image, n, random.integers(1, 25))
    if random.random() < 0.45:
        text(random, image, n)
    if random.random() < 0.15:  # hatching
        field = piece(random, n) > 0
        where = labels(random, n, 6, n / 8, n / 3) > 0
        image[field & where] = colors(random, 1, 0.5)[0]
    if random.random() < 0.15:
        image += np.float32(random.uniform(0.003, 0.05)) * piece(random, n)[..., None]
    return image


def texture(random, n):
    first, second = piece(random, n), piece(random, n)
    a, b = random.uniform(0.03, 0.25), random.uniform(0, 0.1)
    base = colors(random, 1, 0.7)[0]
    tint = np.clip(1 + 0.3 * random.normal(size=3), 0, 2)
    image = base + a * first[..., None] * tint + b * second[..., None]
    if random.random() < 0.5:
        image = image + 0.15 * power_field(random, n, 2.2)[..., None]
    return image.astype(np.float32)


def truth(random):
    n = SIZE * FINE
    kind = random.random()
    photo = True
    if kind < 0.42:
        image = leaves(random, n)
    elif kind < 0.57:
        image = texture(random, n)
    elif kind < 0.87:
        image, photo = drawing(random, n), False
    else:
        one, two = leaves(random, n, random.random() < 0.7), drawing(random, n)
        where = labels(random, n, random.integers(1, 8), n / 6, n / 2) > 0
        image = np.where(where[..., None], one, two)
    image = np.clip(image, 0, 1).reshape(SIZE, FINE, SIZE, FINE, 3).mean((1, 3))
    if random.random() < 0.3:  # little contrast
        image = random.uniform(0, 0.6) + image * random.uniform(0.1, 0.6)
    if photo:
        own = random.choice([0, 0.3, 0.5, 0.7, 1.0], p=[0.3, 0.2, 0.25, 0.15, 0.1])
        if own:
            image = ndimage.gaussian_filter(image, (own, own, 0))
        if random.random() < 0.5:
            grain = (
                random.normal(size=image.shape) * (random.random() < 0.5)
                + random.normal(size=image.shape[:2])[..., None]
            )
            soft = random.choice([0, 0.6])
            image = (
                image
                + ndimage.gaussian_filter(grain, (soft, soft, 0)) * random.uniform(0.3, 3.0) / 255
            )
    if random.random() < 0.4:
        image[:] = image.mean(2, keepdims=True)
    return as_bytes(255 * image)


def hues(random, n):
    """Make slowly changing colors: around a point, across the picture, or at random."""
    y, x = np.mgrid[:SIZE, :SIZE].astype(np.float32)
    kind = random.integers(4)
    if kind == 0:
        turn = np.arctan2(y - random.uniform(0, SIZE), x - random.uniform(0, SIZE)) / (2 * np.pi)
        hue = turn * random.integers(1, 3) + random.random()
    elif kind == 1:
        a = random.uniform(0, 2 * np.pi)
        hue = (np.cos(a) * x + np.sin(a) * y) / (SIZE * random.uniform(0.5, 2)) + random.random()
    else:
        count = 1 if kind == 2 else 3
        soft = random.uniform(12, 40)
        noise = random.normal(size=(SIZE, SIZE, count))
        hue = ndimage.gaussian_filter(noise, (soft, soft, 0), mode="wrap")
        hue /= np.abs(hue).max()
    if hue.ndim == 2 or hue.shape[2] == 1:
        wheel = np.abs((6 * hue.reshape(SIZE, SIZE, 1) + (0, 2, 4)) % 6 - 3) - 1
        image = wheel.clip(0, 1) * random.uniform(0.3, 1) + random.uniform(0, 0.3)
    else:
        image = 0.5 + hue * random.uniform(0.2, 0.6)
    return image.clip(0, 1).astype(np.float32).repeat(n // SIZE, 0).repeat(n // SIZE, 1)


def areas(random, n):
    """Make a label map of Voronoi cells, three of which meet at each corner."""
    points = random.uniform(0, n, (random.integers(3, 50), 2))
    places = np.mgrid[:n, :n].astype(np.float32)
    if random.random() < 0.5:
        bent = random.uniform(0, 0.06, 2) * n
        waves = np.sin(places[::-1] * (random.uniform(4, 20) / n))
        places += bent[:, None, None].astype(np.float32) * waves
    _, nearest = cKDTree(points).query(np.moveaxis(places, 0, 2).reshape(-1, 2))
    return nearest.reshape(n, n)


def plain(random):
    """Make few large shapes of plain or slowly changing color: bytes (SIZE, SIZE, 3)."""
    n = SIZE * FINE
    if random.random() < 0.3:
        label = areas(random, n)
    else:
        label = labels(random, n, random.integers(1, 9), 16 * FINE, n / 2, random.uniform(1.2, 2))
    image = filled(random, label, random.choice([1.0, 0.3, 0.0]), 0, 0)
    if random.random() < 0.35:
        some = random.random(label.max() + 1) < random.choice([0.4, 1.0])
        image = np.where(some[label][..., None], hues(random, n), image)
    image = np.clip(image, 0, 1).reshape(SIZE, FINE, SIZE, FINE, 3).mean((1, 3))
    if random.random() < 0.4:
        image[:] = image.mean(2, keepdims=True)
    return as_bytes(255 * image)


def as_bytes(values):
    """Round and clip to bytes."""
    return np.rint(values).clip(0, 255).astype(np.uint8)
