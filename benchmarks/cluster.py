# SPDX-License-Identifier: GPL-3.0-or-later
"""How much faster two workers of a Dask cluster are than one.

``python benchmarks/cluster.py --write docs/scale.md`` starts schedulers and workers, of one thread
each, on this machine. At least two cores must be free.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import common
import numpy as np
from distributed import Client
from PIL import Image
from report import Page, Target, table, targets
from shock_filter.core import cli

FILES, DAMAGED, SIDE = 500, 5, 768
ROUNDS = 2
LEAST = 1.7


@contextlib.contextmanager
def started(program: str, *words: str) -> Iterator[None]:
    """Run one of Dask's programs in another process."""
    code = f"from distributed.cli.dask_{program} import main; main()"
    process = subprocess.Popen(
        [sys.executable, "-c", code, *words, "--no-dashboard"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        stderr=subprocess.DEVNULL,
    )
    try:
        yield
    finally:
        process.terminate()
        process.wait()


@contextlib.contextmanager
def cluster(workers: int, scratch: Path) -> Iterator[str]:
    """Start a scheduler and its workers; gives its address."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = str(probe.getsockname()[1])
    address = f"tcp://127.0.0.1:{port}"
    words = ["--nworkers", str(workers), "--nthreads", "1", "--local-directory", str(scratch)]
    with (
        started("scheduler", "--host", "127.0.0.1", "--port", port),
        started("worker", address, *words),
    ):
        with Client(address, timeout=30) as client:
            client.wait_for_workers(workers, timeout=60)
        yield address


def draw(folder: Path) -> None:
    """Write blurred images of disks, and files that are damaged among them."""
    folder.mkdir()
    y, x = np.mgrid[:SIDE, :SIDE]
    random = np.random.default_rng(0)
    for number in range(FILES):
        image = np.zeros((SIDE, SIDE))
        for _ in range(8):
            row, column, radius = random.uniform((0, 0, 10), (SIDE, SIDE, 60))
            image += np.tanh((radius - np.hypot(y - row, x - column)) / 3)
        pixels = np.uint8(127.5 + 127.5 * np.tanh(image))
        Image.fromarray(pixels).save(folder / f"{number:03}.png")
    for number in range(0, FILES, FILES // DAMAGED):
        path = folder / f"{number:03}.png"
        path.write_bytes(path.read_bytes()[:100])


def sharpen(inputs: str, out: Path, address: str) -> tuple[float, int]:
    """Return the seconds from connecting to the last file, and how many files were written."""
    shutil.rmtree(out, ignore_errors=True)
    words = ["sharpen-image", inputs, f"{out}/", "--quiet", "--cluster", address]
    start = time.perf_counter()
    with contextlib.redirect_stderr(None):  # which lists the damaged ones
        cli.main(words)
    return time.perf_counter() - start, len(list(out.glob("*.png")))


def files(page: Page, scratch: Path) -> None:
    """Sharpen many small files, some of which are damaged."""
    folder = scratch / "in"
    draw(folder)
    speeds: dict[int, list[float]] = {1: [], 2: []}
    with contextlib.ExitStack() as stack:
        addresses = {
            count: stack.enter_context(cluster(count, scratch / f"workers {count}"))
            for count in speeds
        }
        for address in addresses.values():
            sharpen(f"{folder}/0[01]*.png", scratch / "out", address)  # loads the kernels
        for _ in range(ROUNDS):  # in turn, as others may use the machine
            for count, address in addresses.items():
                seconds, written = sharpen(f"{folder}/*.png", scratch / "out", address)
                if written != FILES - DAMAGED:
                    raise SystemExit(f"{written} files were written.")
                speeds[count].append(FILES / seconds)
    one, two = (max(speeds[count]) for count in (1, 2))
    rows = [["one worker", f"{one:.1f}"], ["two workers", f"{two:.1f}"]]
    target = Target("two workers, times as fast as one", two / one, LEAST, at_least=True)
    about = (
        f"{FILES} gray images of {SIDE} x {SIDE} pixels, {DAMAGED} of them damaged; the fastest of"
        f" {ROUNDS} runs."
    )
    page.write(
        "files", "\n\n".join([about, table(["", "files a second"], rows), targets([target])])
    )


SECTIONS: dict[str, Callable[[Page, Path], None]] = {"files": files}


def main() -> None:
    """Run the parts that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--write", type=Path, metavar="PAGE", help="put the results into this page")
    parser.add_argument(
        "--only", choices=SECTIONS, nargs="+", default=list(SECTIONS), help="parts to run"
    )
    arguments = parser.parse_args()
    page = Page(arguments.write)
    for name in arguments.only:
        with tempfile.TemporaryDirectory() as scratch:
            SECTIONS[name](page, Path(scratch))
    page.write("machine", common.machine())


if __name__ == "__main__":
    main()
