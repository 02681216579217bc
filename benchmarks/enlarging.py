# SPDX-License-Identifier: GPL-3.0-or-later
"""How close enlarged images come to the originals before reduction.

Drawings, masks and gray maps are made by code, from other seeds than those that the constants were
chosen on; photos are those of `dials`. Further pictures are those of `image_sharpening`, reduced in
several ways. With ``--data``, a folder with ``images/set5``, the tables of papers are met, too:
``img_001_SRF_2_LR.png`` and so on, as they are handed on with Huang, Singh, Ahuja (2015).
None of these is used for training.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
from dials import Bytes, drawing, fidelity, photos
from image_sharpening import pictures
from PIL import Image
from report import Page, table
from scipy import ndimage
from shock_filter import core

SEEDS = range(61, 65)
SIZE = 256
TIMES = 2, 4
REDUCED = {
    "bicubic": Image.Resampling.BICUBIC,
    "Lanczos": Image.Resampling.LANCZOS,
    "mean": Image.Resampling.BOX,
}
"""How pictures are reduced, without aliases."""

SET5 = "baby", "bird", "butterfly", "head", "woman"
PUBLISHED = {"x2": 36.5, "x3": 32.6, "x4": 30.3}
"""PSNR of SelfExSR on Set5 (Huang, Singh, Ahuja 2015)."""

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
    """Enlarge with Pillow."""

    def work(image: Bytes, times: int) -> Bytes:
        size = times * image.shape[1], times * image.shape[0]
        return np.asarray(Image.fromarray(image).resize(size, filter_))

    return work


def ours(**settings: object) -> Callable[[Bytes, int], Bytes]:
    """Enlarge with the core."""
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


BY_WIDTH = {"as Drawing": WAYS["as Drawing"], "as Photo": WAYS["as Photo"]}


def of_reduced() -> str:
    """Gains over the bicubic spline on pictures that were reduced in several ways."""
    rows, learned = [], []
    for kind, group in pictures(None).items():
        for times in (2, 3):
            for name, way in REDUCED.items():
                found = np.array([_gains(image, times, way) for image in group.values()])
                learned += list(found[:, 1])
                rows.append([kind, f"x{times}", name, f"{found[:, 0].mean():.1f} dB",
                             *(f"{g:+.2f}" for g in found[:, 1:].mean(axis=0)),
                             f"{found[:, 1].min():+.2f}"])  # fmt: skip
    worse = sum(g < -0.2 for g in learned)
    head = [
        "",
        "",
        "reduced by",
        "bicubic",
        "Enlarge: dB",
        *(f"{w}: dB" for w in BY_WIDTH),
        "least",
    ]
    return table(head, rows, words=3) + (
        f"\n\nOver all {len(learned)} cases, Enlarge gains {np.mean(learned):.2f} dB in the mean;"
        f" {worse} come out more than 0.2 dB below the bicubic spline."
    )


def _gains(image: Bytes, times: int, way: Image.Resampling) -> list[float]:
    # Fidelity of the bicubic spline, and gains of others over it.
    height, width = (length // times * times for length in image.shape[:2])
    truth = np.ascontiguousarray(image[:height, :width])
    size = width // times, height // times
    small = np.asarray(Image.fromarray(truth).resize(size, way))
    plain = fidelity(BICUBIC(small, times), truth)
    works = [WAYS["Enlarge"], *BY_WIDTH.values()]
    return [plain, *(fidelity(work(small, times), truth) - plain for work in works)]


def brightness(pixels: Bytes) -> npt.NDArray[np.float64]:
    """Y of BT.601, from 16 to 235, of which papers tell the PSNR."""
    return 16.0 + pixels @ np.array([65.481, 128.553, 24.966]) / 255.0


def published(folder: Path) -> str:
    """PSNR of Y on Set5 in papers' way: without as many pixels at the rim as one becomes."""
    works = {"bicubic": BICUBIC, "Lanczos": WAYS["Lanczos"], **BY_WIDTH, "Enlarge": WAYS["Enlarge"]}
    rows = []
    for times in (2, 3, 4):
        found = []
        for number in range(1, len(SET5) + 1):
            truth, small = (
                np.asarray(Image.open(folder / f"img_{number:03}_SRF_{times}_{which}.png")
                           .convert("RGB"))
                for which in ("HR", "LR")
            )  # fmt: skip
            found.append([_of_brightness(w(small, times), truth, times) for w in works.values()])
        mean = np.mean(found, axis=0)
        rows.append([f"x{times}", *(f"{value:.2f}" for value in mean),
                     f"{PUBLISHED[f'x{times}']:.1f}",
                     ", ".join(f"{name} {each[-1]:.1f}" for name, each in
                               zip(SET5, found, strict=True))])  # fmt: skip
    return table(["", *works, "SelfExSR (2015)", "Enlarge, each"], rows)


def _of_brightness(image: Bytes, truth: Bytes, rim: int) -> float:
    off = (brightness(image) - brightness(truth))[rim:-rim, rim:-rim]
    return float(10 * np.log10(255.0**2 / (off**2).mean()))


def main() -> None:
    """Print the table, or write it into the page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--photos", type=Path, help="folder with further photos")
    parser.add_argument("--data", type=Path, help="folder with images/set5")
    parser.add_argument("--write", type=Path, help="folder of the page to write the table into")
    options = parser.parse_args()
    groups = {
        "drawings": [drawing(seed) for seed in SEEDS],
        "drawings at contrast 0.2": [drawing(seed, 0.2) for seed in SEEDS],
        **{name: [areas(s, levels) for s in SEEDS] for name, levels in LEVELS.items()},
        "photos": list(photos(options.photos).values()),
    }
    page = Page(options.write and options.write / "images.md")
    page.write("enlarging", gains(groups))
    page.write("enlarging-reduced", of_reduced())
    if options.data:
        page.write("enlarging-published", published(options.data / "images" / "set5"))


if __name__ == "__main__":
    main()
