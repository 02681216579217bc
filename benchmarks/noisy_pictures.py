# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors of denoised pictures: *Denoise Image*, *Sharpen Image*, OpenCV.

``python benchmarks/noisy_pictures.py --write docs``. Pictures are those of `image_sharpening`. How
noise is measured was chosen by looking at some of them, how it is counted on made pictures only.
OpenCV's non-local means has the best of seven strengths for each picture, by an oracle.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from image_sharpening import as_bytes, fidelity, jpeg, noise, pictures
from report import Page, table
from scipy import ndimage
from shock_filter import core

NOISES = 3, 8, 15, 25
STRENGTHS = 0.3, 0.5, 0.7, 0.85, 1.0, 1.2, 1.5
LIMIT = 60.0  # decibels of pictures that are the same

Denoiser = Callable[[np.ndarray, np.ndarray, float], np.ndarray]


def soft(image: np.ndarray, sigma: float, name: str) -> np.ndarray:
    """Add noise that was blurred."""
    white = noise(np.zeros(image.shape), 1.0, name)
    blurred = ndimage.gaussian_filter(white, (0.6, 0.6, *(0,) * (image.ndim - 2)))
    return image + sigma * blurred / blurred.std()


def means(given: np.ndarray, truth: np.ndarray, sigma: float) -> np.ndarray:
    """Apply OpenCV's non-local means at its best strength."""
    results = []
    for strength in STRENGTHS:
        h = strength * max(sigma, 1.0)
        if given.ndim == 2:
            results.append(cv2.fastNlMeansDenoising(given, None, h, 7, 21))
        else:
            results.append(cv2.fastNlMeansDenoisingColored(given, None, h, h, 7, 21))
    return max(results, key=lambda result: fidelity(result, truth))


WAYS: dict[str, Denoiser] = {
    "Denoise Image": lambda given, truth, sigma: core.beltrami_image(given),
    "Keep Edges 7": lambda given, truth, sigma: core.beltrami_image(
        given, core.BeltramiSettings(beta=7.0)
    ),
    "Sharpen Image": lambda given, truth, sigma: core.sharpen_image(given),
    "non-local means": means,
}


def spoilings() -> dict[str, tuple[float, Callable[[np.ndarray, str], np.ndarray]]]:
    """List the degradations of the pictures, with the strength of their noise."""

    def white(sigma: float) -> Callable[[np.ndarray, str], np.ndarray]:
        return lambda image, name: noise(image, sigma, name)

    found = {f"noise {sigma}": (float(sigma), white(sigma)) for sigma in NOISES}
    found["soft noise 8"] = (8.0, lambda image, name: soft(image, 8.0, name))
    found["JPEG 50"] = (0.0, lambda image, name: jpeg(image, 50))
    return found


def rows_of(kind: str, group: dict[str, np.ndarray]) -> list[list[str]]:
    """Mean and least gain of each noise, and how much clean pictures change."""
    few = ["Denoise Image", "Keep Edges 7", "Sharpen Image"]
    kept = [
        [min(fidelity(WAYS[way](truth, truth, 0.0), truth), LIMIT) for truth in group.values()]
        for way in few
    ]
    cells = [f"{np.mean(each):.1f} ({min(each):.1f})" for each in kept]
    rows = [[kind, "none: dB to the input", *cells, ""]]
    for title, (sigma, spoil) in spoilings().items():
        gains: list[list[float]] = [[] for _ in WAYS]
        for name, truth in group.items():
            given = as_bytes(spoil(truth, name))
            before = fidelity(given, truth)
            for found, work in zip(gains, WAYS.values(), strict=True):
                found.append(fidelity(work(given, truth, sigma), truth) - before)
        rows.append([kind, title, *(f"{np.mean(g):+.2f} ({min(g):+.2f})" for g in gains)])
        print(*rows[-1], flush=True)
    return rows


def main() -> None:
    """Print the table, or write it into the page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--write", type=Path, help="folder of the page to write the table into")
    options = parser.parse_args()
    page = Page(options.write and options.write / "denoise-benchmarks.md")
    rows = [row for kind, group in pictures(None).items() for row in rows_of(kind, group)]
    page.write("noisy-pictures", table(["", "noise", *WAYS], rows, words=2))


if __name__ == "__main__":
    main()
