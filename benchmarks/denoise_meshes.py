# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors of denoised meshes, by Shock Filter and by other programs."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import common
import numpy as np
import peers
import variants
from geometry_quality import (
    DENOISING,
    NOISY,
    Errors,
    case_label,
    case_meshes,
    errors,
    short,
)
from report import Target, table, targets
from shock_filter import core
from shock_filter.core.mesh.calculus import average_to_vertices

CASES = [NOISY[0], ("fandisk.obj", "fandisk_noisy_0.7.obj"), *NOISY[1:]]
FANDISK = "fandisk.obj"
PAIR_NORMAL, PAIR_POSITION = 4.0, 0.2

Filter = Callable[[core.TriangleMesh], np.ndarray]


def denoised(mesh: core.TriangleMesh, distance: str = "", **settings: object) -> np.ndarray:
    """Denoise; by the kernel of the paper, if its distance or settings are given."""
    if not distance and not settings:
        return core.denoise_geometry(mesh)
    with variants.distances(distance or "geodesic"):
        kernel = core.BeltramiGeometrySettings(method="beltrami", **settings)
        return core.denoise_geometry(mesh, kernel)


def sharpened(mesh: core.TriangleMesh, **settings: object) -> np.ndarray:
    """Sharpen as in the paper, which removes noise everywhere."""
    return core.sharpen_geometry(mesh, core.GeometrySettings.of_paper(**settings))


def cleaned(mesh: core.TriangleMesh) -> core.TriangleMesh:
    """Denoise with the defaults."""
    return core.TriangleMesh(denoised(mesh), mesh.faces)


OURS: dict[str, Filter] = {
    "input": lambda mesh: mesh.vertices,
    "ours, default": denoised,
    "ours, kernel": lambda mesh: denoised(mesh, distance="geodesic"),
    "ours, euclidean": lambda mesh: denoised(mesh, distance="euclidean"),
    "ours, euclidean, time 0.35": lambda mesh: denoised(mesh, distance="euclidean", time=0.35),
    "ours, positions": lambda mesh: denoised(mesh, filtered="positions"),
    "ours, then sharpen at the default": lambda mesh: core.sharpen_geometry(cleaned(mesh)),
    "ours, then sharpen": lambda mesh: sharpened(cleaned(mesh)),
    "ours, then sharpen, linear": lambda mesh: sharpened(cleaned(mesh), sampling="linear"),
    "shock filter alone, mollified": lambda mesh: sharpened(mesh, **DENOISING),
}
BEST = "ours, best"
TRIED = [
    {},
    {"time": 1.0},
    {"time": 1.0, "beta": 1.3},
    {"mollify_passes": 2},
    {"distance": "euclidean"},
    {"distance": "euclidean", "time": 0.35},
    {"distance": "euclidean", "time": 0.25},
]
SWEPT = [
    {},
    {"time": 0.25},
    {"time": 1.0},
    {"beta": 1.3},
    {"distance": "euclidean", "time": 0.35},
]
AMOUNTS = [0.0, 0.05, 0.1, 0.2, 0.3]

Case = tuple[str, str | float]
"""A mesh, and the file of its noisy version or the noise to be added."""


def creased_sphere(level: int) -> core.TriangleMesh:
    """The shape made by code."""
    return core.TriangleMesh(*common.load_mesh(None, common.CREASED_SPHERE, level))


def with_noise(mesh: core.TriangleMesh, amount: float) -> core.TriangleMesh:
    """Move vertices along their normals by normally distributed steps, in mean edge lengths."""
    along = average_to_vertices(mesh, mesh.normals)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    steps = np.random.default_rng(0).normal(0, amount, (mesh.vertex_count, 1))
    return core.TriangleMesh(mesh.vertices + mesh.mean_edge_length * steps * along, mesh.faces)


def case_pair(data: Path | None, case: Case) -> tuple[core.TriangleMesh, core.TriangleMesh]:
    """Return a clean mesh and its noisy version."""
    name, change = case
    if isinstance(change, str):
        return case_meshes(data, (name, change))
    clean = core.TriangleMesh(*common.load_mesh(data, name, 0 if data else 5))
    return clean, with_noise(clean, change)


def label_of(case: Case) -> str:
    """Name a case in a table."""
    name, change = case
    return case_label(case) if isinstance(change, str) else f"{Path(name).stem}, noise {change:g}"


def quality_of(data: Path | None, cases: list[Case], title: str) -> list[Errors]:
    """Errors after one of our filters."""
    found = []
    for case in cases:
        clean, mesh = case_pair(data, case)
        found.append(errors(OURS[title](mesh), clean))
    return found


def quality_of_best(
    data: Path | None, cases: list[Case], tried: list[dict]
) -> list[list[tuple[Errors, str]]]:
    """Errors of all settings that we try, the defaults first."""
    found = []
    for case in cases:
        clean, mesh = case_pair(data, case)
        found.append([(errors(denoised(mesh, **chosen), clean), short(chosen)) for chosen in tried])
    return found


def quality_of_other(data: Path | None, cases: list[Case], title: str) -> list[tuple[Errors, str]]:
    """Least normal error over another program's settings, and which ones gave it."""
    program, name, tried = peers.DENOISERS[title]
    found = []
    for case in cases:
        clean, mesh = case_pair(data, case)
        results = []
        for settings in tried:
            chosen = {key: value for key, value in settings.items() if key != "times"}
            positions = mesh.vertices
            for _ in range(settings.get("times", 1)):
                positions, _ = peers.apply(program, name, chosen, positions, mesh.faces)
            if np.isfinite(positions).all():
                results.append((errors(positions, clean), short(settings)))
        found.append(min(results, default=(Errors(math.nan, math.nan), "none")))
    return found


def meshes(job: common.Job) -> None:
    """Normal and position errors of all methods on all pairs."""
    cases: list[Case] = CASES if job.data else [(common.CREASED_SPHERE, 0.3)]
    columns, settings = {}, []
    for title in OURS:
        columns[title] = common.in_own_process(quality_of, job.data, cases, title)
    tried = common.in_own_process(quality_of_best, job.data, cases, TRIED)
    found = {BEST: [min(results) for results in tried]}
    for title, (program, _, _) in peers.DENOISERS.items():
        if peers.installed(program):
            found[title] = common.in_own_process(quality_of_other, job.data, cases, title)
    for title, results in found.items():
        columns[title] = [after for after, _ in results]
        settings.append([title, *(chosen or "default" for _, chosen in results)])
    labels = [label_of(case) for case in cases]
    text = [
        "Mean angle to the clean normals, degrees. *Best* and the other programs: the settings of"
        " a coarse search that come nearest to the clean normals of each mesh; all else is one"
        " set of settings for all meshes.",
        error_rows(labels, columns, "normal", "{:.2f}"),
        "Distance to the clean positions (root mean square), mean edge lengths:",
        error_rows(labels, columns, "position", "{:.3f}"),
        behind(labels, columns),
        "<details><summary>The best settings</summary>",
        table(["filter", *labels], settings, words=len(labels) + 1),
        "</details>",
    ]
    if job.data:
        text.append(pair_text(columns))
    job.page.write("meshes", "\n\n".join(text))


def error_rows(labels: list[str], columns: dict[str, list[Errors]], field: str, form: str) -> str:
    """Lay out one kind of error, a method a row; the least one of each mesh is bold."""
    values = np.array([[getattr(e, field) for e in several] for several in columns.values()])
    least = np.nanmin(values, axis=0)
    rows = []
    for title, line in zip(columns, values, strict=True):
        shown = map(form.format, line)
        pairs = zip(shown, line == least, strict=True)
        rows.append([title, *(f"**{text}**" if best else text for text, best in pairs)])
    return table(["filter", *labels], rows)


def behind(labels: list[str], columns: dict[str, list[Errors]]) -> str:
    """List the cases where another program, with its best settings, beats our default."""
    lines = []
    for i, label in enumerate(labels):
        for field, what in (("normal", "normals"), ("position", "positions")):
            mine = getattr(columns["ours, default"][i], field)
            better = [
                title
                for title in peers.DENOISERS
                if title in columns and getattr(columns[title][i], field) < mine
            ]
            if better:
                lines.append(f"{label}, {what}: {', '.join(better)}")
    if not lines:
        return "No other program beats our default on any of these meshes."
    return "Other programs beat our default here: " + "; ".join(lines) + "."


def pair_text(columns: dict[str, list[Errors]]) -> str:
    """The result on fandisk with noise 0.3."""
    rows = [
        [title, f"{several[0].normal:.1f}", f"{several[0].position:.2f}"]
        for title, several in columns.items()
    ]
    rows.sort(key=lambda row: float(row[1]))
    goals = []
    for title in ("ours, then sharpen", "ours, then sharpen, linear"):
        goals.append(Target(f"{title}: degrees", columns[title][0].normal, PAIR_NORMAL))
        goals.append(Target(f"{title}: edge lengths", columns[title][0].position, PAIR_POSITION))
    reached = [title for title, several in columns.items() if several[0].normal <= 3.0]
    return "\n\n".join(
        [
            "Fandisk with noise 0.3, all in one list.",
            table(["filter", "degrees", "edge lengths"], rows),
            targets(goals),
            f"3 degrees or better: {', '.join(reached) or 'none'}.",
        ]
    )


def noise(job: common.Job) -> None:
    """The default settings from no noise to much, beside other settings."""
    names = [FANDISK, "nicolo.obj"] if job.data else [common.CREASED_SPHERE]
    cases: list[Case] = [(name, amount) for name in names for amount in AMOUNTS]
    before = common.in_own_process(quality_of, job.data, cases, "input")
    tried = common.in_own_process(quality_of_best, job.data, cases, SWEPT)
    heads = [short(chosen) or "default" for chosen in SWEPT]
    rows, goals = [], []
    for case, old, results in zip(cases, before, tried, strict=True):
        found = [after for after, _ in results]
        rows.append([label_of(case), f"{old.normal:.2f} / {old.position:.3f}"])
        rows[-1] += [f"{after.normal:.2f} / {after.position:.3f}" for after in found]
        if case[1] >= 0.1:
            share = found[0].normal / min(found).normal
            goals.append(Target(f"{label_of(case)}: default / best of these", share, 1.35))
    text = [
        "Noise along the normals, in mean edge lengths, added to clean meshes; mean angle to the"
        " clean normals in degrees / distance to the clean positions in mean edge lengths.",
        table(["mesh", "input", *heads], rows),
        targets(goals),
    ]
    job.page.write("noise", "\n\n".join(text))
