# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoising of regular meshes with relief: clean ones should stay."""

from __future__ import annotations

import common
import numpy as np
from relief_meshes import RELIEF, SEED, SHAPES, with_relief
from report import table
from shock_filter import core

WAVES = 6, 10, 16, 28
"""Mean edges from one bump to the next, or so."""

NOISE = 0.1, 0.25
"""In all directions, in mean edges."""


def relief(job: common.Job) -> None:
    """Change of clean relief, and error of noisy relief, as mean angles over faces."""
    rows = []
    for name in RELIEF:
        for wave in WAVES:
            meshes = [with_relief(shape, name, wave) for shape in SHAPES]
            clean = [_left(mesh, mesh) for mesh in meshes]
            row = [name, str(wave), f"{np.mean(clean):.2f}", f"{max(clean):.2f}"]
            for amount in NOISE:
                pairs = np.array([_with_noise(mesh, amount) for mesh in meshes])
                row.append(f"{pairs[:, 0].mean():.1f} to {pairs[:, 1].mean():.1f}")
            rows.append(row)
    heads = ["relief", "edges from bump to bump", "clean: turned by", "most"]
    text = [
        f"A {', a '.join(SHAPES)}, in degrees, at the default; most: of the four.",
        table([*heads, *(f"noise {amount}" for amount in NOISE)], rows),
    ]
    job.page.write("relief", "\n\n".join(text))


def _left(mesh: core.TriangleMesh, truth: core.TriangleMesh) -> float:
    return common.normal_error(mesh.moved_to(core.denoise_geometry(mesh)), truth)


def _with_noise(mesh: core.TriangleMesh, amount: float) -> tuple[float, float]:
    rng = np.random.default_rng(SEED)
    move = amount * mesh.mean_edge_length * rng.normal(size=mesh.vertices.shape)
    noisy = mesh.moved_to(mesh.vertices + move)
    return common.normal_error(noisy, mesh), _left(noisy, mesh)
