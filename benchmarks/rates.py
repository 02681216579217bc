# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure each filter beside what the panel's statistics expect of it (core/estimate.py).

``python benchmarks/rates.py`` prints a table: seconds on the clock, what was expected, and the
ratio, which should lie between a half and two on a machine that does nothing else; the same for
memory. Each row runs in a process of its own, the filter once on little data and then timed.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from functools import partial
from typing import Any

import common
import numpy as np
from report import table
from shock_filter import core
from shock_filter.core.estimate import estimate, wall_seconds
from shock_filter.core.filters import denoising
from shock_filter.core.settings import (
    BeltramiGeometrySettings,
    BeltramiMeshSettings,
    BeltramiSettings,
    GeometrySettings,
    ImageSettings,
    ShockSettings,
    TextureSettings,
)

LITTLE, MUCH = 3, 7
"""How often the sphere is subdivided; images have about as many pixels as it has vertices."""

CASES = [
    GeometrySettings(),
    GeometrySettings(time=math.inf),
    GeometrySettings(smoothing_passes=8, mollify_passes=8),
    ShockSettings(),
    ShockSettings(time=math.inf),
    ShockSettings(time=16.0, scheme="composed"),
    ImageSettings(),
    ImageSettings(time=math.inf),
    ImageSettings(time=16.0, scheme="composed"),
    TextureSettings(),
    TextureSettings(time=math.inf),
    BeltramiGeometrySettings(),
    BeltramiGeometrySettings(time=2.0, repeat=1),
    BeltramiMeshSettings(),
    BeltramiMeshSettings(distance="euclidean"),
    BeltramiSettings(),
    BeltramiSettings(time=4.0, iterations=1),
    BeltramiSettings(distance="euclidean"),
]


def main() -> None:
    """Print the table."""
    cores = os.cpu_count() or 1
    rows = []
    for settings in CASES:
        size, seconds, memory = common.in_own_process(measure, settings)
        guess = estimate(settings, size)
        expected = wall_seconds(guess.seconds, cores)
        rows.append(
            [
                described(settings),
                f"{size:,}",
                f"{seconds:.2f}",
                f"{expected:.2f}",
                f"{seconds / expected:.2f}",
                f"{memory / size:.0f}",
                f"{guess.memory / size:.0f}",
            ]
        )
    print(common.machine())
    head = ["settings", "size", "seconds", "expected", "ratio", "bytes each", "expected"]
    print(table(head, rows))


def described(settings: Any) -> str:
    """Name the settings that differ from the defaults."""
    default = type(settings)()
    names = [name for name in vars(settings) if getattr(settings, name) != getattr(default, name)]
    values = ", ".join(f"{name}={getattr(settings, name)}" for name in names)
    return f"{type(settings).__name__}({values})"


def measure(settings: Any) -> tuple[int, float, int]:
    """Return the size, the seconds and the bytes of one run."""
    prepare(settings, LITTLE)[1]()
    size, run = prepare(settings, MUCH)
    before = common.peak_memory()
    seconds = common.fastest(run, 1)
    return size, min(seconds, common.fastest(run, 2)), common.peak_memory() - before


def prepare(settings: Any, level: int) -> tuple[int, Callable[[], Any]]:
    """Make data for a filter; return its size, and the filter on it."""
    if isinstance(settings, (ImageSettings, BeltramiSettings, TextureSettings)):
        image = picture(level)
        size = image.shape[0] * image.shape[1]
        if isinstance(settings, ImageSettings):
            return size, partial(core.sharpen_image, image, settings)
        if isinstance(settings, BeltramiSettings):
            return size, partial(denoising.denoise_image, image, settings, None)
        return size, partial(sharpen_texture, image, settings)
    vertices, faces = common.load_mesh(None, common.CREASED_SPHERE, level)
    noise = np.random.default_rng(0).normal(size=vertices.shape)
    vertices = vertices + 0.1 * core.TriangleMesh(vertices, faces).mean_edge_length * noise
    colors = (0.5 + 0.5 * np.sin(4.0 * vertices)).astype(np.float32)

    def run() -> Any:
        mesh = core.TriangleMesh(vertices, faces)
        if isinstance(settings, GeometrySettings):
            return core.sharpen_geometry(mesh, settings)
        if isinstance(settings, ShockSettings):
            return core.sharpen_vertex_signal(mesh, colors, settings)
        if isinstance(settings, BeltramiGeometrySettings):
            return denoising.denoise_geometry(mesh, settings, None, None, None)
        return denoising.denoise_vertex_signal(mesh, colors, settings, None, None, None)

    return len(vertices), run


def picture(level: int) -> np.ndarray:
    """Make waves of colors with a little noise, opaque: (h, w, 4) float32."""
    y, x = np.mgrid[: 3 * 2**level, : 4 * 2**level]
    waves = [np.tanh(3.0 * np.sin(x / 30 + shift) * np.cos(y / 40)) for shift in range(3)]
    colors = 0.5 + 0.4 * np.stack(waves, axis=-1)
    colors += np.random.default_rng(0).normal(scale=0.02, size=colors.shape)
    opaque = np.ones((*x.shape, 1))
    return np.concatenate([colors, opaque], axis=-1).astype(np.float32)


def sharpen_texture(image: np.ndarray, settings: TextureSettings) -> np.ndarray:
    """Sharpen an image on a bent sheet that shows all of it."""
    u, v = np.meshgrid(np.linspace(0.0, 1.0, 65), np.linspace(0.0, 1.0, 65), indexing="ij")
    points = np.stack([4.0 * u, 3.0 * v, 0.2 * np.sin(6.0 * u)], axis=-1).reshape(-1, 3)
    index = np.arange(65 * 65).reshape(65, 65)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:],
                                            index[:-1, 1:]))  # fmt: skip
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    uv = np.stack([u, v], axis=-1).reshape(-1, 2)[faces]
    return core.sharpen_texture(core.TriangleMesh(points, faces), uv, image, settings)


if __name__ == "__main__":
    main()
