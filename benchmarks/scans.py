# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoising of virtual scans, by Shock Filter and by other methods."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import common
import numpy as np
import peers
import scipy.sparse as sp
from report import Target, table, targets
from shock_filter import core
from shock_filter.core.shape.sides import consistent_normals
from virtual_scans import (
    MADE,
    VIEWS,
    Errors,
    Floats,
    Scan,
    errors,
    fused,
    range_image,
    with_white_noise,
)

Filter = Callable[[core.TriangleMesh], Floats]


class Case(NamedTuple):
    """A shape, how it is scanned, how finely, and with how much noise."""

    shape: str
    scanner: str
    size: int
    noise: float
    part: bool = False

    @property
    def label(self) -> str:
        """Its name in a table."""
        return f"{Path(self.shape).stem}, {self.scanner} {self.noise:g}"


RANGE, FUSED, WHITE = "range image", "fused", "white noise"

DEVELOPED = [
    Case("fandisk.obj", WHITE, 0, 0.1, True),
    Case("fandisk.obj", WHITE, 0, 0.3, True),
    Case("julius.obj", WHITE, 0, 0.2),
    Case("fandisk.obj", RANGE, 150, 0.2, True),
    Case("gear", RANGE, 120, 0.15, True),
    Case("gear", RANGE, 180, 0.35, True),
    Case("washer", RANGE, 110, 0.25, True),
    Case("julius.obj", RANGE, 160, 0.15),
    Case("bunny.obj", RANGE, 140, 0.25),
    Case("lion_statue.obj", RANGE, 180, 0.2),
    Case("boulder", RANGE, 110, 0.2),
    Case("fandisk.obj", FUSED, 80, 0.3, True),
    Case("gear", FUSED, 60, 0.25, True),
    Case("washer", FUSED, 48, 0.3, True),
    Case("washer", FUSED, 48, 0.6, True),
    Case("julius.obj", FUSED, 60, 0.35),
    Case("julius.obj", FUSED, 80, 0.15),
    Case("bunny.obj", FUSED, 60, 0.35),
    Case("lion_statue.obj", FUSED, 80, 0.25),
    Case("boulder", FUSED, 44, 0.4),
]
HELD_OUT = [
    Case("block.obj", WHITE, 0, 0.2, True),
    Case("sharp sphere", WHITE, 0, 0.3, True),
    Case("nicolo.obj", WHITE, 0, 0.1),
    Case("nicolo.obj", WHITE, 0, 0.3),
    Case("block.obj", RANGE, 150, 0.2, True),
    Case("nut", RANGE, 120, 0.15, True),
    Case("casting.off", RANGE, 180, 0.25, True),
    Case("nut", RANGE, 130, 0.3, True),
    Case("nicolo.obj", RANGE, 150, 0.2),
    Case("igea.ply", RANGE, 140, 0.15),
    Case("dragon_50k.obj", RANGE, 180, 0.2),
    Case("block.obj", FUSED, 70, 0.35, True),
    Case("nut", FUSED, 50, 0.3, True),
    Case("casting.off", FUSED, 80, 0.25, True),
    Case("sharp sphere", FUSED, 50, 0.35, True),
    Case("nicolo.obj", FUSED, 60, 0.3),
    Case("igea.ply", FUSED, 60, 0.4),
    Case("dragon_50k.obj", FUSED, 90, 0.25),
    Case("armadillo.obj", FUSED, 80, 0.3),
]
MAKERS = {RANGE: range_image, FUSED: fused}


def scan_of(data: Path | None, case: Case, seed: int) -> Scan:
    """Make a case's scan."""
    if case.scanner == WHITE:
        return with_white_noise(data, case.shape, case.noise, seed)
    return MAKERS[case.scanner](data, case.shape, case.size, case.noise, seed)


def smoothed(mesh: core.TriangleMesh, passes: int, back: float = 0.0) -> Floats:
    """Laplacian smoothing by steps of half a way; with steps `back`, Taubin's filter."""
    ends = np.concatenate([mesh.faces[:, [k, (k + 1) % 3]] for k in range(3)])
    ends = np.concatenate([ends, ends[:, ::-1]])
    near = sp.coo_matrix((np.ones(len(ends)), ends.T), shape=(mesh.vertex_count,) * 2).tocsr()
    near.data[:] = 1.0
    near = sp.diags(1 / np.maximum(np.asarray(near.sum(axis=1)).reshape(-1), 1)) @ near
    points = mesh.vertices
    for _ in range(passes):
        points = points + 0.5 * (near @ points - points)
        points = points - back * (near @ points - points)
    return points


def normals_averaged(mesh: core.TriangleMesh, spread: float, guided: bool) -> Floats:
    """Bilateral averages of normals (Zheng et al. 2011), or guided ones (Zhang et al. 2015).

    Over the faces that share a vertex, twenty times. The positions are fitted as ours are.
    """
    count, normals = mesh.face_count, mesh.normals
    corners = sp.coo_matrix(
        (np.ones(3 * count), (np.repeat(np.arange(count), 3), mesh.faces.reshape(-1)))
    ).tocsr()
    one, other = (corners @ corners.T).nonzero()
    centres = mesh.vertices[mesh.faces].mean(axis=1)
    squares = ((centres[one] - centres[other]) ** 2).sum(axis=1)
    weights = mesh.areas[other] * np.exp(-0.5 * squares / squares.mean())
    for turn in range(20):
        guide = normals
        if guided and turn % 2 == 0:
            guide = consistent_normals(mesh, normals, np.ones(count, bool), 1)
        if turn % 2 == 0 or not guided:
            apart = ((guide[one] - guide[other]) ** 2).sum(axis=1)
            mean = sp.csr_matrix(
                (weights * np.exp(-0.5 * apart / spread**2), (one, other)), shape=(count, count)
            )
        normals = mean @ normals
        normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    normals[mesh.areas == 0] = 0.0
    return core.fit_to_normals(mesh, normals, core.FitSettings(screening_radius=5.0))


def by_the_kernel(mesh: core.TriangleMesh) -> Floats:
    """The kernel of the paper, which is how the first versions were."""
    return core.denoise_geometry(mesh, core.BeltramiGeometrySettings(method="beltrami"))


def sharpened_everywhere(mesh: core.TriangleMesh) -> Floats:
    """What the preset Scan Cleanup was."""
    settings = core.GeometrySettings.of_paper(time=64.0, mollify_passes=2)
    return core.sharpen_geometry(mesh, settings)


def two_steps(steps: int, turns: int, fits: int) -> Filter:
    """MeshLab's two-step smoothing."""
    settings = {"stepsmoothnum": steps, "stepnormalnum": turns, "stepfitnum": fits}
    settings["normalthr"] = 60.0

    def apply(mesh: core.TriangleMesh) -> Floats:
        name = "apply_coord_two_steps_smoothing"
        return peers.apply("MeshLab", name, settings, mesh.vertices, mesh.faces)[0]

    return apply


OURS = "ours"
MESHLAB = "MeshLab two-step, best of 3"
METHODS: dict[str, list[Filter]] = {
    OURS: [core.denoise_geometry],
    "scan itself": [lambda mesh: mesh.vertices],
    "Laplacian, 3 passes": [lambda mesh: smoothed(mesh, 3)],
    "Taubin, 10 passes": [lambda mesh: smoothed(mesh, 10, back=0.53)],
    MESHLAB: [two_steps(3, 20, 20), two_steps(3, 5, 5), two_steps(1, 5, 5)],
    "bilateral normals": [lambda mesh: normals_averaged(mesh, 0.35, guided=False)],
    "guided normals": [lambda mesh: normals_averaged(mesh, 0.35, guided=True)],
    "ours, as if noise were white": [by_the_kernel],
    "sharpened as Scan Cleanup was": [sharpened_everywhere],
}
"""The compared methods, with the settings that are tried; the best one counts."""

SMOOTHERS = "Laplacian, 3 passes", "Taubin, 10 passes", "sharpened as Scan Cleanup was"
WORST, MEDIAN, RANGE_PART = 1.2, 1.04, 4.5
HALVES = {"tuned": (DEVELOPED, 1), "held out": (HELD_OUT, 2), "other noise": (HELD_OUT, 3)}


def errors_of_all(data: Path | None, cases: list[Case], seed: int) -> list[dict[str, Errors]]:
    """Errors of all methods on some scans."""
    return [_errors_of(data, case, seed) for case in cases]


def _errors_of(data: Path | None, case: Case, seed: int) -> dict[str, Errors]:
    scan = scan_of(data, case, seed)
    found = {}
    for title, filters in METHODS.items():
        if title != MESHLAB or peers.installed("MeshLab"):
            tried = (core.TriangleMesh(scan.mesh.vertices, scan.mesh.faces) for _ in filters)
            results = [function(mesh) for function, mesh in zip(filters, tried, strict=True)]
            found[title] = min(errors(data, case.shape, scan, result) for result in results)
    return found


class Half(NamedTuple):
    """What was measured on some scans: by scan the errors, by method."""

    name: str
    cases: list[Case]
    found: list[dict[str, Errors]]

    def ratios(self, title: str) -> Floats:
        """How far a method's normals are from the best of the others."""
        best = [min(e.normal for name, e in row.items() if name != OURS) for row in self.found]
        return np.array([row[title].normal for row in self.found]) / best

    def mean(self, title: str, field: str, chosen: Callable[[Case], bool]) -> float:
        """The mean of a method's errors over some of the scans."""
        pairs = zip(self.cases, self.found, strict=True)
        return float(np.mean([getattr(row[title], field) for case, row in pairs if chosen(case)]))

    def table(self) -> str:
        """All scans."""
        titles = list(self.found[0])
        pairs = zip(self.cases, self.found, strict=True)
        rows = [[c.label, *(f"{row[title].normal:.2f}" for title in titles)] for c, row in pairs]
        return table(["scan", *titles], rows)

    def summary(self) -> list[list[str]]:
        """A row of each method."""
        return [
            [
                self.name,
                title,
                f"{self.mean(title, 'normal', lambda case: True):.2f}",
                f"{np.median(self.ratios(title)):.3f}",
                f"{self.ratios(title).max():.2f}",
                f"{self.mean(title, 'scabs', lambda case: True):.2f}",
            ]
            for title in self.found[0]
        ]

    def goals(self) -> list[Target]:
        """The targets for our default."""
        ratios = self.ratios(OURS)
        seen = self.mean(OURS, "normal", lambda case: case.part and case.scanner == RANGE)
        goals = [
            Target(f"{self.name}: worst / best", float(ratios.max()), WORST),
            Target(f"{self.name}: median / best", float(np.median(ratios)), MEDIAN),
            Target(f"{self.name}: parts in range images, degrees", seen, RANGE_PART),
        ]
        for name, part in (("parts", True), ("statues", False)):
            cases = [case for case in self.cases if case.part == part]
            off = {title: self.mean(title, "scabs", cases.__contains__) for title in self.found[0]}
            least = min(off[title] for title in SMOOTHERS)
            goals.append(Target(f"{self.name}: {name}, % 45 degrees off", off[OURS], least))
        return goals


def scans(job: common.Job) -> None:
    """Errors on virtual scans, and how far each method is from the best of the others."""
    halves = []
    for name, (cases, seed) in HALVES.items():
        known = [case for case in cases if job.data or case.shape in MADE]
        found = common.in_own_process(errors_of_all, job.data, known, seed)
        halves.append(Half(name, known, found))
    head = ["half", "filter", "mean degrees", "median / best", "worst / best", "45 off, %"]
    text = [
        "Scans made by code of known shapes: range images from one side, range images fused from"
        f" {VIEWS} sides, and shapes with white noise; numbers are the noise in pixels, voxels or"
        " mean edge lengths. *Best* is the best of all filters but ours on each scan.",
        table(head, [row for half in halves for row in half.summary()], words=2),
        targets(goal for half in halves[1:] for goal in half.goals()),
    ]
    for half in halves:
        text += [f"Mean angle to the true normals, degrees, {half.name}:", half.table()]
    job.page.write("scans", "\n\n".join(text))
