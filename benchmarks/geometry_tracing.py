# SPDX-License-Identifier: GPL-3.0-or-later
"""The exact walk along flow-lines against literal walks in small steps."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import common
import literal_walk
import numpy as np
from literal_walk import PAPER_STEP
from report import Target, table, targets
from shock_filter import core
from shock_filter.core.flow.potential import flow_potential
from shock_filter.core.flow.trace import trace_faces
from shock_filter.core.mesh.calculus import average_to_vertices


def end_points(mesh: core.TriangleMesh, faces: np.ndarray, coordinates: np.ndarray) -> np.ndarray:
    """Place traced points in space, in mean edge lengths."""
    return np.einsum("fcx,fc->fx", mesh.scaled_vertices[mesh.faces[faces]], coordinates)


def walked(
    data: Path | None, times: Sequence[float], steps: Sequence[float]
) -> tuple[list[list[float]], list[list[float]]]:
    """Distances between the ends of exact and literal walks, by step and by flow time."""
    name, level = ("bunny.obj", 0) if data else (common.CREASED_SPHERE, 6)
    mesh = core.TriangleMesh(*common.load_mesh(data, name, level))
    signal = average_to_vertices(mesh, mesh.normals)
    potential = flow_potential(mesh, signal, 1)
    seeds = end_points(mesh, *trace_faces(mesh, potential, 0.0))
    literal_walk.trace_faces(mesh, potential, 1.0, PAPER_STEP)  # compiles

    def differences(flow_time: float, step: float) -> list[float]:
        exact = end_points(mesh, *trace_faces(mesh, potential, flow_time))
        literal = end_points(mesh, *literal_walk.trace_faces(mesh, potential, flow_time, step))
        apart = np.linalg.norm(exact - literal, axis=1)
        return [
            *(float(value) for value in (np.median(apart), apart.mean())),
            *(float(value) for value in np.percentile(apart, [90, 99])),
            float(np.linalg.norm(exact - seeds, axis=1).mean()),
            common.fastest(lambda: trace_faces(mesh, potential, flow_time), 3),
            common.fastest(lambda: literal_walk.trace_faces(mesh, potential, flow_time, step), 3),
        ]

    by_step = [differences(256.0, step) for step in steps]
    return by_step, [differences(flow_time, PAPER_STEP) for flow_time in times]


def tracing(job: common.Job) -> None:
    """The exact walk against literal ones."""
    steps = [0.3, PAPER_STEP, 0.03, 0.01, 0.003]
    by_step, by_time = common.in_own_process(walked, job.data, common.FLOW_TIMES, steps)
    head = ["median", "mean", "90 %", "99 %", "mean walk", "exact, s", "literal, s"]
    formats = ["{:.4f}", "{:.4f}", "{:.3f}", "{:.3f}", "{:.2f}", "{:.3f}", "{:.3f}"]

    def rows(first: Sequence[float], found: list[list[float]]) -> list[list[str]]:
        return [
            [f"{key:g}", *(form.format(value) for form, value in zip(formats, values, strict=True))]
            for key, values in zip(first, found, strict=True)
        ]

    name = "bunny" if job.data else common.CREASED_SPHERE
    slope = np.polyfit(np.log(steps), np.log([values[0] for values in by_step]), 1)[0]
    text = [
        f"{name}, one smoothing pass; distances in mean edge lengths. At t = 256, by the literal"
        " walk's step:",
        table(["step", *head], rows(steps, by_step)),
        f"The median falls as the {slope:.2f}th power of the step.",
        f"With the paper's step of {PAPER_STEP:g}, by flow time:",
        table(["t", *head], rows(common.FLOW_TIMES, by_time)),
        targets([Target("median at t = 256, the paper's step", by_step[1][0], 0.05, "{:.3f}")]),
    ]
    curves = {
        "mean": (steps, [values[1] for values in by_step]),
        "median": (steps, [values[0] for values in by_step]),
    }
    plot = job.page.plot(
        "tracing", curves, "step, mean edge lengths", "distance, mean edge lengths", "linear"
    )
    job.page.write("tracing", "\n\n".join(text) + plot)
