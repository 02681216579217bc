# SPDX-License-Identifier: GPL-3.0-or-later
"""How near enlarged images come to what they were before they were reduced.

Drawings, masks and gray maps are made by code, from other seeds than those that the constants were
chosen on; photos are those of `dials`.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
from dials import Bytes, drawing, fidelity, photos
from PIL import Image
from report import Page, table
from scipy import ndimage
from shock_filter import core

SEEDS = range(61, 65)
SIZE = 256
TIMES = 2, 4
LEVELS = {"masks": [0.0], "gray maps": [-0.7, 0.0, 0.8]}


def areas(seed: int, levels: list[float]) -> Bytes:
    """Areas with soft outlines, one of two or more grays each."""
    random = np.random.default_rng(seed)
    heights = ndimage.gaussian_filter(random.normal(size=(4 * SIZE, 4 * SIZE)), 40.0)
    steps = np.digitize(heights / heights.std(), levels) * (230.0 / len(levels)) + 10.0
    mean = steps.reshape(SIZE, 4, SIZE, 4).mean(axis=(1, 3))
    return np.repeat(np.rint(mean).astype(np.uint8)[..., None], 3, axis=2)


def reduced(image: Bytes, times: int) -> Bytes:
    """Take the mean of squares of pixels."""
    height, width = (length // times for length in image.shape[:2])
    mean = image.reshape(height, times, width, times, 3).mean(axis=(1, 3))
    return np.rint(mean).astype(np.uint8)


def pillow(filter_: Image.Resampling) -> Callable[[Bytes, int], Bytes]:
    """Return what Pillow does."""

    def work(image: Bytes, times: int) -> Bytes:
        size = times * image.shape[1], times * image.shape[0]
        return np.asarray(Image.fromarray(image).resize(size, filter_))

    return work


def ours(**settings: object) -> Callable[[Bytes, int], Bytes]:
    """Return what Enlarge does."""
    return lambda image, n: core.sharpen_image(image, core.ImageSettings(enlarge=n, **settings))


BICUBIC = pillow(Image.Resampling.BICUBIC)
WAYS = {
    "Lanczos": pillow(Image.Resampling.LANCZOS),
    "Enlarge, Amount 0": ours(amount=0.0),
    "Enlarge": ours(),
    "as Drawing": ours(what="drawing"),
    "as Drawing, Width 1": ours(what="drawing", width=1.0),
    "as Photo": ours(what="photo"),
}


def gains(groups: dict[str, list[Bytes]]) -> str:
    """Fidelity of the bicubic spline, and gains over it, in the mean of each group."""
    rows = []
    for group, images in groups.items():
        for times in TIMES:
            small = [reduced(image, times) for image in images]
            plain = [fidelity(BICUBIC(s, times), i) for s, i in zip(small, images, strict=True)]
            row = [group, f"x{times}", f"{np.mean(plain):.1f} dB"]
            for work in WAYS.values():
                found = [fidelity(work(s, times), i) for s, i in zip(small, images, strict=True)]
                row.append(f"{np.mean(found) - np.mean(plain):+.2f}")
            rows.append(row)
    return table(["", "", "bicubic", *(f"{way}: dB" for way in WAYS)], rows, words=2)


def main() -> None:
    """Print the table, or write it into the page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--photos", type=Path, help="folder with further photos")
    parser.add_argument("--write", type=Path, help="folder of the page to write the table into")
    options = parser.parse_args()
    groups = {
        "drawings": [drawing(seed) for seed in SEEDS],
        "drawings at contrast 0.2": [drawing(seed, 0.2) for seed in SEEDS],
        **{name: [areas(s, levels) for s in SEEDS] for name, levels in LEVELS.items()},
        "photos": list(photos(options.photos).values()),
    }
    Page(options.write and options.write / "images.md").write("enlarging", gains(groups))


if __name__ == "__main__":
    main()
