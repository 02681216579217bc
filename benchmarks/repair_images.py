# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure tileable pictures and removed blocks.

``python benchmarks/repair_images.py --data FOLDER --write docs/repair-benchmarks.md``. Blocks are
compared with OpenCV's bilateral filter and its denoising by non-local means, each at the best of
some settings for each quality in the mean; it needs opencv-python-headless.
"""

from __future__ import annotations

import argparse
import io
import time
from pathlib import Path

import numpy as np
from PIL import Image
from report import Page, table
from shock_filter import core
from shock_filter.core.repair.blocks import compression_of

Pixels = np.ndarray

QUALITIES = 30, 40, 50, 60, 70, 80
PART = 256
PHOTOS = "kodim04", "kodim05", "kodim08", "kodim13"
SET5 = "img_001", "img_002", "img_003", "img_004", "img_005"
OTHERS = "astronaut", "coffee", "chelsea"
"""From scikit-image."""


def decibels(found: Pixels, image: Pixels) -> float:
    """Peak signal to noise."""
    off = found.astype(float) - image
    return float(20 * np.log10(255) - 10 * np.log10(max(np.mean(off**2), 1e-9)))


def photos(data: Path) -> dict[str, Pixels]:
    """Parts of photos that were not compressed before."""
    import skimage

    found = {}
    paths = [(name, data / "images" / f"{name}.png") for name in PHOTOS]
    paths += [(name, data / "images" / "set5" / f"{name}_SRF_2_HR.png") for name in SET5]
    paths += [(name, Path(skimage.__file__).parent / "data" / f"{name}.png") for name in OTHERS]
    for name, path in paths:
        image = np.asarray(Image.open(path).convert("RGB"))
        top, left = ((n - PART) // 2 for n in image.shape[:2])
        part = np.ascontiguousarray(image[max(top, 0) :, max(left, 0) :][:PART, :PART])
        if compression_of(part) is None:
            found[name] = part
    return found


def compressed(image: Pixels, quality: int) -> Pixels:
    """As a JPEG file holds it."""
    file = io.BytesIO()
    Image.fromarray(image).save(file, "JPEG", quality=quality)
    return np.asarray(Image.open(file))


def blocks(data: Path) -> str:
    """Measure the gain of each method, by quality."""
    import cv2

    ways = {"Remove Blocks": core.remove_blocks}
    for h in (1, 2, 3, 5):
        ways[f"non-local means, {h}"] = lambda image, h=h: cv2.fastNlMeansDenoisingColored(
            image, None, h, h, 7, 21
        )
    for color in (4, 8, 16):
        ways[f"bilateral, {color}"] = lambda image, c=color: cv2.bilateralFilter(image, 7, c, 2)
    given = photos(data)
    gains = np.zeros((len(ways), len(QUALITIES), len(given)))
    for k, quality in enumerate(QUALITIES):
        for n, image in enumerate(given.values()):
            broken = compressed(image, quality)
            before = decibels(broken, image)
            for w, way in enumerate(ways.values()):
                gains[w, k, n] = decibels(way(broken), image) - before
    rows = []
    for title in ("Remove Blocks", "non-local means", "bilateral"):
        some = [w for w, name in enumerate(ways) if name.startswith(title)]
        best = gains[some].mean(axis=2).argmax(axis=0)
        each = np.stack([gains[some[best[k]], k] for k in range(len(QUALITIES))])
        mean = [f"{value:+.2f}" for value in each.mean(axis=1)]
        rows.append([title, *mean, f"{each.mean():+.2f}", f"{each.min():+.2f}"])
    head = ["", *(f"{quality}" for quality in QUALITIES), "mean", "least"]
    return table(head, rows) + f"\n\n{len(given)} pictures."


def tiling(data: Path) -> str:
    """Compare the joints of tileable pictures with their interior."""
    rows = []
    for name, image in photos(data).items():
        values = image.astype(np.float32)
        result = core.make_tileable(values)
        row = [name]
        for picture in (values, result):
            for order in (1, 2):
                found = []
                for axis in (0, 1):
                    lines = np.moveaxis(picture, axis, 0)
                    joint = np.diff(np.concatenate([lines[-2:], lines[:2]]), order, axis=0)
                    joint = joint[1] if order == 1 else joint
                    inside = np.quantile(np.abs(np.diff(lines, order, axis=0)), 0.95)
                    found.append(np.quantile(np.abs(joint), 0.95) / inside)
                row.append(f"{max(found):.2f}")
        third = slice(PART // 3, 2 * PART // 3)
        drift = np.abs((result - values)[third, third].mean(axis=(0, 1))).max()
        rows.append([*row, f"{drift:.2f}"])
    image = np.random.default_rng(0).integers(0, 256, (1024, 1024, 3)).astype(np.uint8)
    times = []
    for _ in range(3):
        begin = time.perf_counter()
        core.make_tileable(image)
        times.append(time.perf_counter() - begin)
    head = ["", "steps before", "slopes before", "steps", "slopes", "drift of 255"]
    return table(head, rows) + f"\n\n1024 x 1024 pixels in {min(times):.2f} s."


def main() -> None:
    """Print the tables, or write them into a page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--write", type=Path, help="Markdown page to write the tables into")
    options = parser.parse_args()
    page = Page(options.write)
    for title, measure in (("tiling", tiling), ("blocks", blocks)):
        text = measure(options.data)
        print(text, flush=True)
        page.write(title, text)


if __name__ == "__main__":
    main()
