# SPDX-License-Identifier: GPL-3.0-or-later
"""Train the networks that enlarge images.

``python tools/training/train_enlarging.py`` makes pictures from seeds, reduces them, trains to
enlarge them, and writes ``core/color/learned/enlarging.npz``. It needs Pillow and scipy, and about
a quarter of an hour on two cores.
"""

from __future__ import annotations

import argparse
import os
import time
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the same sums on any machine

import adam
import numpy as np
from enlarging_examples import reduced
from image_examples import truth
from scripts import meaning_of
from shock_filter.core.color.learned.enlarging import (
    DEFINITION,
    FACTORS,
    OFFSETS,
    VIEWS,
    WEIGHTS,
    cubic,
    name_of,
    told_farther,
    told_of,
    turned_offsets,
    turned_places,
)
from shock_filter.core.color.learned.planes import NONE, Planes
from shock_filter.core.mixture.network import Network, save
from train_images import FLOOR, gathered, joined

HERE = Path(__file__).resolve().parent

MADE_OF = (
    "adam.py",
    "enlarging_examples.py",
    "image_examples.py",
    "train_enlarging.py",
    "train_images.py",
)
"""The scripts that the networks depend on."""

VERSION = 1
"""Number of shipped trainings."""

SEEDS = range(60000, 61300)

COPIES = 2
"""Number of copies of each picture and factor, reduced in different ways."""

PIXELS = 360
"""Number of pixels sampled from each reduced picture."""

ANYWHERE = 0.35
"""Share of them that is sampled uniformly; others are sampled by the squared error of the cubic
interpolation."""

HIDDEN = 40, 24
"""Sizes of the hidden layers."""

EPOCHS = 12

WORSE = 2.0
"""Factor of the weight of pictures whose error is larger than that of the cubic interpolation."""

KEPT_ASIDE = 16
"""One picture in this many is for validation, not for training."""


def table(seed: int) -> dict[int, list[dict[str, np.ndarray]]]:
    """Compute the training data of a picture, by factor."""
    image = truth(np.random.default_rng(seed))
    aside = seed % KEPT_ASIDE == 0
    return {times: _rows(image, times, np.random.default_rng([seed, times]), aside)
            for times in FACTORS}  # fmt: skip


def _rows(image, times, random, aside) -> list[dict[str, np.ndarray]]:
    size = len(image) // times * times
    image = image[:size, :size]
    found = []
    for _ in range(COPIES):
        small, channel = reduced(random, image, times), random.integers(3)
        found.append(_pixels(image[..., channel], small[..., channel], times, random, aside))
    return found


def _pixels(wanted, small, times, random, aside) -> dict[str, np.ndarray]:
    # Samples pixels of a channel: their features, the error of the cubic interpolation, weights.
    planes = Planes(small[None].astype(np.float32), NONE)
    height, width = small.shape
    around = told_farther(planes, 0, height)[0]
    told, mean, contrast = told_of(planes, 0, 0, height, around)
    base = mean + contrast * cubic(times).of_columns(told[: len(OFFSETS)])
    wanted = wanted.astype(np.float32)
    places = wanted.reshape(height, times, width, times).transpose(1, 3, 0, 2)
    missing = places.reshape(times * times, -1) - base
    energy = (missing**2).sum(0, dtype=np.float64)
    count = len(energy)
    share = np.full(count, 1 / count)
    if energy.sum() > 0:
        share = ANYWHERE * share + (1 - ANYWHERE) * energy / energy.sum()
    rows = random.choice(count, PIXELS, p=share / share.sum())
    sign = random.choice(np.float32([-1, 1]), PIXELS)  # a negative must give the negative result
    told = told[:, rows]
    told[: len(OFFSETS)] *= sign
    return {
        "told": told.T, "missing": (missing[:, rows] * sign).T,
        "contrast": contrast[rows], "weights": (1 / (share[rows] * count)).astype(np.float32),
        "error": np.array([(missing**2).mean()]), "aside": np.array([aside]),
    }  # fmt: skip


class Turned:
    """Rows of features; reading a row gives it in all rotations and reflections."""

    def __init__(self, told: np.ndarray) -> None:
        self._told = told
        self._views = turned_offsets()
        self.shape = told.shape

    def __len__(self) -> int:
        return len(self._told)

    def __getitem__(self, rows: np.ndarray) -> np.ndarray:
        told = self._told[rows]
        views = np.empty((VIEWS, *told.shape), np.float32)
        for view, offsets in zip(views, self._views, strict=True):
            view[:, offsets] = told
        return views.reshape(-1, told.shape[1])

    def mean(self, axis: int) -> np.ndarray:
        """Return the mean of the features."""
        return self._told.mean(axis)

    def std(self, axis: int) -> np.ndarray:
        """Return the standard deviation of the features."""
        return self._told.std(axis)


class PictureLoss:
    """A loss with the gradient of the mean logarithm of the pictures' errors.

    The weight of a picture is 1 / its error, as measured in the epoch before.
    """

    def __init__(self, rows: dict[str, np.ndarray]) -> None:
        self._rows = rows
        self._pictures = len(rows["error"])
        self._owner = np.arange(len(rows["told"])) // PIXELS
        self._batches = len(rows["told"]) // adam.BATCH
        self._places = turned_places(round(rows["missing"].shape[1] ** 0.5))
        self._count = 0
        self._sums = np.zeros((2, self._pictures))
        self._factor = (1 / (rows["error"] + FLOOR)).astype(np.float32)

    def __call__(self, given: np.ndarray, rows: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the loss of some pixels, and its gradient for the output of the network."""
        kept, owner = self._rows, self._owner[rows]
        found, contrast = self.mean_of(given), kept["contrast"][rows, None]
        gap = contrast * found - kept["missing"][rows]
        squares, weights = (gap**2).mean(1), kept["weights"][rows]
        self._sums[0] += np.bincount(owner, squares * weights, self._pictures)
        self._sums[1] += np.bincount(owner, weights, self._pictures)
        factor = weights * self._factor[owner]
        self._count += 1
        if self._count % self._batches == 0:
            errors = self._sums[0] / np.maximum(self._sums[1], 1e-9)
            counted = np.where(errors > self._rows["error"], WORSE, 1.0)
            self._factor = (counted / (errors + FLOOR)).astype(np.float32)
            self._sums[:] = 0
        slopes = (2 / gap.shape[1]) * contrast * gap * factor[:, None] / (VIEWS * len(rows))
        back = np.empty((VIEWS, *gap.shape), np.float32)
        for view, places in zip(back, self._places, strict=True):
            view[:, places] = slopes
        return float((squares * factor).sum()), back.reshape(-1, gap.shape[1])

    def mean_of(self, given: np.ndarray) -> np.ndarray:
        """Average the outputs for all rotations and reflections, each turned back."""
        views = given.reshape(VIEWS, -1, given.shape[1])
        return sum(view[:, at] for view, at in zip(views, self._places, strict=True)) / VIEWS


def gains(network: Network, rows: dict[str, np.ndarray]) -> np.ndarray:
    """Estimate the gain of each picture over cubic interpolation, in decibels, from its pixels."""
    count = len(rows["told"])
    given = network.scores(Turned(rows["told"])[np.arange(count)])
    gap = rows["contrast"][:, None] * PictureLoss(rows).mean_of(given) - rows["missing"]
    owner, weights = np.arange(count) // PIXELS, rows["weights"]
    errors = np.bincount(owner, (gap**2).mean(1) * weights) / np.bincount(owner, weights)
    return 10 * np.log10((rows["error"] + FLOOR) / (errors + FLOOR))


def train(
    tables: list[dict[str, np.ndarray]], times: int, epochs: int = EPOCHS, hidden=HIDDEN, log=print
) -> Network:
    """Train the network of a factor, and log the gain on validation pictures."""
    learned, aside = (
        joined([part for part in tables if part["aside"][0] == kept]) for kept in (False, True)
    )
    log(f"x{times}: {learned['told'].shape} rows")
    sizes = (*hidden, times * times)
    network = adam._trained(
        Turned(learned["told"]), PictureLoss(learned), sizes, epochs, times, log
    )
    gain = gains(network, aside)
    log(f"x{times}: mean gain {gain.mean():.3f} dB; worse by .2: {(gain < -0.2).mean():.3f}")
    return replace(network, definition=DEFINITION, made_of=made_of(), version=VERSION)


def made_of() -> str:
    """Return the digest of the scripts that the networks depend on."""
    return meaning_of(HERE / name for name in MADE_OF)


def main() -> None:
    """Make pictures, train, and write the networks."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, default=WEIGHTS)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--share", type=float, default=1.0, help="of all that is made, to try out")
    options = parser.parse_args()
    begin = time.time()
    log = lambda text: print(f"{time.time() - begin:6.0f} s  {text}", flush=True)  # noqa: E731
    seeds = SEEDS[: max(int(options.share * len(SEEDS)), KEPT_ASIDE)]
    tables = gathered(table, list(seeds), options.processes)
    log(f"{len(tables)} pictures")
    found = {}
    for times in FACTORS:
        parts = [part for each in tables for part in each.pop(times)]
        found[name_of(times)] = train(parts, times, log=log)
    save(options.out, found)
    log(f"written: {options.out}")


if __name__ == "__main__":
    main()
