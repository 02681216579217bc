# SPDX-License-Identifier: GPL-3.0-or-later
"""Recognition of pixel art, and enlarging of small drawings compared with other methods.

All is made by code, but photos, which are scikit-image's. For each kind the table has the largest
and the least of what is measured, and of the share of pixel art that follows.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from dials import Bytes, drawing, fidelity, photos
from PIL import Image, ImageDraw
from report import Page, table
from shock_filter import core
from shock_filter.core.color.pixel_art import pixel_art

SEEDS = range(11, 23)
SIDES = 16, 32, 64, 128
REDUCED = {
    "Lanczos": Image.Resampling.LANCZOS,
    "bicubic": Image.Resampling.BICUBIC,
    "mean": Image.Resampling.BOX,
}
TIMES = 3


def sprite(seed: int, side: int) -> Bytes:
    """A symmetric figure of some colors in bands, with an outline."""
    random = np.random.default_rng(seed)
    half = random.random((side, side // 2)) < 0.55
    body = np.concatenate([half, half[:, ::-1]], axis=1)
    around = np.pad(body, 1)
    near = around[:-2, 1:-1] | around[2:, 1:-1] | around[1:-1, :-2] | around[1:-1, 2:]
    bands = random.integers(3, 9)
    which = np.where(body, 1 + np.arange(side)[:, None] * bands // side, 0)
    which[near & ~body] = bands + 1
    return random.integers(0, 256, (bands + 2, 3)).astype(np.uint8)[which]


def dithered(seed: int, side: int) -> Bytes:
    """A sky of eight colors, dithered in order."""
    random = np.random.default_rng(seed)
    pattern = np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]]) / 16.0
    y, x = np.mgrid[:side, :side]
    which = (y / side * 7 + pattern[y % 4, x % 4]).astype(int)
    return random.integers(0, 256, (8, 3)).astype(np.uint8)[which]


def shaded(seed: int, side: int) -> Bytes:
    """A ball in eight brightnesses of one color."""
    random = np.random.default_rng(seed)
    y, x = np.mgrid[:side, :side] / side
    away = np.hypot(y - 0.4, x - 0.4) * 10
    color = random.uniform(0.5, 1.0, 3)
    levels = np.linspace(30, 255, 8)[np.clip(7 - away.astype(int), 0, 7)]
    return np.rint(levels[..., None] * color).astype(np.uint8)


def logo(seed: int, side: int, fine: int = 4) -> Bytes:
    """Three shapes on paper, antialiased."""
    random = np.random.default_rng(seed)
    n = side * fine
    image = Image.new("RGB", (n, n), tuple(int(v) for v in random.integers(200, 256, 3)))
    draw = ImageDraw.Draw(image)
    one, two, three = (tuple(int(v) for v in random.integers(0, 200, 3)) for _ in range(3))
    draw.ellipse([0.1 * n, 0.1 * n, 0.9 * n, 0.9 * n], fill=one)
    draw.rectangle([0.3 * n, 0.25 * n, 0.7 * n, 0.5 * n], fill=two)
    corners = random.uniform(0.1, 0.9, (3, 2)) * n
    draw.polygon([tuple(corner) for corner in corners], fill=three)
    return np.asarray(image.resize((side, side), Image.Resampling.BOX))


def few_colors(image: Bytes, count: int) -> Bytes:
    """Take the nearest of some colors, without dithering."""
    picture = Image.fromarray(image).quantize(count, dither=Image.Dither.NONE)
    return np.asarray(picture.convert("RGB"))


def resized(image: Bytes, side: int, way: Image.Resampling = Image.Resampling.BOX) -> Bytes:
    """Reduce to a square."""
    return np.asarray(Image.fromarray(image).resize((side, side), way))


def kinds() -> dict[str, list[Bytes]]:
    """Images of each kind; those of the first three are pixel art."""
    made = [(seed, side) for seed in SEEDS for side in SIDES]
    large = [drawing(seed) for seed in SEEDS]
    return {
        "figures": [sprite(*each) for each in made],
        "dithered skies": [dithered(*each) for each in made],
        "shaded balls": [shaded(*each) for each in made],
        "logos": [logo(*each) for each in made],
        "logos, from 2 x 2": [logo(*each, 2) for each in made],
        "logos of 16 colors": [few_colors(logo(*each), 16) for each in made],
        "drawings": [resized(image, side, way) for image in large for side in SIDES
                     for way in REDUCED.values()],
        "photos": [resized(image, side) for image in photos(None).values() for side in SIDES],
        "photos of 16 colors": [few_colors(resized(image, side), 16)
                                for image in photos(None).values() for side in SIDES],
    }  # fmt: skip


def shares() -> str:
    """Shares of pixel art of all kinds."""
    rows = []
    for kind, images in kinds().items():
        found = np.array([pixel_art(image) for image in images])
        rows.append([kind, str(len(images)), f"{found.min():.2f}", f"{found.mean():.2f}",
                     f"{found.max():.2f}", str(np.count_nonzero(found >= 0.5))])  # fmt: skip
    return table(["", "images", "least share", "mean", "largest", "taken for pixel art"], rows)


def small_drawings() -> str:
    """Reduced drawings, enlarged again by Blender's methods and by ours."""
    rows, gains = [], []
    for name, way in REDUCED.items():
        found = []
        for seed in SEEDS:
            truth = drawing(seed)[: 256 // TIMES * TIMES, : 256 // TIMES * TIMES]
            small = resized(truth, len(truth) // TIMES, way)
            ways = [
                np.asarray(Image.fromarray(small).resize(truth.shape[:2], each))
                for each in (Image.Resampling.BILINEAR, Image.Resampling.BICUBIC)
            ]
            ways.append(core.sharpen_image(small, core.ImageSettings(enlarge=TIMES)))
            found.append([fidelity(each, truth) for each in ways])
        each = np.array(found)
        gains.append((each[:, 2] - each[:, :2].max(axis=1)).min())
        rows.append([name, *(f"{value:.1f}" for value in each.mean(axis=0)), f"{gains[-1]:+.1f}"])
    return table(["reduced by", "linear: dB", "cubic: dB", "Enlarge: dB", "least gain: dB"], rows)


def main() -> None:
    """Print the tables, or write them into the page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--write", type=Path, help="folder of the page to write the tables into")
    options = parser.parse_args()
    page = Page(options.write and options.write / "images.md")
    page.write("pixel-art", shares())
    page.write("small-drawings", small_drawings())


if __name__ == "__main__":
    main()
