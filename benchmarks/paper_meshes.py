# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper's evaluation on meshes: Tables 2 and 3, Figures 7, 8 and 11, and MeshLab's colors."""

from __future__ import annotations

import functools
import math
import time
from pathlib import Path

import common
import numpy as np
import peers
import virtual_scans
from denoise_meshes import creased_sphere, with_noise
from geometry_speed import PAPER_POSITIONS, PAPER_REFIT, timed_flow, timed_run
from pictures import View, draw, sheet
from report import Target, table, targets
from scipy import ndimage
from shock_filter import core
from shock_filter.core.mesh.calculus import smooth_vertices

COLORED = ("dragon_50k.obj", 1)
PAPER_COLORS = {1.0: 0.2, 4.0: 0.2, 16.0: 0.2, 64.0: 0.3, 256.0: 0.3, 1024.0: 0.4, 4096.0: 0.5}
PASSES = [0, 1, 2, 4, 8, 16]
PAPER_PHASES = {
    "pre-processing": [1.9, 1.8, 1.8, 1.8, 1.8, 1.8],
    "flow": [0.2, 0.4, 0.6, 0.8, 1.4, 2.4],
    "advection": [0.9, 1.4, 1.6, 1.8, 2.1, 2.5],
    "fitting": [1.0, 1.1, 1.1, 1.1, 1.0, 1.1],
}
OUR_PHASES = {"mesh": 0, "refit: matrix": 0, "flow": 1, "features": 1, "tracing": 2}
PAPER_LIKE = {"feature_threshold": 0.0, "sampling": "linear"}
RUNS = 3
BLURRING_PASSES = 8


def projected_colors(data: Path, vertices: np.ndarray) -> np.ndarray:
    """Colors of a photo that is projected onto a mesh, float32 in [0, 1]."""
    photo = common.load_image(data, "kodim04.png").astype(np.float32) / 255
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    scale = min((photo.shape[1] - 1) / (high - low)[0], (photo.shape[0] - 1) / (high - low)[1])
    x = scale * (vertices[:, 0] - low[0])
    y = scale * (high[1] - vertices[:, 1])
    channels = [ndimage.map_coordinates(photo[..., c], (y, x), order=1) for c in range(3)]
    return np.stack(channels, axis=1)


def time_colors(path: Path, data: Path) -> list[float]:
    """Seconds to sharpen vertex colors, by flow time."""
    vertices, faces = common.read_mesh(path)
    mesh = core.TriangleMesh(vertices, faces)
    colors = projected_colors(data, vertices)
    core.sharpen_vertex_signal(mesh, colors)  # compiles
    seconds = []
    for flow_time in PAPER_COLORS:
        settings = core.ShockSettings(time=flow_time)
        run = functools.partial(core.sharpen_vertex_signal, mesh, colors, settings)
        seconds.append(common.fastest(run, RUNS))
    return seconds


def table2(job: common.Job) -> None:
    """Time of sharpening colors and normals as the flow time grows."""
    path, count = job.stored(*COLORED)
    colors = common.in_own_process(time_colors, path, job.data)
    large, large_count = job.stored("igea.ply", 2)
    runs = common.in_own_process(timed_flow, large, 0.0, RUNS)
    found = dict(zip(common.FLOW_TIMES, runs, strict=True))
    rows = [
        ["colors", "ours", f"{count:,}", *(f"{seconds:.3f}" for seconds in colors)],
        ["", "paper", "213 K", *(f"{seconds}" for seconds in PAPER_COLORS.values())],
        ["positions", "ours", f"{large_count:,}"]
        + [f"{found[flow_time]['whole']:.2f}" for flow_time in PAPER_POSITIONS],
        ["", "paper", "2 M", *(f"{seconds}" for seconds in PAPER_POSITIONS.values())],
    ]
    text = [
        f"Colors: {common.mesh_label(*COLORED)}, a photo projected onto it. Positions:"
        f" {common.mesh_label('igea.ply', 2)}, the normals only, without feature threshold, as the"
        f" paper counts them (its refit takes {PAPER_REFIT} s more). Mesh built before; seconds,"
        f" best of {RUNS} runs.",
        table(["", "", "vertices", *(f"t = {t:g}" for t in PAPER_COLORS)], rows, words=2),
        targets([Target(f"seconds, colors, {count:,} vertices, t = 4096", colors[-1], 0.5)]),
    ]
    job.page.write("table2", "\n\n".join(text))


def table3(job: common.Job) -> None:
    """Time of the phases as the smoothing passes grow."""
    path, count = job.stored("armadillo.obj", 2)
    columns = []
    for passes in PASSES:
        settings = core.GeometrySettings.of_paper(
            time=2048.0, smoothing_passes=passes, **PAPER_LIKE
        )
        phases, _, _ = common.in_own_process(timed_run, path, settings, RUNS)
        sums = [0.0] * len(PAPER_PHASES)
        for phase, seconds in phases.items():
            if phase != "whole":
                sums[OUR_PHASES.get(phase, 3)] += seconds
        columns.append(sums)
    rows = []
    for number, (phase, paper) in enumerate(PAPER_PHASES.items()):
        rows.append([phase, "ours", *(f"{column[number]:.2f}" for column in columns)])
        rows.append(["", "paper", *(f"{seconds:.1f}" for seconds in paper)])
    text = [
        f"{common.mesh_label('armadillo.obj', 2)}, {count:,} vertices (the paper's mesh: 656 K),"
        " t = 2048, linear sampling, no feature threshold; seconds by smoothing passes, best of"
        f" {RUNS} runs. Pre-processing is our mesh (connectivity, areas, frames) and the refit's"
        " matrix; fitting solves to our tolerance, the paper takes 25 iterations.",
        table(["", "", *map(str, PASSES)], rows, words=2),
    ]
    job.page.write("table3", "\n\n".join(text))


SPOT = virtual_scans.SPOT
NOISY_SHAPE = common.CREASED_SPHERE
VIEWS = {
    SPOT: View((-15.0, 140.0, 0.0)),
    NOISY_SHAPE: View((-25.0, 30.0, 0.0)),
}
PIXELS = 260


def _drawn(name: str, mesh: core.TriangleMesh, settings: list[dict], flow_time: float) -> list:
    """Pictures of a mesh and its sharpened versions."""
    shown = [draw(mesh, mesh, VIEWS[name], PIXELS)]
    for chosen in settings:
        options = core.GeometrySettings.of_paper(**({"time": flow_time} | PAPER_LIKE | chosen))
        moved = core.TriangleMesh(core.sharpen_geometry(mesh, options), mesh.faces)
        shown.append(draw(moved, mesh, VIEWS[name], PIXELS))
    return shown


def draw_samplings(data: Path) -> list[np.ndarray]:
    """Spot, and sharpened with nearest and linear sampling."""
    mesh = core.TriangleMesh(*common.load_mesh(data, SPOT))
    return _drawn(SPOT, mesh, [{"sampling": "nearest"}, {}], 256.0)


def figure7(job: common.Job) -> None:
    """Nearest and linear sampling."""
    titles = ["original", "nearest", "linear"]
    row = common.in_own_process(draw_samplings, job.data)
    about = f"A cow: {', '.join(titles)}"
    picture = job.page.picture("figure7", sheet(titles, [row], 1).quantize(64), about)
    job.page.write(
        "figure7",
        "Spot (Keenan Crane, CC0), t = 256, no feature threshold, one smoothing pass, flat-shaded."
        + picture,
    )


def draw_scan(data: Path) -> list[np.ndarray]:
    """A virtual scan of Spot, and its steady states."""
    scan = virtual_scans.range_image(data, SPOT, 170, 0.25, 1)
    return _drawn(SPOT, scan.mesh, [{}, {"mollify_passes": 2}], math.inf)


def figure8(job: common.Job) -> None:
    """The steady state of a noisy scan."""
    titles = ["scan", "steady state", "steady state, mollified"]
    row = common.in_own_process(draw_scan, job.data)
    about = f"A virtual scan of a cow: {', '.join(titles)}"
    picture = job.page.picture("figure8", sheet(titles, [row], 1).quantize(64), about)
    job.page.write(
        "figure8",
        "A virtual scan of Spot (Keenan Crane, CC0), t = ∞, no feature threshold, one smoothing"
        " pass, flat-shaded." + picture,
    )


def draw_noisy() -> list[list[np.ndarray]]:
    """A creased shape with little and much noise: noisy, plainly sharpened, mollified."""
    clean = creased_sphere(5)
    noisy = [with_noise(clean, amount) for amount in (0.1, 0.3)]
    return [_drawn(NOISY_SHAPE, mesh, [{}, {"mollify_passes": 2}], 1024.0) for mesh in noisy]


def figure11(job: common.Job) -> None:
    """Noisy meshes, with and without mollified normals."""
    titles = ["noisy", "plain", "mollified"]
    rows = common.in_own_process(draw_noisy)
    about = f"A creased shape: {', '.join(titles)}"
    picture = job.page.picture("figure11", sheet(titles, rows, 1).quantize(64), about)
    job.page.write(
        "figure11",
        "A shape made by code with noise of 0.1 (top) and 0.3 (bottom) mean edge lengths,"
        " t = 1024; mollified: two smoothing passes on the normals first." + picture,
    )


def striped_colors(mesh: core.TriangleMesh) -> np.ndarray:
    """Sharp stripes, 40 mean edge lengths apart, in each channel along another axis."""
    return np.where(np.sin(mesh.scaled_vertices * (2 * math.pi / 40)) > 0, 0.8, 0.2)


def color_quality(path: Path, data: Path) -> dict[str, list[list[str]]]:
    """Rows for two sets of vertex colors."""
    vertices, faces = common.read_mesh(path)
    mesh = core.TriangleMesh(vertices, faces)
    return {
        "sharp stripes in each channel, 40 mean edge lengths apart": color_rows(
            mesh, striped_colors(mesh)
        ),
        "a projected photo": color_rows(mesh, projected_colors(data, vertices).astype(np.float64)),
    }


def color_rows(mesh: core.TriangleMesh, sharp: np.ndarray) -> list[list[str]]:
    """Rows on blurred vertex colors: ours and MeshLab's unsharp mask."""
    given = np.rint(255 * smooth_vertices(mesh, sharp, BLURRING_PASSES)) / 255
    results = {"blurred input": (given, math.nan)}
    for flow_time in (256.0, 1024.0, 4096.0):
        settings = core.ShockSettings(time=flow_time)
        core.sharpen_vertex_signal(mesh, given, settings)
        start = time.perf_counter()
        result = core.sharpen_vertex_signal(mesh, given, settings)
        results[f"Shock Filter, t = {flow_time:g}"] = (result, time.perf_counter() - start)
    if peers.installed("MeshLab"):
        results["MeshLab color unsharp mask"] = meshlab_unsharp(mesh.vertices, mesh.faces, given)
    slope = np.percentile(_slopes(mesh, sharp), 95)
    low, high = _ranges(mesh, given)
    rows = []
    for name, (result, seconds) in results.items():
        levels = 255 * np.maximum(np.maximum(low - result, result - high), 0)
        outside = levels > 0.5
        error = ((result - sharp) ** 2).mean()
        rows.append(
            [
                name,
                "" if math.isnan(seconds) else f"{seconds:.2f}",
                f"{outside.mean():.1%}",
                f"{levels[outside].mean() if outside.any() else 0.0:.1f}",
                f"{np.percentile(_slopes(mesh, result), 95) / slope:.2f}",
                f"{-10 * np.log10(error):.2f}",
            ]
        )
    return rows


def _slopes(mesh: core.TriangleMesh, signal: np.ndarray) -> np.ndarray:
    ends = mesh.faces, np.roll(mesh.faces, 1, axis=1)
    return np.sqrt(((signal[ends[0]] - signal[ends[1]]) ** 2).sum(axis=2)).max(axis=1)


def _ranges(mesh: core.TriangleMesh, signal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    low, high = signal, signal
    for _ in range(2):  # rings
        rings = low.copy(), high.copy()
        for corner in mesh.faces.T:
            for other in mesh.faces.T:
                np.minimum.at(rings[0], corner, low[other])
                np.maximum.at(rings[1], corner, high[other])
        low, high = rings
    return low, high


def meshlab_unsharp(
    vertices: np.ndarray, faces: np.ndarray, colors: np.ndarray
) -> tuple[np.ndarray, float]:
    """MeshLab's unsharp mask of vertex colors at its defaults; the result and its seconds."""
    import pymeshlab

    opaque = np.concatenate([colors, np.ones((len(colors), 1))], axis=1)
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(vertices, faces, v_color_matrix=opaque))
    start = time.perf_counter()
    meshes.apply_color_unsharp_mask_per_vertex()
    seconds = time.perf_counter() - start
    return meshes.current_mesh().vertex_color_matrix()[:, :3], seconds


def color_peers(job: common.Job) -> None:
    """MeshLab's unsharp mask of vertex colors."""
    path, count = job.stored(*COLORED)
    found = common.in_own_process(color_quality, path, job.data)
    text = [
        f"Vertex colors on {common.mesh_label(*COLORED)}, {count:,} vertices, blurred by"
        f" {BLURRING_PASSES} smoothing passes. *Outside*: the range of the input within two"
        " rings; *slope*: the 95th percentile of a face's greatest difference of colors over the"
        " sharp colors'. MeshLab at its defaults.",
    ]
    for colors, rows in found.items():
        text.append(f"The colors are {colors}:")
        text.append(table(["filter", "seconds", "outside", "by levels", "slope", "PSNR, dB"], rows))
    job.page.write("colors", "\n\n".join(text))
