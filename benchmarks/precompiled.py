# SPDX-License-Identifier: GPL-3.0-or-later
"""Precompiled kernels against those of numba: time of the first call, and of later calls.

``python benchmarks/precompiled.py`` builds the library of this system (some minutes, the first
time), and runs each filter in processes of its own, without numba and with it, in turn. numba finds
its code on disk. In both, freed memory stays with the process: numba's compiler, which holds the
end of the heap, would spare its own process thousands of page faults.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
import zipfile
from pathlib import Path

import common
import numpy as np
from report import Page, table

ROOT = Path(__file__).resolve().parents[1]
ROUNDS, REPEATS = 8, 5

KEPT = {"MALLOC_TRIM_THRESHOLD_": "4000000000", "MALLOC_MMAP_THRESHOLD_": "4000000000"}
"""What makes glibc keep freed memory, in the environment of a process."""


def _shape(level: int):
    # A little rough, so that both filters have something to do.
    points, faces = common.load_mesh(None, common.CREASED_SPHERE, level)
    noise = np.random.default_rng(0).normal(scale=0.2 / 2**level, size=points.shape)
    return points + noise, faces


def _picture(side: int) -> np.ndarray:
    y, x = np.mgrid[:side, :side] / 40.0
    waves = np.tanh(3 * np.sin(x + 2 * np.sin(y)) * np.sin(1.3 * y))
    noise = np.random.default_rng(0).normal(0, 0.02, (side, side, 3))
    return (0.5 + 0.4 * waves[..., None] + noise).astype(np.float32)


def _model(side: int):
    from texture_models import BALL, load_model

    return load_model(None, BALL, side)


RUNS = ["geometry", "denoise geometry", "image", "texture", "stitch", "noise of a flow"]


def prepared(name: str, size: int):
    """Return a function that runs a filter: on something tiny, or (`size` 1) in the usual size."""
    from shock_filter import core

    if "geometry" in name:
        shape = _shape(7 if size else 3)
        call = core.denoise_geometry if "denoise" in name else core.sharpen_geometry
        return lambda: call(core.TriangleMesh(*shape))  # what is known of a mesh is kept with it
    if name == "image":
        picture = _picture(768 if size else 48)
        return lambda: core.sharpen_image(picture)
    if name == "noise of a flow":
        y, x = np.mgrid[: (512 if size else 48), : (512 if size else 48)] / 40.0
        velocity = np.stack([np.sin(y), np.cos(x)], -1).astype(np.float32)
        return lambda: list(core.advect_noise(velocity, frames=10))
    model = _model(512 if size else 64)
    image = np.asarray(model.image, np.float32)
    call = core.stitch_textures if name == "stitch" else core.sharpen_texture
    return lambda: call(model.mesh(), model.uv, image)


def measured(name: str, library: str | None) -> tuple[float, float]:
    """Return seconds until a first, tiny call is done, and the least core seconds of others."""
    if library:
        sys.path.insert(0, library)
        sys.modules["numba"] = None  # type: ignore[assignment]
    tiny = prepared(name, 0)
    start = time.perf_counter()
    tiny()
    first = time.perf_counter() - start
    run = prepared(name, 1)
    run()
    seconds = []
    for _ in range(REPEATS):
        start = time.process_time()
        run()
        seconds.append(time.process_time() - start)
    return first, min(seconds)


def compared(name: str, library: str) -> list[str]:
    """Return a row of the table."""
    found: dict[str | None, list[tuple[float, float]]] = {library: [], None: []}
    for _ in range(ROUNDS):
        for way, rows in found.items():
            rows.append(common.in_own_process(measured, name, way))
    (first, seconds), (numba_first, numba_seconds) = (np.min(found[key], axis=0) for key in found)
    return [
        name, f"{first:.2f}", f"{numba_first:.2f}", f"{seconds:.3f}", f"{numba_seconds:.3f}",
        f"{seconds / numba_seconds:.3f}",
    ]  # fmt: skip


def _built(folder: Path) -> str:
    sys.path.insert(0, str(ROOT / "tools"))
    import build_kernels

    build_kernels.PLACE.mkdir(exist_ok=True)
    with zipfile.ZipFile(build_kernels.build("linux-x64")) as archive:
        archive.extractall(folder)
    return str(folder)


def main() -> None:
    """Build, measure, and print or write into a page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--write", type=Path, metavar="PAGE", help="put the results into this page")
    parser.add_argument(
        "--library", metavar="FOLDER", help="what tools/build_kernels.py installed, to build none"
    )
    options = parser.parse_args()
    os.environ.update(KEPT)
    with tempfile.TemporaryDirectory() as scratch:
        library = options.library or _built(Path(scratch))
        rows = []
        for name in RUNS:
            rows.append(compared(name, library))
            print(" | ".join(rows[-1]), flush=True)
    head = ["", "first call, s", "numba", "core seconds", "numba", "ratio"]
    text = (
        f"The least of {ROUNDS} processes each, in turn; numba's code is on disk, and freed memory"
        " stays with the process."
    )
    page = Page(options.write)
    page.write("precompiled", "\n\n".join([table(head, rows, 1), text, common.machine()]))


if __name__ == "__main__":
    main()
