# SPDX-License-Identifier: GPL-3.0-or-later
"""Speed of denoising surfaces, by the kind of noise; and of its kernel, beside the earlier way."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import common
import numpy as np
from report import Target, table, targets
from shock_filter import core
from shock_filter.core.beltrami.mesh_smoothing import smooth_faces, smooth_graph
from shock_filter.core.mesh.calculus import average_to_faces
from shock_filter.core.mesh.geodesics import face_stencils
from virtual_scans import Scan, range_image, with_white_noise

RUNS = 3
MICROSECONDS, SHARE = 40.0, 0.5


def kinds(data: Path | None) -> dict[str, Callable[[], Scan]]:
    """A surface of each kind that denoising tells apart."""
    head, bust = ("igea.ply", "julius.obj") if data else ("boulder", "boulder")
    return {
        "white noise": lambda: with_white_noise(data, head, 0.1, 1),
        "scan of a part": lambda: range_image(data, "gear", 400, 0.25, 1),
        "scan of relief": lambda: range_image(data, bust, 400, 0.15, 1),
    }


def time_kind(data: Path | None, kind: str) -> tuple[int, float]:
    """Vertices of a surface, and least seconds of all cores together."""
    mesh = kinds(data)[kind]().mesh
    found = []
    for _ in range(RUNS + 1):  # the first compiles
        fresh = core.TriangleMesh(mesh.vertices, mesh.faces)
        before = time.process_time()
        core.denoise_geometry(fresh)
        found.append(time.process_time() - before)
    return mesh.vertex_count, min(found[1:])


def time_kernel(data: Path | None) -> tuple[float, float]:
    """Seconds of one kernel over the faces by searches, and by marches that sort, by turns."""
    mesh = kinds(data)["white noise"]().mesh
    settings, normals = core.BeltramiGeometrySettings(), mesh.normals
    centres = average_to_faces(mesh, mesh.scaled_vertices)
    beta = 3.0

    def by_search() -> None:
        smooth_faces(mesh, centres, normals, beta, normals, settings)

    def by_march() -> None:
        embedding = np.concatenate([centres, beta * normals], axis=1)
        graph = face_stencils(mesh, embedding)
        smooth_graph(graph, embedding, mesh.areas, normals, settings, mesh.has_hubs)

    by_search(), by_march()  # compiles
    pairs = [(common.fastest(by_search, 1), common.fastest(by_march, 1)) for _ in range(RUNS)]
    new, old = np.min(pairs, axis=0)
    return float(new), float(old)


def speed_of_kinds(job: common.Job) -> None:
    """Microseconds a vertex of the default, by what it finds."""
    rows, goals = [], []
    for kind in kinds(job.data):
        count, seconds = common.in_own_process(time_kind, job.data, kind)
        each = 1e6 * seconds / count
        rows.append([kind, f"{count:,}", f"{each:.1f}"])
        goals.append(Target(f"{kind}: µs a vertex", each, MICROSECONDS, "{:.1f}"))
    new, old = common.in_own_process(time_kernel, job.data)
    goals.append(Target("kernel over the faces: by searches / by marches", new / old, SHARE))
    text = [
        "The whole filter with its defaults, by what it finds: time of all cores together, which"
        f" share it evenly; least of {RUNS} runs. *Searches* take faces in the order in which they"
        " are come to; *marches*, as earlier versions did, keep them sorted."
        f" {common.machine()}",
        table(["surface", "vertices", "µs a vertex"], rows),
        targets(goals),
    ]
    job.page.write("kinds", "\n\n".join(text))
