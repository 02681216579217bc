# SPDX-License-Identifier: GPL-3.0-or-later
"""How well What and Width of mesh colors find and close borders, against fixed times.

Patches of flat color are painted by code, blurred by smoothing passes, and sharpened; what comes
back is compared with what was painted.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import common
import numpy as np
import numpy.typing as npt
import trimesh
from report import Page, table
from scipy.spatial import Delaunay, cKDTree
from scipy.special import erf
from shock_filter import core
from shock_filter.core.flow.borders import measured
from shock_filter.core.mesh.calculus import smooth_vertices

CASES = (8, 0.0), (16, 0.0), (8, 0.02)
"""Smoothing passes, and noise as a part of the contrast."""

CONTRASTS = 1.0, 0.15
SEEDS = 2, 3
"""Seeds of paintings that were not used to tune What and Width."""

PATCHES = 40
SETTINGS = {
    "Auto": core.ShockSettings(what="auto"),
    "Drawing": core.ShockSettings(what="drawing"),
    "Photo": core.ShockSettings(what="photo"),
    "time 256": core.ShockSettings(time=256.0),
    "time 4096": core.ShockSettings(time=4096.0),
}
WIDTH = 6.0
TIMES = 0.5, 1.0, 1.5, 2.0, 3.0, 4.0

Floats = npt.NDArray[np.float64]


def ball() -> core.TriangleMesh:
    """A sphere of even triangles."""
    sphere = trimesh.creation.icosphere(subdivisions=5)
    return core.TriangleMesh(sphere.vertices, sphere.faces)


def sheet(growth: float = 0.0) -> core.TriangleMesh:
    """An uneven sheet, whose edges grow from one end to the other if wanted."""
    random = np.random.default_rng(0)
    y, x = np.mgrid[:100, :100] + random.uniform(-0.35, 0.35, (2, 100, 100))
    flat = np.stack([x.reshape(-1), y.reshape(-1)], axis=1)
    faces = Delaunay(flat).simplices
    if growth:
        flat *= np.exp(growth * flat[:, :1] / 100.0)
    return core.TriangleMesh(np.pad(flat, ((0, 0), (0, 1))), faces)


def model(data: Path, name: str, subdivisions: int) -> core.TriangleMesh:
    """A test mesh."""
    return core.TriangleMesh(*common.load_mesh(data, name, subdivisions))


def painted(mesh: core.TriangleMesh, seed: int) -> Floats:
    """Flat patches of random colors."""
    random = np.random.default_rng(seed)
    centers = mesh.vertices[random.choice(mesh.vertex_count, PATCHES, replace=False)]
    return random.random((PATCHES, 3))[cKDTree(centers).query(mesh.vertices)[1]]


def error(values: Floats, truth: Floats) -> float:
    """Peak signal-to-noise ratio in dB."""
    return float(-10.0 * np.log10(((values - truth) ** 2).mean()))


def gains(mesh: core.TriangleMesh, passes: int, noise: float, contrast: float) -> Floats:
    """Width that is measured, and gains in dB: the mean over some paintings."""
    rows = []
    for seed in SEEDS:
        truth = 0.5 + contrast * (painted(mesh, seed) - 0.5)
        soft = smooth_vertices(mesh, truth, passes)
        soft += np.random.default_rng(seed).normal(0.0, noise * contrast, soft.shape)
        results = [core.sharpen_vertex_signal(mesh, soft, each) for each in SETTINGS.values()]
        gained = [error(result, truth) - error(soft, truth) for result in results]
        rows.append([measured(mesh, soft).width, *gained])
    return np.mean(rows, axis=0)


def paintings(meshes: dict[str, Callable[[], core.TriangleMesh]]) -> str:
    """Gains on all meshes."""
    rows = []
    for name, make in meshes.items():
        mesh = make()
        for passes, noise in CASES:
            strong, faint = (gains(mesh, passes, noise, contrast) for contrast in CONTRASTS)
            row = [name, str(passes), f"{noise:g}", f"{strong[0]:.1f}"]
            pairs = zip(strong[1:], faint[1:], strict=True)
            rows.append([*row, *(f"{high:+.1f} / {low:+.1f}" for high, low in pairs)])
    head = ["", "passes", "noise", "measured width", *(f"{name}: dB" for name in SETTINGS)]
    return table(head, rows)


def rise(across: Floats, values: Floats) -> float:
    """How far it is from 10 to 90 percent of the rise of mean values across a line."""
    places = np.round(across / 0.25).astype(int)
    first = places.min()
    counts = np.bincount(places - first)
    some = counts > 0
    means = np.maximum.accumulate(np.bincount(places - first, values)[some] / counts[some])
    shares = (means - means[0]) / (means[-1] - means[0])
    low, high = np.interp([0.1, 0.9], shares, 0.25 * np.flatnonzero(some))
    return float(high - low)


def widths() -> str:
    """How wide borders of several widths and contrasts are afterwards, over before."""
    mesh = ball()
    points = mesh.scaled_vertices
    radius = np.linalg.norm(points, axis=1).mean()
    direction = np.array([0.8, 0.5, 0.33]) / np.linalg.norm([0.8, 0.5, 0.33])
    across = radius * np.arcsin(np.clip(points @ direction / radius, -1.0, 1.0))
    rows = []
    for what in ("drawing", "photo"):
        settings = core.ShockSettings(what=what, width=WIDTH)
        for contrast in (1.0, 0.2, 0.05):
            found = []
            for times in TIMES:
                step = erf(across * 2.5631 / (times * WIDTH) / 2**0.5)
                soft = (0.5 + 0.5 * contrast * step)[:, None]
                result = core.sharpen_vertex_signal(mesh, soft, settings)
                found.append(f"{rise(across, result[:, 0]) / (times * WIDTH):.2f}")
            rows.append([what.title(), f"{contrast:g}", *found])
    return table(["", "contrast", *(f"{times:g} times" for times in TIMES)], rows)


def main() -> None:
    """Print the tables, or write them into a page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--data", type=Path, help="folder with test meshes, for more rows")
    parser.add_argument("--write", type=Path, help="Markdown page to write the tables into")
    options = parser.parse_args()
    meshes: dict[str, Callable[[], core.TriangleMesh]] = {
        "ball": ball,
        "uneven sheet": sheet,
        "sheet with growing edges": lambda: sheet(1.4),
    }
    if options.data:
        textured = options.data / "textured"
        meshes |= {
            "spot": lambda: model(options.data, textured / "spot" / "spot_triangulated.obj", 1),
            "blub": lambda: model(options.data, textured / "blub" / "blub_triangulated.obj", 1),
            "bunny": lambda: model(options.data, "bunny.obj", 0),
            "dragon": lambda: model(options.data, "dragon_50k.obj", 0),
        }
    page = Page(options.write)
    page.write("color-widths", widths())
    page.write("color-dials", paintings(meshes))


if __name__ == "__main__":
    main()
