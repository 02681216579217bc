# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory and time of each filter per vertex or pixel, and what fits into one machine.

``python benchmarks/one_machine.py`` runs each filter with its defaults in a process of its own, and
prints bytes, seconds of one core, and how many vertices or pixels that makes in 16 GiB.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import common
import numpy as np
from report import Page, table
from shock_filter import core
from texture_models import BALL, Model, read_model, save_model

LEVEL = 8
"""How often the creased sphere's triangles are split into four."""

SIDE = 2048
MEMORY = 16 * 2**30


def sphere(level: int, _side: int) -> core.TriangleMesh:
    """Make the mesh."""
    return core.TriangleMesh(*common.load_mesh(None, common.CREASED_SPHERE, level))


def image(_level: int, side: int) -> np.ndarray:
    """Make soft shapes with some noise, row by row, so that this takes little memory."""
    rng = np.random.default_rng(0)
    x = np.arange(side)
    out = np.empty((side, side, 3), np.uint8)
    for y in range(side):
        waves = np.tanh(3 * np.sin(x / 19 + 2 * np.sin(y / 31)) * np.sin(y / 17))
        noisy = 0.5 + 0.4 * waves[:, None] + rng.normal(0, 0.02, (side, 3))
        out[y] = np.rint(255 * np.clip(noisy, 0, 1))
    return out


def painted_ball(_level: int, side: int) -> Model:
    """Make a mesh with a texture, in another process for the same reason."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "ball.npz")
        common.in_own_process(save_model, path, None, BALL, side)
        return read_model(path)


def colored(mesh: core.TriangleMesh) -> np.ndarray:
    """Paint a mesh: (n, 3) float64."""
    return core.sharpen_vertex_signal(mesh, 0.5 + 0.5 * np.tanh(4 * mesh.vertices))


def sharpened(model: Model) -> np.ndarray:
    """Sharpen a model's texture."""
    return core.sharpen_texture(model.mesh(), model.uv, model.image)


def detailed(model: Model) -> np.ndarray:
    """Raise its detail."""
    return core.filter_texture(model.mesh(), model.uv, model.image)


RUNS: dict[str, tuple[str, Callable, Callable]] = {
    "Sharpen geometry": ("vertex", sphere, core.sharpen_geometry),
    "Denoise geometry": ("vertex", sphere, core.denoise_geometry),
    "Sharpen colors of vertices": ("vertex", sphere, colored),
    "Sharpen an image": ("pixel", image, core.sharpen_image),
    "Denoise an image": ("pixel", image, core.beltrami_image),
    "Sharpen a texture": ("texel", painted_ball, sharpened),
    "Detail of a texture": ("texel", painted_ball, detailed),
}
"""What each is counted by, what it works on, and the filter."""


def measured(name: str, level: int, side: int) -> tuple[int, float, float]:
    """Run a filter: how many vertices or pixels there are, seconds of one core, and bytes."""
    _, make, run = RUNS[name]
    run(make(2, 48))  # compiles kernels
    data = make(level, side)
    count = data.vertex_count if isinstance(data, core.TriangleMesh) else side * side
    before, start = common.peak_memory(), time.process_time()
    run(data)
    seconds = time.process_time() - start
    return count, seconds, common.peak_memory() - before


def main() -> None:
    """Measure and print, or write into a page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--write", type=Path, metavar="PAGE", help="put the results into this page")
    options = parser.parse_args()
    rows = []
    for name, (unit, *_) in RUNS.items():
        count, seconds, memory = common.in_own_process(measured, name, LEVEL, SIDE)
        each = memory / count
        rows.append([
            name, f"{count:,}", unit, f"{each:,.0f}", f"{1e6 * seconds / count:.2f}",
            f"{MEMORY / each / 1e6:,.0f}",
        ])  # fmt: skip
        print(" | ".join(rows[-1]), flush=True)
    head = ["", "measured with", "counted by", "bytes each", "core seconds a million"]
    head += ["millions in 16 GiB"]
    text = (
        "Default settings; memory besides the input and the result. The last column is"
        " extrapolated."
    )
    page = Page(options.write)
    page.write("one machine", "\n\n".join([text, table(head, rows, 1), common.machine()]))


if __name__ == "__main__":
    main()
