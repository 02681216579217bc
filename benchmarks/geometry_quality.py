# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors of sharpened meshes, by Shock Filter and by other programs."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import common
import numpy as np
import peers
from report import Target, table, targets
from shock_filter import core
from shock_filter.core.flow.potential import flow_potential
from shock_filter.core.mesh.calculus import average_to_vertices, smooth_vertices
from shock_filter.core.settings import OF_PAPER

SOFTENED = [
    *(("fandisk.obj", passes) for passes in (1, 3, 10)),
    *(("block.obj", passes) for passes in (1, 3, 10)),
    ("sharp_sphere.obj", 3),
    ("lion_statue.obj", 3),
    ("julius.obj", 3),
    ("nicolo.obj", 3),
    ("casting.off", 3),
    ("conrod.stl", 3),
]
NOISY = [
    ("fandisk.obj", "fandisk_noisy_0.3.obj"),
    ("block.obj", "block_noisy_0.4.obj"),
    ("sharp_sphere.obj", "sharp_sphere_noisy_0.3.obj"),
    ("julius.obj", "julius_noisy_0.2.obj"),
    ("nicolo.obj", "nicolo_noisy_0.2.obj"),
]
OURS = {
    "ours": {},
    "ours, one step everywhere": OF_PAPER,
    "ours, the paper's settings": {**OF_PAPER, "sampling": "linear", "feature_threshold": 0.0},
}
DENOISING = {**OF_PAPER, "mollify_passes": 2, "repeat": 5}

Case = tuple[str, str | int]


@dataclass(frozen=True, order=True)
class Errors:
    """How far a mesh is from the clean one: degrees, mean edge lengths; ordered by the first."""

    normal: float
    position: float


def case_meshes(data: Path | None, case: Case) -> tuple[core.TriangleMesh, core.TriangleMesh]:
    """Return the clean mesh and its noisy (a file) or softened (a number of passes) version."""
    name, change = case
    clean = core.TriangleMesh(*common.load_mesh(data, name, 0 if data else 5))
    if isinstance(change, str):
        return clean, core.TriangleMesh(common.load_mesh(data, change)[0], clean.faces)
    return clean, core.TriangleMesh(smooth_vertices(clean, clean.vertices, change), clean.faces)


def errors(positions: np.ndarray, clean: core.TriangleMesh) -> Errors:
    """Return normal and position error of new positions."""
    mesh = core.TriangleMesh(positions, clean.faces)
    return Errors(common.normal_error(mesh, clean), common.position_error(mesh, clean))


def quality_of_input(data: Path | None, cases: list[Case]) -> list[Errors]:
    """Errors before sharpening."""
    return [
        errors(mesh.vertices, clean) for clean, mesh in (case_meshes(data, case) for case in cases)
    ]


def bending(data: Path | None, cases: list[Case]) -> list[list[float]]:
    """Bending of clean and changed meshes, in radians per edge at the median vertex."""

    def median(mesh: core.TriangleMesh) -> float:
        signal = average_to_vertices(mesh, mesh.normals)
        return float(np.median(np.sqrt(flow_potential(mesh, signal, 1))))

    return [[median(mesh) for mesh in case_meshes(data, case)] for case in cases]


def quality_of_ours(data: Path | None, cases: list[Case], settings: dict) -> list[Errors]:
    """Errors after sharpening with given settings."""
    found = []
    for case in cases:
        clean, mesh = case_meshes(data, case)
        sharp = core.sharpen_geometry(mesh, core.GeometrySettings(**settings))
        found.append(errors(sharp, clean))
    return found


def quality_of_peer(data: Path | None, cases: list[Case], title: str) -> list[tuple[Errors, str]]:
    """Least normal error over a peer's tried settings, and the settings that gave it."""
    program, name, tried = peers.TRIED[title]
    found = []
    for case in cases:
        clean, mesh = case_meshes(data, case)
        results = []
        for settings in tried:
            positions, _ = peers.apply(program, name, settings, mesh.vertices, mesh.faces)
            if np.isfinite(positions).all():
                results.append((errors(positions, clean), short(settings)))
        found.append(min(results, default=(Errors(math.nan, math.nan), "no setting")))
    return found


def short(settings: peers.Settings) -> str:
    """Write a peer's settings on a line."""
    return ", ".join(
        f"{name} {value:g}" if isinstance(value, (int, float)) else f"{value}"
        for name, value in settings.items()
    )


def case_label(case: Case) -> str:
    """Name a case in a table."""
    name, change = case
    if isinstance(change, str):
        return Path(change).stem.replace("_noisy_", ", noise ")
    return f"{Path(name).stem}, {change} pass{'es' if change > 1 else ''}"


def error_table(cases: list[Case], columns: dict[str, list[Errors]], field: str, form: str) -> str:
    """Lay out one kind of error: the input's, then each method's with its change in percent."""
    rows = []
    for i, case in enumerate(cases):
        before, *after = (getattr(column[i], field) for column in columns.values())
        changed = [f"{form.format(value)} ({value / before - 1:+.0%})" for value in after]
        rows.append([case_label(case), form.format(before), *changed])
    return table(["mesh", *columns], rows)


@dataclass(frozen=True)
class Comparison:
    """Errors by method and case, and the settings that were tried for the others."""

    cases: list[Case]
    columns: dict[str, list[Errors]]
    tried: list[list[str]]

    def text(self) -> str:
        """Lay out the tables."""
        parts = [
            "Mean angle to the clean normals, degrees:",
            error_table(self.cases, self.columns, "normal", "{:.2f}"),
            "Distance to the clean positions (root mean square), mean edge lengths:",
            error_table(self.cases, self.columns, "position", "{:.3f}"),
        ]
        if self.tried:
            parts += [
                "<details><summary>Settings tried for the others</summary>",
                table(["filter", "settings", "best on"], self.tried, words=3),
                "</details>",
            ]
        return "\n\n".join(parts)


def compare(data: Path | None, cases: list[Case], ours: dict[str, dict]) -> Comparison:
    """Measure all methods on all cases, each method in its own process."""
    columns = {"input": common.in_own_process(quality_of_input, data, cases)}
    for title, settings in ours.items():
        columns[title] = common.in_own_process(quality_of_ours, data, cases, settings)
    tried = []
    for title, (program, _, candidates) in peers.TRIED.items():
        if not peers.installed(program):
            continue
        found = common.in_own_process(quality_of_peer, data, cases, title)
        columns[title] = [after for after, _ in found]
        for settings in map(short, candidates):
            pairs = zip(cases, found, strict=True)
            best = [case_label(case) for case, (_, won) in pairs if won == settings]
            tried.append([title, settings, "; ".join(best)])
    return Comparison(cases, columns, tried)


def goals(comparison: Comparison) -> Iterable[Target]:
    """Check the targets for three smoothing passes."""
    before, after = comparison.columns["input"], comparison.columns["ours"]
    for case, old, new in zip(comparison.cases, before, after, strict=True):
        label = case_label(case)
        if case in (("fandisk.obj", 3), ("block.obj", 3)):
            yield Target(f"{label}: normal error / input's", new.normal / old.normal, 0.55)
            yield Target(f"{label}: distance / input's", new.position / old.position, 1.5)
        if case in (("sharp_sphere.obj", 3), ("lion_statue.obj", 3)):
            yield Target(f"{label}: normal error / input's", new.normal / old.normal, 1.4)


def quality(job: common.Job) -> None:
    """Errors against ground truth: softened meshes, then noisy ones."""
    if not job.data:
        spheres: list[Case] = [(common.CREASED_SPHERE, passes) for passes in (1, 3, 10)]
        job.page.write("quality", compare(None, spheres, OURS).text())
        return
    softened = compare(job.data, SOFTENED, OURS)
    job.page.write("quality", softened.text() + "\n\n" + targets(goals(softened)))
    bends = common.in_own_process(bending, job.data, SOFTENED)
    pairs = zip(SOFTENED, bends, strict=True)
    rows = [[case_label(case), *map("{:.2f}".format, row)] for case, row in pairs]
    job.page.write("bend", table(["mesh", "clean", "softened"], rows))
    job.page.write("noise", compare(job.data, NOISY, {"ours": DENOISING}).text())
