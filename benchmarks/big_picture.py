# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpen a picture that is larger than memory, from Zarr to Zarr, by two worker processes.

``python benchmarks/big_picture.py --scratch FOLDER`` makes a picture of 40,000 x 40,000 x 3 bytes
by code, sharpens it with two workers of 3 GiB each, and prints seconds, the most memory of each
worker and the chunks that ran again. A smaller picture, by one worker and by two, shows the gain
by the second worker. FOLDER needs 10 GiB.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

import common
import dask.array
import numpy as np
import zarr
from distributed import Client, LocalCluster
from report import Page, Target, table, targets
from shock_filter import core
from shock_filter.core.base import parallel
from shock_filter.core.files import images

SIDE, SMALL_SIDE = 40_000, 12_000
STORED = 1024
"""Pixels along the sides of the chunks of the Zarr array."""

WORKERS, MEMORY = 2, 3 * 2**30
SPEEDUP = 1.7


def painted(block_info: Any = None) -> np.ndarray:
    """Blurred shapes of many sizes with light grain, from places alone: (h, w, 3) uint8."""
    rows, columns = (
        np.arange(*place, dtype=np.float32) for place in block_info[None]["array-location"][:2]
    )
    y, x = rows[:, None], columns[None, :]
    waves = np.sin(x / 37 + 3 * np.sin(y / 61)) * np.sin(y / 29 + 2 * np.sin(x / 83))
    grain = np.sin(12.9898 * (x % 997) + 78.233 * (y % 991)) * np.float32(43758.5453)
    grain -= np.floor(grain)
    sharpness = 1.5 + np.sin(x / 1711) + np.sin(y / 1303)
    out = np.empty((len(rows), len(columns), 3), np.uint8)
    for c, shift in enumerate((0.0, 0.3, -0.2)):
        values = 0.5 + 0.4 * np.tanh((waves + shift) * sharpness) + 0.02 * (grain - 0.5)
        out[..., c] = np.rint(255 * values)
    return out


def make_picture(path: Path, side: int) -> None:
    """Write the picture as a Zarr array, chunk by chunk."""
    lengths = (*[STORED] * (side // STORED), *[side % STORED] * (side % STORED > 0))
    picture = dask.array.map_blocks(
        painted, chunks=(lengths, lengths, (3,)), dtype=np.uint8, meta=np.empty((0, 0, 0), np.uint8)
    )
    chunks = (STORED, STORED, 3)
    target = zarr.open_array(str(path), mode="w", shape=picture.shape, chunks=chunks, dtype="u1")
    dask.array.store(picture, target, lock=False)


def use_one_thread() -> None:
    """Have a worker's kernels run on one core, as the other ones have workers of their own."""
    parallel.most_threads = 1


def run(source: Path, target: Path, workers: int) -> dict[str, Any]:
    """Sharpen a picture by so many workers: seconds, notes, and the most bytes of each worker."""
    with (
        LocalCluster(
            n_workers=workers, threads_per_worker=1, memory_limit=MEMORY, dashboard_address=":0"
        ) as cluster,
        Client(cluster) as client,
    ):
        client.run(use_one_thread)
        warm_up = partial(core.sharpen_image, np.zeros((64, 64, 3), np.uint8))
        client.run(warm_up, core.ImageSettings(width=4.0, what="photo"))
        start = time.perf_counter()
        function = partial(core.sharpen_image, settings=core.ImageSettings())
        outcome = images.filter_image_file(function, source, target)
        seconds = time.perf_counter() - start
        peaks = list(client.run(common.peak_memory).values())
    return {"seconds": seconds, "note": outcome.notes[-1], "peaks": peaks}


def row(side: int, workers: int, found: dict[str, Any]) -> list[str]:
    """Return the row of the table for a run."""
    peaks = " and ".join(f"{each / 2**30:.2f}" for each in found["peaks"])
    speed = side * side / found["seconds"] / 1e6
    reruns = found["note"].rpartition(": ")[2]
    return [f"{side:,}²", f"{workers}", f"{found['seconds']:.0f}", f"{speed:.2f}", peaks, reruns]


def main() -> None:
    """Measure and print, or write into a page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--side", type=int, default=SIDE, help="of the picture, in pixels")
    parser.add_argument("--small-side", type=int, default=SMALL_SIDE, help="0 leaves this out")
    parser.add_argument("--scratch", type=Path, help="folder for the pictures")
    parser.add_argument("--write", type=Path, metavar="PAGE", help="put the results into this page")
    options = parser.parse_args()
    rows, bounds = [], []
    with tempfile.TemporaryDirectory(dir=options.scratch) as folder:

        def sharpened(side: int, counts: list[int]) -> list[dict[str, Any]]:
            source = Path(folder, f"{side}.zarr")
            make_picture(source, side)
            found = []
            for workers in counts:
                found.append(run(source, Path(folder, f"{side}-{workers}.zarr"), workers))
                rows.append(row(side, workers, found[-1]))
                print(" | ".join(rows[-1]), flush=True)
            return found

        if options.small_side:
            one, two = sharpened(options.small_side, [1, WORKERS])
            times = one["seconds"] / two["seconds"]
            bounds.append(
                Target("two workers, times as fast as one", times, SPEEDUP, at_least=True)
            )
        (most,) = sharpened(options.side, [WORKERS])
        bounds.append(Target("GiB of a worker", max(most["peaks"]) / 2**30, MEMORY / 2**30))
    head = ["picture", "workers", "s", "million pixels a second", "GiB of each", "runs again"]
    text = "Three channels of uint8, default settings; workers are processes with a kernel thread."
    Page(options.write).write(
        "big picture", "\n\n".join([text, table(head, rows), targets(bounds), common.machine()])
    )


if __name__ == "__main__":
    main()
