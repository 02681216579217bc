# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpening of pictures from other sources, none of which was used for training or tuning.

``python benchmarks/image_others.py FOLDER``. Each folder in it holds pictures, at any depth; some
of each, chosen by a fixed seed, are spoiled in eight ways. Large photos are reduced before.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

import image_sharpening as own
import numpy as np
from image_sharpening import BOX, CUBIC, LANCZOS, as_bytes, best_unsharp, fidelity
from PIL import Image
from report import Page, table
from shock_filter import core
from shock_filter.core.settings import WIDTH_OF_SIGMA

ENDINGS = ".png", ".jpg", ".jpeg"
PICTURES = 16
"""Of each folder."""

SMALLEST, LARGEST = 160, 512
"""Of the shorter side; larger pictures are reduced to between this and twice of it."""

FAINT = 4.0
"""Standard deviation, in bytes, below which a picture shows nothing."""

SIGMAS = {f"Gauss {sigma}": sigma for sigma in (0.8, 1.5, 2.5)}
"""Sigmas of the blurs for which *Width* can be given."""

SPOILINGS = {
    **{name: lambda i, n, sigma=sigma: own.blur(i, sigma) for name, sigma in SIGMAS.items()},
    "disk 2": lambda i, n: own.convolved(i, own.disk(2.0)),
    "Gauss 0.8, JPEG 60": lambda i, n: own.jpeg(own.blur(i, 0.8), 60),
    "Gauss 1.2, noise 5": lambda i, n: own.noise(own.blur(i, 1.2), 5.0, n),
    "x2, cubic": lambda i, n: own.scaled(i, 2, BOX, CUBIC),
    "x2, Lanczos": lambda i, n: own.scaled(i, 2, LANCZOS, LANCZOS),
}  # fmt: skip


class Case(NamedTuple):
    """A spoiled picture: where it is from, PSNR before, after, and of the best unsharp mask.

    `told` is the PSNR if the blur's width is given; not a number where there is none to give.
    """

    folder: str
    spoiling: str
    given: float
    ours: float
    unsharp: float
    told: float


def chosen(folder: Path) -> dict[str, np.ndarray]:
    """Choose some pictures, and cut out their middles."""
    paths = sorted(path for path in folder.rglob("*") if path.suffix.lower() in ENDINGS)
    np.random.default_rng(1).shuffle(paths)
    found: dict[str, np.ndarray] = {}
    for path in paths:
        try:
            pixels = own.loaded(path)
        except (OSError, ValueError, Image.DecompressionBombError):
            continue
        side = min(pixels.shape[:2])
        if side >= 2 * LARGEST:
            pixels = np.asarray(Image.fromarray(pixels).reduce(side // LARGEST))
        pixels = own.middle(pixels)
        if min(pixels.shape[:2]) >= SMALLEST and pixels.std() >= FAINT:
            found[str(path.relative_to(folder))] = pixels
        if len(found) == PICTURES:
            break
    return found


def tables(folder: Path) -> str:
    """Gains by folder and by degradation."""
    found, sharp = [], {}
    for place in sorted(path for path in folder.iterdir() if path.is_dir()):
        pictures = chosen(place)
        sharp[place.name] = {
            name: fidelity(core.sharpen_image(truth), truth) for name, truth in pictures.items()
        }
        for name, truth in pictures.items():
            for spoiling, spoil in SPOILINGS.items():
                given = as_bytes(spoil(truth, name + spoiling))
                found.append(Case(
                    place.name, spoiling, fidelity(given, truth),
                    fidelity(core.sharpen_image(given), truth),
                    fidelity(best_unsharp(given, truth), truth),
                    _if_told(given, truth, SIGMAS.get(spoiling)),
                ))  # fmt: skip
    rows = []
    for name, kept in sharp.items():
        some = [case for case in found if case.folder == name]
        least = min(kept.values())
        rows.append([name, str(len(kept)), *_numbers(some), f"{least:.1f}"])
    rows.append(["all", str(sum(map(len, sharp.values()))), *_numbers(found), ""])
    heads = ["gain", "best mask", "at or above", "worse by 0.1", "by 0.5"]
    by_spoiling = []
    for name in SPOILINGS:
        some = [case for case in found if case.spoiling == name]
        by_spoiling.append([name, *_numbers(some), *_numbers_if_told(some)])
    changed = sorted((kept, name) for each in sharp.values() for name, kept in each.items())
    return "\n\n".join([
        table(["from", "pictures", *heads, "sharp, at least"], rows),
        table(["spoiled by", *heads, "Width given: gain", "Width given: at or above"], by_spoiling),
        "Sharp ones that change most: "
        + ", ".join(f"{Path(name).name} ({kept:.1f} dB)" for kept, name in changed[:6]) + ".",
    ])  # fmt: skip


def _numbers(cases: list[Case]) -> list[str]:
    gain = np.array([case.ours - case.given for case in cases])
    mask = np.array([case.unsharp - case.given for case in cases])
    return [f"{gain.mean():+.2f}", f"{mask.mean():+.2f}", f"{100 * (gain >= mask).mean():.0f} %",
            f"{(gain < -0.1).sum()}", f"{(gain < -0.5).sum()}"]  # fmt: skip


def _if_told(given: np.ndarray, truth: np.ndarray, sigma: float | None) -> float:
    if sigma is None:
        return np.nan
    settings = core.ImageSettings(width=sigma * WIDTH_OF_SIGMA)
    return fidelity(core.sharpen_image(given, settings), truth)


def _numbers_if_told(cases: list[Case]) -> list[str]:
    told = np.array([case.told for case in cases])
    if np.isnan(told).any():
        return ["", ""]
    given, mask = np.array([(case.given, case.unsharp) for case in cases]).T
    return [f"{(told - given).mean():+.2f}", f"{100 * (told >= mask).mean():.0f} %"]


def main() -> None:
    """Print the tables, or write them into the page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="with a folder of pictures of each maker")
    parser.add_argument("--write", type=Path, help="folder of the page to write the tables into")
    options = parser.parse_args()
    page = Page(options.write and options.write / "benchmarks.md")
    page.write("image-others", tables(options.folder))


if __name__ == "__main__":
    main()
