# SPDX-License-Identifier: GPL-3.0-or-later
"""Train the networks that mix differences of smoothed images for sharpening.

``python tools/training/train_images.py`` makes pictures from seeds, trains on them, and writes
``core/color/learned/images.npz``. It needs Pillow and scipy, and about half an hour on two
cores. Pictures are stored in the folder, so that a stopped run can continue.
"""

from __future__ import annotations

import argparse
import os
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the same sums on any machine

import adam
import numpy as np
from image_spoiling import PATTERNED, PLAINLY, SOFTLY, WIDELY, example, told
from scripts import meaning_of
from shock_filter.core.base import parallel
from shock_filter.core.color.learned.first import First
from shock_filter.core.color.learned.images import measured_detail
from shock_filter.core.color.learned.planes import Planes
from shock_filter.core.color.learned.recipe import (
    DEFINITION,
    FAINT,
    STAGES,
    WEIGHTS,
    Wishes,
    mixed,
    second_of,
)
from shock_filter.core.color.learned.surroundings import WIDEST
from shock_filter.core.grid.channels import Channels
from shock_filter.core.mixture.network import Network, save

HERE = Path(__file__).resolve().parent

MADE_OF = ("adam.py", "image_examples.py", "image_patterns.py", "image_spoiling.py",
           "train_images.py")  # fmt: skip
"""The scripts that the networks depend on."""

VERSION = 5
"""Number of shipped trainings."""

COUNTS = {10000: 5600, WIDELY: 520, SOFTLY: 300, PLAINLY: 960, PATTERNED: 360}
"""Number of seeds from each first seed on."""

PIXELS = 400
"""Number of pixels sampled from each degraded picture."""

ANYWHERE = 0.35
"""Share of them that is sampled uniformly; others are sampled where candidates differ and the
picture has errors."""

HIDDEN = 80, 48
"""Sizes of the hidden layers."""

EPOCHS = 18
KEPT_ASIDE = 16
"""One picture in this many is for validation, not for training."""

FLOOR = 0.8**2
"""Squared error, in 8-bit levels, that counts as none in pictures that are not degraded."""

LEAST = 0.5**2
"""The same for degraded pictures; less, because in plain ones few pixels have errors."""

AS_IT_WAS = 2.0, 1.4
"""Factor of the weight of pictures that are not degraded, for each network."""

HELD = 1e-4
"""Weight of the L2 penalty on mixture weights."""

COLORS = Channels(0, 3, -1, np.empty(0, np.float32))


def made(seed: int, folder: Path) -> Path:
    """Make a picture and its degraded copies, unless they are in the folder already."""
    path = folder / f"image_{seed}.npz"
    if not path.exists():
        truth, copies = example(seed)
        random = np.random.default_rng([seed, 3])
        squares, truths = zip(
            *(told(random, truth, copy, WIDEST**2) for copy in copies), strict=True
        )
        part = path.with_suffix(".part")
        with part.open("wb") as file:
            np.savez(file, truth=truths, given=[copy.given for copy in copies],
                     same=[copy.same for copy in copies], square=squares)  # fmt: skip
        part.rename(path)
    return path


def table(path: Path, networks: list[Network]) -> list[dict[str, np.ndarray]]:
    """Compute the training data of a picture for the network after `networks`."""
    seed = int(path.stem.rpartition("_")[2])
    random = np.random.default_rng([seed, len(networks)])
    with np.load(path) as data:
        keys = "truth", "given", "same", "square"
        copies = list(zip(*(data[key] for key in keys), strict=True))
    found = []
    for truth, image, same, square in copies:
        truth = np.moveaxis(truth.astype(np.float32), 2, 0)
        planes = Planes.of(image, COLORS)
        wishes = Wishes(FAINT * measured_detail(image, COLORS), float(square))
        stage = first = First(planes, wishes.floor, wishes.square)
        if networks:
            values, shares = mixed(first, networks[0])
            result = planes.with_values(values)
            stage = second_of(first, result, shares, COLORS.brightness, wishes)
        error = float(((truth - planes.values) ** 2).mean())
        found.append({
            **pixels_of(stage, truth, random), "error": np.array([error]),
            "same": np.array([same]), "aside": np.array([seed % KEPT_ASIDE == 0]),
        })  # fmt: skip
    return found


def pixels_of(stage, truth: np.ndarray, random: np.random.Generator) -> dict[str, np.ndarray]:
    """Sample training data of pixels: features, differences of smoothings, errors, weights."""
    c, height, _ = stage.base.shape
    strip = stage.strip(0, height)
    differences, told = strip.rows(0, height)
    differences = differences.reshape(len(differences), c, -1)
    told = told.reshape(len(told), -1)
    _, low, high = strip.limits
    missing, low, high = (
        (wanted - stage.base).reshape(c, -1) for wanted in (truth, low, high)
    )  # fmt: skip
    energy = (differences**2).sum((0, 1), dtype=np.float64) + (missing**2).sum(0)
    count = len(energy)
    share = np.full(count, 1 / count)
    if energy.sum() > 0:
        share = ANYWHERE * share + (1 - ANYWHERE) * energy / energy.sum()
    rows = random.choice(count, PIXELS, p=share / share.sum())
    return {
        "told": told[:, rows].T, "differences": differences[:, :, rows].transpose(2, 0, 1),
        "missing": missing[:, rows].T, "low": low[:, rows].T, "high": high[:, rows].T,
        "weights": (1 / (share[rows] * count)).astype(np.float32),
    }  # fmt: skip


class PictureLoss:
    """A loss with the gradient of the mean logarithm of the pictures' errors.

    The weight of a picture is 1 / its error, as measured in the epoch before.

    Parameters
    ----------
    rows : dict
        As from `joined`; pixels are in the order of the pictures.
    least : float
        Squared error that counts as none in degraded pictures.
    same : float
        Factor of the weight of pictures that are not degraded.
    """

    def __init__(
        self, rows: dict[str, np.ndarray], least: float = FLOOR, same: float = 1.6
    ) -> None:
        self._rows, self._least, self._same = rows, least, same
        self._pictures = len(rows["error"])
        self._owner = owners_of(rows)
        self._batches = len(rows["told"]) // adam.BATCH
        self._count = 0
        self._sums = np.zeros((2, self._pictures))
        self._follow(rows["error"])

    def _follow(self, errors: np.ndarray) -> None:
        counted = np.where(self._rows["same"], self._same, 1.0)
        floor = np.where(self._rows["same"], FLOOR, self._least)
        self._factor = (counted / (errors + floor)).astype(np.float32)

    def __call__(self, shares: np.ndarray, rows: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the loss of some pixels, and its gradient for their mixture weights."""
        kept, owner = self._rows, self._owner[rows]
        squares, slopes = slopes_of(shares, kept, rows)
        weights = kept["weights"][rows]
        self._sums[0] += np.bincount(owner, squares * weights, self._pictures)
        self._sums[1] += np.bincount(owner, weights, self._pictures)
        factor = weights * self._factor[owner]
        self._count += 1
        if self._count % self._batches == 0:
            self._follow(self._sums[0] / np.maximum(self._sums[1], 1e-9))
            self._sums[:] = 0
        loss = float((squares * factor).sum())
        return loss, (slopes * factor[:, None] + HELD * shares) / len(rows)


def owners_of(rows: dict[str, np.ndarray]) -> np.ndarray:
    """Return for each pixel the index of its picture; all have the same number of pixels."""
    return np.repeat(np.arange(len(rows["error"])), len(rows["told"]) // len(rows["error"]))


def slopes_of(shares, kept, rows) -> tuple[np.ndarray, np.ndarray]:
    """Return the squared errors of some pixels, and their gradients for the mixture weights."""
    d, low, high = kept["differences"][rows], kept["low"][rows], kept["high"][rows]
    change = np.einsum("nk,nkc->nc", shares, d)
    free = (change > low) & (change < high)
    gap = np.clip(change, low, high) - kept["missing"][rows]
    slopes = (2 / gap.shape[1]) * np.einsum("nc,nkc->nk", gap * free, d)
    return (gap**2).mean(1), slopes


def gains(network: Network, rows: dict[str, np.ndarray]) -> np.ndarray:
    """Estimate the gain of each picture from its sampled pixels, in decibels."""
    squares, _ = slopes_of(network.scores(rows["told"]), rows, slice(None))
    owner, weights = owners_of(rows), rows["weights"]
    errors = np.bincount(owner, squares * weights) / np.bincount(owner, weights)
    return 10 * np.log10((rows["error"] + FLOOR) / (errors + FLOOR))


def gathered(function, jobs: list, processes: int) -> list:
    """Call a function for each job, in parallel processes if there are several."""
    if processes == 1:
        return [function(job) for job in jobs]
    with ProcessPoolExecutor(processes, initializer=_alone) as pool:
        return list(pool.map(function, jobs, chunksize=8))


def _alone() -> None:
    parallel.most_threads = 1  # other cores run other processes


def make_all(counts: dict[int, int], folder: Path, processes: int) -> list[Path]:
    """Make a number of pictures from each first seed on."""
    folder.mkdir(parents=True, exist_ok=True)
    seeds = [first + i for first, count in counts.items() for i in range(count)]
    return gathered(partial(made, folder=folder), seeds, processes)


def train(
    paths: list[Path], processes: int = 1, epochs: int = EPOCHS, hidden=HIDDEN, log=print
) -> dict[str, Network]:
    """Train the stages in turn, and log the gain on validation pictures."""
    networks: list[Network] = []
    for stage, name in enumerate(STAGES):
        tables = gathered(partial(table, networks=networks), paths, processes)
        each = [part for found in tables for part in found]
        learned, aside = (
            joined([part for part in each if part["aside"][0] == kept]) for kept in (False, True)
        )
        del tables, each
        log(f"{name}: {learned['told'].shape} rows")
        sizes = (*hidden, learned["differences"].shape[1])
        loss = PictureLoss(learned, LEAST, AS_IT_WAS[stage])
        network = adam._trained(learned["told"], loss, sizes, epochs, stage, log)
        gain = gains(network, aside)
        same = aside["same"]
        log(
            f"{name}: mean gain {gain[~same].mean():.3f} dB, of sharp ones {gain[same].mean():.3f};"
            f" worse by .1: {(gain < -0.1).mean():.3f}, by .5: {(gain < -0.5).mean():.3f}"
        )
        facts = {"definition": DEFINITION, "made_of": made_of(), "version": VERSION}
        networks.append(replace(network, **facts))
    return dict(zip(STAGES, networks, strict=True))


def joined(parts: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Concatenate the tables of pictures."""
    return {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}


def made_of() -> str:
    """Return the digest of the scripts that the networks depend on."""
    return meaning_of(HERE / name for name in MADE_OF)


def main() -> None:
    """Make pictures, train, and write the networks."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--folder", type=Path, default=HERE / ".made", help="for made pictures")
    parser.add_argument("--out", type=Path, default=WEIGHTS)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--share", type=float, default=1.0, help="of all that is made, to try out")
    options = parser.parse_args()
    begin = time.time()
    log = lambda text: print(f"{time.time() - begin:6.0f} s  {text}", flush=True)  # noqa: E731
    counts = {first: max(int(options.share * count), 1) for first, count in COUNTS.items()}
    paths = make_all(counts, options.folder, options.processes)
    log(f"{len(paths)} pictures")
    save(options.out, train(paths, options.processes, log=log))
    log(f"written: {options.out}")


if __name__ == "__main__":
    main()
