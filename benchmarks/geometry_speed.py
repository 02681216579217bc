# SPDX-License-Identifier: GPL-3.0-or-later
"""Speed and memory of sharpening geometry: by size, by flow time, beside other programs."""

from __future__ import annotations

import time
from pathlib import Path

import common
import numpy as np
import peers
from report import Target, table, targets
from shock_filter import core

LONG = 4096.0
MEBIBYTE = 2.0**20

PHASES = {
    "Sharpening": "flow",
    "Computing the flow": "flow",
    "Smoothing": "flow",
    "Finding features": "features",
    "Tracing flow-lines": "tracing",
    "Preparing the refit": "refit: matrix",
    "Fitting the surface": "refit: solve",
}

# Prada and Kazhdan 2015, Table 2, "Positions": seconds at 2 M vertices on 8 threads; the refit
# takes PAPER_REFIT more.
PAPER_POSITIONS = {1.0: 1.7, 4.0: 1.8, 16.0: 1.9, 64.0: 2.2, 256.0: 2.7, 1024.0: 3.2, 4096.0: 3.5}
PAPER_REFIT = 9.3


def warm_up(settings: core.GeometrySettings) -> None:
    """Load or compile all kernels on a tiny mesh."""
    tiny = core.TriangleMesh(*common.load_mesh(None, common.CREASED_SPHERE, 2))
    core.sharpen_geometry(tiny, settings)


def timed_run(
    path: Path, settings: core.GeometrySettings, runs: int
) -> tuple[dict[str, float], int, int]:
    """Sharpen a stored mesh: phases of the fastest run; memory before, and at the most."""
    warm_up(settings)
    vertices, faces = common.read_mesh(path)
    before = common.peak_memory()
    peak = 0
    best: dict[str, float] = {}
    for _ in range(runs):
        start = time.perf_counter()
        mesh = core.TriangleMesh(vertices, faces)
        built = time.perf_counter() - start
        clock = common.PhaseClock(PHASES)
        core.sharpen_geometry(mesh, settings, progress=clock)
        phases = {"mesh": built, **clock.stop()}
        phases["whole"] = time.perf_counter() - start
        peak = peak or common.peak_memory()  # later runs find the heap fragmented
        if not best or phases["whole"] < best["whole"]:
            best = phases
        del mesh
    return best, before, peak


def speed(job: common.Job) -> None:
    """Phase times and memory at growing sizes."""
    settings = core.GeometrySettings.of_paper(time=LONG)
    rows, sizes, wholes = [], [], []
    for name, subdivisions in job.scaling_meshes():
        path, count = job.stored(name, subdivisions)
        phases, before, peak = common.in_own_process(timed_run, path, settings, 3)
        sizes.append(count)
        wholes.append(phases["whole"])
        rows.append([common.mesh_label(name, subdivisions), f"{count:,}"])
        rows[-1] += [f"{seconds:.3f}" for seconds in phases.values()]
        rows[-1] += [
            f"{1e6 * phases['whole'] / count:.2f}",
            f"{peak / MEBIBYTE:.0f}",
            f"{(peak - before) / count:.0f}",
        ]
    head = ["mesh", "vertices", *(f"{phase}, s" for phase in phases)]
    head += ["µs per vertex", "peak, MiB", "bytes per vertex"]
    slope = float(np.polyfit(np.log(sizes), np.log(wholes), 1)[0])

    name, subdivisions = job.scaling_meshes()[2]
    path, count = job.stored(name, subdivisions, True)
    mixed = common.in_own_process(timed_run, path, settings, 3)[0]["whole"]
    text = [
        f"Time t = {LONG:g}, one smoothing pass, otherwise the paper's filter with a threshold"
        " (`GeometrySettings.of_paper`); best of three runs.",
        table(head, rows),
        f"Over these sizes time grows as the {slope:.2f}th power of the number of vertices (1 is"
        f" linear). With vertices and faces in random order the mesh of {count:,} vertices takes"
        f" {mixed:.2f} s instead of {wholes[2]:.2f} s ({mixed / wholes[2]:.1f} times).",
        targets(
            [
                Target(f"seconds at {sizes[3]:,} vertices", wholes[3], 4.5),
                Target(f"GiB at the most, {sizes[3]:,} vertices", peak / 1024**3, 2.5),
            ]
        ),
    ]
    plot = job.page.plot(
        "speed", {"whole filter": (sizes, wholes)}, "vertices", "seconds", "linear growth"
    )
    job.page.write("speed", "\n\n".join(text) + plot)


def timed_flow(path: Path, threshold: float, runs: int) -> list[dict[str, float]]:
    """Sharpen a stored mesh's normals for each flow time: phases of the fastest run."""
    mesh = core.TriangleMesh(*common.read_mesh(path))
    found = []
    for flow_time in [common.FLOW_TIMES[0], *common.FLOW_TIMES]:
        settings = core.GeometrySettings.of_paper(time=flow_time, feature_threshold=threshold)
        best: dict[str, float] = {}
        for _ in range(runs):
            clock = common.PhaseClock(PHASES)
            start = time.perf_counter()
            core.sharpen_normals(mesh, settings, progress=clock)
            phases = {**clock.stop(), "whole": time.perf_counter() - start}
            if not best or phases["whole"] < best["whole"]:
                best = phases
        found.append(best)
    return found[1:]  # the first one warmed up


def growth_with_time(job: common.Job) -> None:
    """Cost of the flow and its tracing as the flow time grows, with and without the threshold."""
    name, subdivisions = job.scaling_meshes()[3]
    path, count = job.stored(name, subdivisions)
    threshold = core.GeometrySettings().feature_threshold
    found = common.in_own_process(timed_flow, path, threshold, 3)
    paper_like = common.in_own_process(timed_flow, path, 0.0, 3)
    rows = []
    for flow_time, phases, plain in zip(common.FLOW_TIMES, found, paper_like, strict=True):
        row = [*phases.values(), plain["tracing"], plain["whole"]]
        paper = PAPER_POSITIONS.get(flow_time, "")
        rows.append([f"{flow_time:g}", *(f"{seconds:.2f}" for seconds in row), f"{paper}"])
    head = ["t", *(f"{phase}, s" for phase in found[0])]
    head += ["no threshold: tracing, s", "no threshold: whole, s", "paper, s"]
    last = common.FLOW_TIMES.index(LONG)
    growth_paper = PAPER_POSITIONS[LONG] / PAPER_POSITIONS[1.0]
    text = [
        f"{common.mesh_label(name, subdivisions)}, {count:,} vertices; mesh built before; best of"
        " three runs.",
        table(head, rows),
        "The paper's column is its Table 2, positions of a mesh of 2 M vertices, on 8 threads and"
        f" other hardware; its refit takes {PAPER_REFIT} s more. There t = {LONG:g} costs"
        f" {growth_paper:.1f} times t = 1.",
        targets(
            [
                Target(
                    f"t = {LONG:g} / t = 1, {label}", runs[last]["whole"] / runs[0]["whole"], 2.5
                )
                for label, runs in (("defaults", found), ("no threshold", paper_like))
            ]
        ),
    ]
    finite = common.FLOW_TIMES[:-1]
    curves = {
        "paper, 2 M vertices, 8 threads": (list(PAPER_POSITIONS), list(PAPER_POSITIONS.values())),
        "ours without threshold": (finite, [phases["whole"] for phases in paper_like[:-1]]),
        "ours": (finite, [phases["whole"] for phases in found[:-1]]),
    }
    plot = job.page.plot("time", curves, "flow time t", "seconds, without the refit")
    job.page.write("time", "\n\n".join(text) + plot)


RIVALS = [
    (
        "Lagrange mesh_smoothing, normals",
        "Lagrange",
        "mesh_smoothing",
        {"method": "NormalSmoothing"},
    ),
    (
        "Lagrange mesh_smoothing, vertices",
        "Lagrange",
        "mesh_smoothing",
        {"method": "VertexSmoothing"},
    ),
    ("MeshLab two-step smoothing", "MeshLab", "apply_coord_two_steps_smoothing", {}),
    ("MeshLab unsharp mask", "MeshLab", "apply_coord_unsharp_mask", {}),
]


def timed_peer(path: Path, program: str, name: str, settings: peers.Settings, runs: int) -> float:
    """Seconds of a peer's fastest run on a stored mesh."""
    mesh = common.read_mesh(path)
    return min(peers.apply(program, name, settings, *mesh)[1] for _ in range(runs))


def peer_speed(job: common.Job) -> None:
    """Other programs on the same meshes in the same run."""
    meshes = [("nicolo.obj", 1), ("nicolo.obj", 2), ("igea.ply", 0)]
    meshes += [("dragon_50k.obj", 0), ("dragon_50k.obj", 1)]
    if not job.data:
        meshes = [(common.CREASED_SPHERE, 6), (common.CREASED_SPHERE, 7)]
    if job.everything:
        meshes.append((meshes[0][0], meshes[-1][1] + 1))
    rivals = [rival for rival in RIVALS if peers.installed(rival[1])]
    rows, goals = [], []
    for name, level in meshes:
        path, count = job.stored(name, level)
        label = [common.mesh_label(name, level), f"{count:,}"]
        ours = {
            flow_time: common.in_own_process(
                timed_run, path, core.GeometrySettings.of_paper(time=flow_time), 3
            )[0]["whole"]
            for flow_time in (core.GeometrySettings().time, LONG)
        }
        for flow_time, seconds in ours.items():
            rows.append([*label, f"Shock Filter, t = {flow_time:g}", f"{seconds:.2f}", ""])
        slower = {}
        for title, program, method, settings in rivals:
            seconds = common.in_own_process(
                timed_peer, path, program, method, settings, 3 if count < 100_000 else 1
            )
            slower[title] = seconds / ours[core.GeometrySettings().time]
            rows.append([*label, title, f"{seconds:.2f}", f"{slower[title]:.1f}"])
        if RIVALS[0][0] in slower:
            what = f"{label[0]}, {count:,} vertices: times faster than Lagrange on normals"
            bound = 30 if count >= 200_000 else 10
            goals.append(Target(what, slower[RIVALS[0][0]], bound, "{:.1f}", at_least=True))
    text = [
        "All at their defaults. Ours: mesh and all, best of three runs. The others: the filter"
        " alone, best of three runs up to a hundred thousand vertices and one run beyond.",
        table(["mesh", "vertices", "filter", "seconds", "times our default"], rows),
    ]
    job.page.write("peers", "\n\n".join([*text, targets(goals)] if goals else text))
