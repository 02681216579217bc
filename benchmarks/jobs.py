# SPDX-License-Identifier: GPL-3.0-or-later
"""How long Esc takes and how much runs disturb the window, at a million vertices.

Needs bpy installed, but no window: each filter runs on a thread as in Blender. A run can be
cancelled whenever it asks, so the longest time between two questions is the longest that its
thread goes on after Esc. Meanwhile the main thread does what a window does, and measures how
late it wakes up: that is what holding Python's lock costs.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import common
import numpy as np
from report import Page, Target, table, targets
from shock_filter import core
from shock_filter.core.host.colors import filter_colors
from shock_filter.core.host.geometry import filter_shape
from shock_filter.core.host.images import filter_image
from shock_filter.core.host.inputs import (
    ColoredSurface,
    Denoising,
    HostImage,
    MirroredSurface,
    TexturedFaces,
    TexturedSurface,
)
from shock_filter.core.host.textures import filter_texture
from shock_filter.core.host.welding import forget
from shock_filter.core.settings import BeltramiGeometrySettings, BeltramiSettings

LONGEST_WAIT = 0.5
LONGEST_GAP = 0.3
TICK = 0.01

Progress = Callable[[float, str], bool]
Work = Callable[[Progress], object]


class Enough(Exception):
    """Long runs are stopped after a while."""


@dataclass(frozen=True)
class Watched:
    """Measurements of a run, in seconds; `what` is the step of the longest wait."""

    seconds: float
    wait: float
    what: str
    gap: float


def watch(work: Work, limit: float) -> Watched:
    """Run the work on a thread for at most `limit` seconds."""
    questions = []
    began = time.perf_counter()

    def progress(fraction: float, message: str) -> bool:
        questions.append((time.perf_counter(), message))
        if time.perf_counter() - began > limit:
            raise Enough
        return True

    def body() -> None:
        questions.append((time.perf_counter(), "Preparing"))
        with contextlib.suppress(Enough):
            work(progress)
        questions.append((time.perf_counter(), "the end"))

    thread = threading.Thread(target=body)
    thread.start()
    gap, last = 0.0, time.perf_counter()
    while thread.is_alive():
        time.sleep(TICK)
        now = time.perf_counter()
        gap, last = max(gap, now - last - TICK), now
    waits = [(b[0] - a[0], a[1]) for a, b in itertools.pairwise(questions)]
    wait, what = max(waits)
    return Watched(questions[-1][0] - began, wait, what, gap)


def relief(count: int) -> tuple[np.ndarray, np.ndarray]:
    """A rough sheet with steps, of about `count` vertices: positions and triangles."""
    side = max(int(count**0.5), 4)
    x, y = np.meshgrid(np.linspace(-1, 1, side), np.linspace(-1, 1, side))
    z = 0.05 * np.tanh(8 * np.sin(9 * x)) * np.tanh(8 * np.sin(9 * y))
    z += np.random.default_rng(0).normal(scale=0.1 / side, size=z.shape)
    positions = np.stack([x, y, z], axis=-1).reshape(-1, 3).astype(np.float32)
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).reshape(-1, 1)
    triangles = (corner + [[0, 1, side + 1, 0, side + 1, side]]).reshape(-1, 3)
    return positions, triangles.astype(np.int32)


def runs(count: int, size: int) -> dict[str, Work]:
    """Name what is run: meshes of `count` vertices, images of `size` pixels across."""
    positions, triangles = relief(count)
    count = len(positions)
    order = np.random.default_rng(1).permutation(count)
    place = np.argsort(order).astype(np.int32)
    shuffled = positions[order], place[triangles]
    identity, free = np.identity(3), (False, False, False)
    colors = (0.5 + 0.5 * np.tanh(4 * np.sin(9 * positions))).astype(np.float32)
    corners = np.arange(triangles.size, dtype=np.int32).reshape(-1, 3)
    mask = np.linspace(0.0, 1.0, count)
    geometry, light = core.GeometrySettings(), BeltramiGeometrySettings()

    def shape(at, faces, weights=None, mirror=free):
        return MirroredSurface(at, faces, weights, identity, mirror, ())

    def painted(values, at_corners):
        return ColoredSurface(positions, triangles, None, identity, values, at_corners, None, 255)

    side = int(count**0.5)
    uv = (positions[triangles][..., :2].astype(np.float64) + 1) / 2
    faces = TexturedFaces(positions.astype(np.float64), triangles.astype(np.int64), uv, None)
    y, x = np.mgrid[:size, :size]
    pixels = np.ones((size, size, 4), np.float32)
    pixels[..., 0] = 0.5 + 0.5 * np.tanh(np.sin(x / 40.0) + np.sin(y / 50.0))
    photo = HostImage(pixels, "STRAIGHT", False, 255)
    textured = TexturedSurface(faces, photo, None)
    denoise = Denoising(light, 16.0)
    return {
        "geometry": lambda p: filter_shape(
            shape(positions, triangles), "sharpen_geometry", geometry, True, p
        ),
        "geometry, vertices in random order": lambda p: filter_shape(
            shape(*shuffled), "sharpen_geometry", geometry, True, p
        ),
        "geometry, mask and mirror": lambda p: filter_shape(
            shape(positions, triangles, mask, (True, True, False)),
            "sharpen_geometry",
            geometry,
            True,
            p,
        ),
        "geometry, radius of 30 edges": lambda p: filter_shape(
            shape(positions, triangles),
            "sharpen_geometry",
            core.GeometrySettings(screening_radius=30.0),
            True,
            p,
        ),
        "colors of vertices": lambda p: filter_colors(
            painted(colors, None), "sharpen_vertex_signal", core.ShockSettings(), True, p
        ),
        "colors of corners": lambda p: filter_colors(
            painted(colors[triangles].reshape(-1, 3), corners),
            "sharpen_vertex_signal",
            core.ShockSettings(),
            True,
            p,
        ),
        "denoising geometry": lambda p: filter_shape(
            shape(positions, triangles), "denoise_geometry", denoise, True, p
        ),
        f"texture, {size} pixels across, {side**2 // 1000} K vertices": lambda p: filter_texture(
            textured, "sharpen_texture", core.TextureSettings(), p
        ),
        f"image, {size} pixels across": lambda p: filter_image(
            photo, "sharpen_image", core.ImageSettings(), p
        ),
        f"denoising an image, {size} pixels across": lambda p: filter_image(
            photo, "beltrami_image", Denoising(BeltramiSettings(), None), p
        ),
    }


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small meshes, for a trial")
    parser.add_argument("--write", type=Path, help="Markdown page to write the tables into")
    parser.add_argument("--limit", type=float, default=20.0, help="most seconds a run")
    arguments = parser.parse_args()
    count, size = (50_000, 512) if arguments.quick else (1_000_000, 4096)
    for work in runs(50_000, 256).values():  # compiles
        watch(work, 60.0)
    seen = {}
    for name, work in runs(count, size).items():
        forget()
        seen[name] = watch(work, arguments.limit)
    rows = [
        [name, f"{run.seconds:.1f}", f"{1e3 * run.wait:.0f}", run.what, f"{1e3 * run.gap:.0f}"]
        for name, run in seen.items()
    ]
    head = ["run", "seconds", "Esc to end, ms at most", "while", "tick late, ms at most"]
    worst = [
        Target("Esc to the thread's end, s", max(run.wait for run in seen.values()), LONGEST_WAIT),
        Target("tick gap, s", max(run.gap for run in seen.values()) + TICK, LONGEST_GAP),
    ]
    page = Page(arguments.write)
    page.write("jobs", table(head, rows) + "\n\n" + targets(worst))
    page.write("machine", common.machine())


if __name__ == "__main__":
    main()
