# SPDX-License-Identifier: GPL-3.0-or-later
"""Speed of denoising surfaces, by the kind of noise."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import common
from report import Target, table, targets
from shock_filter import core
from virtual_scans import Scan, range_image, with_white_noise

RUNS = 3
MICROSECONDS = 40.0


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


def speed_of_kinds(job: common.Job) -> None:
    """Microseconds per vertex with the default settings, by the detected kind."""
    rows, goals = [], []
    for kind in kinds(job.data):
        count, seconds = common.in_own_process(time_kind, job.data, kind)
        each = 1e6 * seconds / count
        rows.append([kind, f"{count:,}", f"{each:.1f}"])
        goals.append(Target(f"{kind}: µs a vertex", each, MICROSECONDS, "{:.1f}"))
    text = [
        "The whole filter with its defaults, by the detected kind of surface: time summed over all"
        f" cores; least of {RUNS} runs. {common.machine()}",
        table(["surface", "vertices", "µs a vertex"], rows),
        targets(goals),
    ]
    job.page.write("kinds", "\n\n".join(text))
