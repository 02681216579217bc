# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes before and after denoising: a shape made by code, and on request the test meshes."""

from __future__ import annotations

import math
from pathlib import Path

import common
import numpy as np
import variants
from denoise_meshes import (
    case_pair,
    cleaned,
    creased_sphere,
    denoised,
    sharpened,
    with_noise,
)
from geometry_quality import errors
from pictures import View, draw, sheet
from report import table
from shock_filter import core

PIXELS = 250
NOISE = 0.3
PAINT_NOISE = 0.15
VIEW = View((-25.0, 30.0, 0.0))
TITLES = [
    "clean",
    "noisy",
    "denoised",
    "then sharpened",
    "euclidean",
    "positions",
    "sharpened only",
]


def shown(clean: core.TriangleMesh, noisy: core.TriangleMesh, view: View) -> list[np.ndarray]:
    """Pictures of a mesh: clean, noisy, and filtered in our ways."""
    results = [
        clean.vertices,
        noisy.vertices,
        denoised(noisy),
        sharpened(cleaned(noisy), sampling="linear"),
        denoised(noisy, distance="euclidean"),
        denoised(noisy, filtered="positions"),
        sharpened(noisy),
    ]
    moved = [core.TriangleMesh(positions, clean.faces) for positions in results]
    return [draw(mesh, clean, view, PIXELS) for mesh in moved]


def pictures(job: common.Job) -> None:
    """A creased shape before and after."""
    clean = creased_sphere(5)
    rows = [shown(clean, with_noise(clean, amount), VIEW) for amount in (0.1, NOISE)]
    about = "A creased shape, clean, noisy, and filtered: " + ", ".join(TITLES[2:])
    picture = job.page.picture("shape", sheet(TITLES, rows, 1).quantize(32), about)
    job.page.write(
        "pictures",
        f"A shape made by code, {clean.vertex_count:,} vertices, with noise of 0.1 (top) and"
        f" {NOISE} (bottom) mean edge lengths; all at their defaults (*then sharpened* with linear"
        " sampling)." + picture,
    )


def stripes(mesh: core.TriangleMesh) -> np.ndarray:
    """Sharp stripes of three colors, 30 mean edge lengths apart."""
    waves = np.sin(mesh.scaled_vertices * (2 * math.pi / 30))
    return np.where(waves > 0, 0.85, 0.35)


def painted_noisily(mesh: core.TriangleMesh) -> tuple[np.ndarray, np.ndarray]:
    """Vertex colors, clean and noisy."""
    colors = stripes(mesh)
    noise = np.random.default_rng(1).normal(0, PAINT_NOISE, colors.shape)
    return colors, np.clip(colors + noise, 0, 1)


def drawn(
    vertices: np.ndarray, clean: core.TriangleMesh, colors: np.ndarray, view: View
) -> np.ndarray:
    """Draw a mesh with vertex colors."""
    mesh = core.TriangleMesh(vertices, clean.faces)
    return draw(mesh, clean, view, PIXELS, colors[mesh.faces].mean(axis=1))


def color_psnr(colors: np.ndarray, clean: np.ndarray) -> str:
    """Peak signal-to-noise ratio in decibels."""
    return f"{-10 * math.log10(((colors - clean) ** 2).mean()):.2f}"


def painted(job: common.Job) -> None:
    """Noisy vertex colors."""
    mesh = creased_sphere(6)
    colors, noisy = painted_noisily(mesh)
    filtered = {"clean": colors, "noisy": noisy}
    for distance in ("geodesic", "euclidean"):
        settings = core.BeltramiMeshSettings(iterations=2)
        with variants.distances(distance):
            filtered[distance] = core.beltrami_vertex_signal(mesh, noisy, settings)
    tiles = [drawn(mesh.vertices, mesh, values, VIEW) for values in filtered.values()]
    rows = [
        [name, color_psnr(values, colors)] for name, values in filtered.items() if name != "clean"
    ]
    picture = job.page.picture(
        "painted", sheet(list(filtered), [tiles], 1).quantize(128), "A painted shape, denoised"
    )
    job.page.write(
        "painted",
        f"Stripes on {mesh.vertex_count:,} vertices, noise of {PAINT_NOISE} in each channel, two"
        " iterations, other settings at their defaults.\n\n"
        + table(["colors", "PSNR, dB"], rows) + picture,
    )  # fmt: skip


def jointly(
    clean: core.TriangleMesh, noisy: core.TriangleMesh, view: View
) -> tuple[list[np.ndarray], list[list[str]]]:
    """The paper's Figure 10: a mesh and its colors, filtered with the same weights."""
    colors, noisy_colors = painted_noisily(clean)
    shapes = {"clean": (clean.vertices, colors), "noisy": (noisy.vertices, noisy_colors)}
    for iterations, name in ((1, "one iteration"), (2, "two iterations")):
        settings = core.BeltramiMeshSettings(iterations=iterations)
        shapes[name] = core.beltrami_joint(noisy, noisy_colors, settings)
    shapes["each by itself"] = (
        denoised(noisy),
        core.beltrami_vertex_signal(noisy, noisy_colors, core.BeltramiMeshSettings(iterations=2)),
    )
    tiles, rows = [], []
    for name, (vertices, values) in shapes.items():
        tiles.append(drawn(vertices, clean, values, view))
        if name != "clean":
            found = errors(vertices, clean)
            row = [f"{found.normal:.2f}", f"{found.position:.3f}", color_psnr(values, colors)]
            rows.append([name, *row])
    return tiles, rows


JOINT_TITLES = ["clean", "noisy", "one iteration", "two iterations", "each by itself"]
JOINT_HEAD = ["", "normals, degrees", "positions, edge lengths", "colors, dB"]


def joint(job: common.Job) -> None:
    """A mesh and its colors together."""
    clean = creased_sphere(6)
    tiles, rows = jointly(clean, with_noise(clean, 0.2), VIEW)
    picture = job.page.picture(
        "joint", sheet(JOINT_TITLES, [tiles], 1).quantize(128), "A painted shape, both denoised"
    )
    job.page.write(
        "joint",
        f"The same shape with noise of 0.2 mean edge lengths, and its stripes with noise of"
        f" {PAINT_NOISE}; default settings. *Each by itself* is the filter of normals for the"
        " shape and two iterations for the colors.\n\n" + table(JOINT_HEAD, rows) + picture,
    )


SCANS = {
    "fandisk.obj": (["fandisk_noisy_0.3.obj", "fandisk_noisy_0.7.obj"], View((-60.0, 30.0, 0.0))),
    "block.obj": (["block_noisy_0.4.obj"], View((-50.0, 30.0, 0.0))),
    "sharp_sphere.obj": (["sharp_sphere_noisy_0.3.obj"], VIEW),
    "julius.obj": (["julius_noisy_0.2.obj"], View((0.0, 180.0, 0.0))),
    "nicolo.obj": (["nicolo_noisy_0.2.obj"], View()),
    "face_scan.obj": ([0.2], View()),
}


def draw_scans(data: Path, folder: Path) -> None:
    """Draw the test meshes, which are not for the page, before and after."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, (changes, view) in SCANS.items():
        pairs = [case_pair(data, (name, change)) for change in changes]
        rows = [shown(clean, noisy, view) for clean, noisy in pairs]
        sheet(TITLES, rows, 1).save(folder / f"{Path(name).stem}.png")
    name = "face_scan.obj"
    tiles, rows = jointly(*case_pair(data, (name, 0.2)), SCANS[name][1])
    sheet(JOINT_TITLES, [tiles], 1).save(folder / "joint.png")
    print(table(JOINT_HEAD, rows))
