# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoising of scans made from solids: parts, smooth bodies and both in one, with known normals."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import common
import numpy as np
from report import Target, table, targets
from scans import normals_averaged, smoothed
from shock_filter import core

sys.path.append(str(Path(__file__).resolve().parent.parent / "tools" / "training"))
from distances import Floats, Solid, gradient, nearest
from meshings import EXTENT, sampled, surface_nets
from solids import solid

FIRST_SEED = 70_000_000
"""Seeds of the solids; training uses lower ones."""

KINDS = "part", "smooth", "plinth"
"""A plinth is a part and a bumpy body in one mesh."""

CELLS = 56, 80
"""Voxels along an axis, of the first and of the second solid of each kind and noise."""

PLANE_WAVES = 240
"""Correlated noise is a sum of so many plane waves, with random directions."""


class Noise(NamedTuple):
    """Of vertices, in mean edges; or correlated, of a wavelength in voxels, in voxels."""

    amount: float
    wavelength: float = 0.0
    along: bool = False

    @property
    def label(self) -> str:
        """Its name in a table."""
        if self.wavelength:
            return f"waves of {self.wavelength:g}, {self.amount:g}"
        return f"white{' along normals' if self.along else ''}, {self.amount:g}"


NOISES = [
    Noise(0.1), Noise(0.3), Noise(0.2, along=True),
    Noise(0.08, 3.0), Noise(0.2, 3.0), Noise(0.1, 5.0), Noise(0.2, 5.0),
]  # fmt: skip

RIVALS: dict[str, list[Callable[[core.TriangleMesh], Floats]]] = {
    "Laplacian": [lambda m, k=k: smoothed(m, k) for k in (1, 3, 8)],
    "Taubin": [lambda m, k=k: smoothed(m, k, back=0.53) for k in (5, 10, 30)],
    "bilateral normals": [lambda m, s=s: normals_averaged(m, s, False) for s in (0.2, 0.35, 0.6)],
    "guided normals": [lambda m, s=s: normals_averaged(m, s, True) for s in (0.2, 0.35, 0.6)],
}
"""Other filters with several settings; the best one of each scan counts."""

MEDIAN, MEAN, WORST = 0.78, 0.7, 1.5


class Scan(NamedTuple):
    """A noisy mesh, and the true normals of its faces."""

    mesh: core.TriangleMesh
    truth: Floats

    def error(self, positions: Floats) -> float:
        """Mean angle to the truth, in degrees, over faces."""
        normals = self.mesh.moved_to(positions).normals
        cosines = np.clip((normals * self.truth).sum(1), -1.0, 1.0)
        return float(np.degrees(np.arccos(cosines)).mean())


def scan_of(kind: str, noise: Noise, seed: int, cells: int) -> Scan:
    """Mesh a solid from voxels, with noise before or after."""
    rng = np.random.default_rng(seed)
    h = 2 * EXTENT / (cells - 1)
    shape = solid(rng, kind, h)
    if not noise.wavelength:
        return _of_vertices(rng, shape, noise, cells)
    d = sampled(shape, cells)
    near = np.argwhere(abs(d) < 3 * h)
    waves = rng.normal(size=(PLANE_WAVES, 3))
    waves *= 2 * np.pi / noise.wavelength / np.linalg.norm(waves, axis=1, keepdims=True)
    waves /= rng.uniform(0.7, 1.4, (PLANE_WAVES, 1))
    phase = rng.uniform(0, 2 * np.pi, PLANE_WAVES)
    bumps = np.sqrt(2 / PLANE_WAVES) * np.cos(near @ waves.T + phase).sum(1)
    d[tuple(near.T)] += noise.amount * h * bumps
    v, f = surface_nets(d)
    return _scan(shape, v * h - EXTENT, f, h)


def _of_vertices(rng, shape: Solid, noise: Noise, cells: int) -> Scan:
    h = 2 * EXTENT / (cells - 1)
    v, f = surface_nets(sampled(shape, cells))
    clean = _scan(shape, v * h - EXTENT, f, h)
    move = noise.amount * clean.mesh.mean_edge_length * rng.normal(size=v.shape)
    if noise.along:
        along = gradient(shape, clean.mesh.vertices)
        move = move[:, :1] * along
    return Scan(clean.mesh.moved_to(clean.mesh.vertices + move), clean.truth)


def _scan(shape: Solid, v: Floats, f, h: float) -> Scan:
    return Scan(core.TriangleMesh(v, f), gradient(shape, nearest(shape, v[f].mean(1), h)))


def errors_of(scan: Scan) -> dict[str, float]:
    """Errors of the scan, of our default, also with *Then Sharpen*, and of rivals at their best."""
    found = {"scan": scan.error(scan.mesh.vertices)}
    denoised = scan.mesh.moved_to(core.denoise_geometry(scan.mesh))
    found["ours"] = scan.error(denoised.vertices)
    found["then sharpened"] = scan.error(core.sharpen_geometry(denoised))
    for title, filters in RIVALS.items():
        tried = (core.TriangleMesh(scan.mesh.vertices, scan.mesh.faces) for _ in filters)
        found[title] = min(scan.error(f(m)) for f, m in zip(filters, tried, strict=True))
    return found


def all_errors() -> list[tuple[str, str, dict[str, float]]]:
    """Kind, noise and errors of all scans."""
    found, seed = [], FIRST_SEED
    for kind in KINDS:
        for noise in NOISES:
            for cells in CELLS:
                seed += 1
                found.append((kind, noise.label, errors_of(scan_of(kind, noise, seed, cells))))
    return found


def made(job: common.Job) -> None:
    """Errors on made scans, and the share of them that the best rival leaves."""
    found = common.in_own_process(all_errors)
    titles = list(found[0][2])
    rows = []
    for noise in NOISES:
        for kind in KINDS:
            each = [e for k, label, e in found if (k, label) == (kind, noise.label)]
            rows.append(
                [kind, noise.label, *(f"{np.mean([e[t] for e in each]):.2f}" for t in titles)]
            )
    best = np.array([min(e[title] for title in RIVALS) for _, _, e in found])
    ours = np.array([e["ours"] for _, _, e in found])
    shares, sharp = ours / best, np.array([e["then sharpened"] for _, _, e in found])
    text = [
        f"{len(found)} scans of made solids, surface nets of {CELLS[0]} and {CELLS[1]} voxels."
        " Noise of vertices is in mean edges, of waves in voxels. Mean angle to the true normals,"
        " in degrees.",
        table(["solid", "noise", *titles], rows, words=2),
        targets([
            Target("ours / best rival of each scan, median", float(np.median(shares)), MEDIAN),
            Target("mean of ours / mean of the best", float(ours.mean() / best.mean()), MEAN),
            Target("ours / best rival of each scan, worst", float(shares.max()), WORST),
        ]),
        f"With *Then Sharpen*: median {np.median(sharp / best):.2f},"
        f" mean {sharp.mean() / best.mean():.2f}, worst {(sharp / best).max():.2f}.",
    ]  # fmt: skip
    job.page.write("made", "\n\n".join(text))
