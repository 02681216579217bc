# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoising of bumps several edges wide, as photogrammetry leaves them, with Bump Size and without.

Statues, stones and parts made by code; training has none of them, nor their seeds. The smoothing
was tuned on the first half.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import NamedTuple

import common
import numpy as np
import scipy.ndimage
from pictures import View, draw, sheet
from report import Target, table, targets
from scans import normals_averaged, smoothed
from shock_filter import core
from shock_filter.core.mesh.calculus import average_to_vertices

sys.path.append(str(Path(__file__).resolve().parent.parent / "tools" / "training"))
from distances import (
    Floats,
    Solid,
    ball,
    blend,
    both,
    box,
    cylinder,
    ellipsoid,
    gradient,
    minus,
    nearest,
    polytope,
    torus,
    turn,
    union,
    waved,
)
from meshings import EXTENT, sampled, surface_nets, umbrella

FIRST_SEED = 60_000_000
"""Seeds; training uses lower ones."""

CELLS = 110
WIDTHS = 2, 3, 4, 5
"""Of the bumps, in mean edge lengths: white noise is averaged with a Gaussian that is so wide at
half its height."""

TIMES = 0, 1, 2
"""Bump Size over the width of the bumps."""

TARGET_WIDTHS = 3, 4, 5
"""Whose mean the goals are for."""

PIXELS = 300
PICTURED = 4
VIEWS = {
    "tuned": {"statue": View((-80.0, 20.0, 0.0)), "stone": View((-60.0, 30.0, 0.0)),
              "part": View((-50.0, 30.0, 0.0))},
    "held out": {"statue": View((-70.0, 0.0, 30.0)), "stone": View((-60.0, 30.0, 0.0)),
                 "part": View((-50.0, 30.0, 0.0))},
}  # fmt: skip


class Kind(NamedTuple):
    """Degrees by which bumps turn faces, and at most after denoising."""

    before: float
    goal: float


KINDS = {"statue": Kind(10.4, 4.5), "stone": Kind(12.3, 7.5), "part": Kind(12.6, 4.1)}


def torso(rng: np.random.Generator) -> Solid:
    """Chest, head, nose and shoulders, with soft folds."""
    shape = ellipsoid((0, 0, -0.45), (0.62, 0.42, 0.75))
    for centre, radii, width in (
        ((0, 0, 0.65), (0.34, 0.38, 0.45), 0.15),
        ((0, -0.38, 0.62), (0.07, 0.1, 0.14), 0.08),
        ((0.55, 0, -0.1), (0.28, 0.26, 0.3), 0.15),
        ((-0.55, 0, -0.1), (0.28, 0.26, 0.3), 0.15),
        ((0.1, -0.3, -0.35), (0.3, 0.25, 0.18), 0.1),
    ):
        shape = blend(shape, ellipsoid(centre, radii), width)
    return waved(shape, rng, 0.03, 9.0)


def animal(rng: np.random.Generator) -> Solid:
    """A lying body with a head, legs and a curled tail."""
    shape = ellipsoid((0, 0, 0), (0.85, 0.4, 0.45))
    shape = blend(shape, ball((0.85, 0.1, 0.35), 0.32), 0.2)
    shape = blend(shape, ellipsoid((1.1, 0.1, 0.25), (0.2, 0.14, 0.12)), 0.1)
    for x, y in ((0.5, 0.35), (0.5, -0.35), (-0.5, 0.4), (-0.5, -0.4)):
        shape = blend(shape, ellipsoid((x, y, -0.3), (0.3, 0.14, 0.16)), 0.1)
    shape = blend(shape, torus((-0.8, 0, 0.1), 0.3, 0.09, 1), 0.12)
    return waved(shape, rng, 0.022, 11.0)


def rock(rng: np.random.Generator) -> Solid:
    """Broken faces, worn at their edges, with relief."""
    shape = polytope(rng, 0.95)
    for _ in range(3):
        shape = blend(shape, ball(rng.uniform(-0.45, 0.45, 3), rng.uniform(0.35, 0.6)), 0.15)
    return waved(waved(shape, rng, 0.05, 5.0), rng, 0.02, 11.0)


def flange() -> Solid:
    """A disk with holes, and eight sides with a bore on it."""
    a = np.arange(8) * np.pi / 4
    ways = np.stack([np.cos(a), np.sin(a), 0 * a])
    eight = both(lambda p: (p @ ways).max(1) - 0.5, lambda p: abs(p[:, 2] - 0.1) - 0.6)
    bolts = [cylinder((0.7 * np.cos(a), 0.7 * np.sin(a), 0), 0.12, 3) for a in np.arange(5) * 1.257]
    return minus(
        union(cylinder((0, 0, -0.4), 1.0, 0.2), eight),
        cylinder((0, 0, 0), 0.28, 3),
        *bolts,
    )


def bearing() -> Solid:
    """A block with a bore, a slot, a rib and a slanting side."""
    block = both(box((0, 0, 0), (1.0, 0.6, 0.6)), lambda p: 0.6 * p[:, 0] + 0.8 * p[:, 2] - 0.62)
    return minus(
        union(block, box((-0.3, 0, -0.5), (0.6, 0.9, 0.12))),
        cylinder((-0.35, 0, 0.1), 0.34, 3, 1),
        box((0.6, 0, -0.6), (0.15, 3, 0.3)),
    )


HALVES: dict[str, dict[str, Callable[[np.random.Generator], Solid]]] = {
    "tuned": {"statue": torso, "stone": rock, "part": lambda rng: flange()},
    "held out": {"statue": animal, "stone": rock, "part": lambda rng: bearing()},
}


@cache
def clean(half: str, kind: str) -> core.TriangleMesh:
    """The mesh without bumps: even faces, edges on creases."""
    rng = np.random.default_rng(FIRST_SEED + list(HALVES).index(half))
    straight, q = HALVES[half][kind](rng), turn(rng)
    solid = straight if kind != "part" else lambda p: straight(p @ q)
    h = 2 * EXTENT / (CELLS - 1)
    v, f = surface_nets(sampled(solid, CELLS))
    v = v * h - EXTENT
    for _ in range(4):
        v = nearest(solid, umbrella(v, f, 1, 0.7), h)
    mesh = core.TriangleMesh(v, f)
    for _ in range(2):
        normals = gradient(solid, nearest(solid, mesh.vertices[f].mean(1), h))
        fitted = core.fit_to_normals(mesh, normals, core.FitSettings(screening_radius=8.0))
        mesh = mesh.moved_to(fitted)
    return mesh


def with_bumps(mesh: core.TriangleMesh, width: float, degrees: float, seed: int):
    """Move vertices along their normals so that faces turn by so many degrees in the mean."""
    step = mesh.mean_edge_length / 2
    low = mesh.vertices.min(axis=0) - 10 * step
    places = (mesh.vertices - low) / step
    noise = np.random.default_rng(seed).normal(size=np.ceil(places.max(axis=0)).astype(int) + 10)
    noise = scipy.ndimage.gaussian_filter(noise, 2 * width / np.sqrt(8 * np.log(2)))
    heights = scipy.ndimage.map_coordinates(noise, places.T, order=1)
    along = average_to_vertices(mesh, mesh.normals)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    move = (heights / heights.std() * mesh.mean_edge_length)[:, None] * along
    amount = 0.2
    for _ in range(8):
        bumpy = mesh.moved_to(mesh.vertices + amount * move)
        amount *= degrees / common.normal_error(bumpy, mesh)
    return bumpy


RIVALS: dict[str, list[Callable[[core.TriangleMesh], Floats]]] = {
    "Laplacian": [lambda m, n=n: smoothed(m, n) for n in (10, 20, 40)],
    "Taubin": [lambda m, n=n: smoothed(m, n, back=0.53) for n in (10, 30, 100)],
    "bilateral": [lambda m: normals_averaged(m, 0.35, guided=False)],
    "guided": [lambda m: normals_averaged(m, 0.35, guided=True)],
}
"""Other methods, with the settings that are tried; the best one counts."""


class Found(NamedTuple):
    """Degrees: of the input, with each Bump Size, and of each rival at its best."""

    before: float
    ours: list[float]
    rivals: dict[str, float]


def bumpy_of(half: str, kind: str, width: int) -> core.TriangleMesh:
    """A case's mesh."""
    seed = FIRST_SEED + 100 * (1 + list(HALVES).index(half)) + width
    return with_bumps(clean(half, kind), width, KINDS[kind].before, seed)


def denoised(mesh: core.TriangleMesh, bump_size: float) -> Floats:
    settings = core.BeltramiGeometrySettings(bump_size=float(bump_size))
    return core.denoise_geometry(mesh, settings)


def compared(half: str) -> dict[tuple[str, int], Found]:
    """Degrees of all kinds and widths."""
    found = {}
    for kind in KINDS:
        truth = clean(half, kind)
        for width in WIDTHS:
            mesh = bumpy_of(half, kind, width)
            off = lambda v, mesh=mesh: common.normal_error(mesh.moved_to(v), truth)  # noqa: B023, E731
            found[kind, width] = Found(
                off(mesh.vertices),
                [off(denoised(mesh, times * width)) for times in TIMES],
                {name: min(off(way(mesh)) for way in ways) for name, ways in RIVALS.items()},
            )
    return found


def row_of(half: str, kind: str, width: int, found: Found) -> list[str]:
    best = min(found.rivals, key=found.rivals.__getitem__)
    numbers = [found.before, *found.ours]
    return [half, kind, str(width), *(f"{x:.1f}" for x in numbers),
            f"{found.rivals['Laplacian']:.1f}", f"{found.rivals[best]:.1f}, {best}"]  # fmt: skip


def shown(half: str) -> list[list[np.ndarray]]:
    """Pictures of each kind: clean, with bumps, and after."""
    rows = []
    for kind in KINDS:
        truth, mesh = clean(half, kind), bumpy_of(half, kind, PICTURED)
        results = [truth.vertices, mesh.vertices]
        results += [denoised(mesh, times * PICTURED) for times in TIMES]
        results += [smoothed(mesh, 20)]
        view = VIEWS[half][kind]
        rows.append([draw(truth.moved_to(v), truth, view, PIXELS) for v in results])
    return rows


def bumps(job: common.Job) -> None:
    """Degrees with Bump Size at 0, at the width of the bumps and at twice of it."""
    rows, goals = [], []
    for half in HALVES:
        found = common.in_own_process(compared, half)
        rows += [row_of(half, *case, each) for case, each in found.items()]
        for kind, (_, goal) in KINDS.items():
            mean = np.mean([found[kind, width].ours[1] for width in TARGET_WIDTHS])
            goals.append(Target(f"{half}: {kind}, 3 to 5 edges", float(mean), goal, "{:.1f}"))
    head = ["half", "shape", "edges wide", "input", "Bump Size 0", "the width", "twice",
            "Laplacian", "best of all others"]  # fmt: skip
    titles = ["clean", f"bumps {PICTURED} edges wide", "Bump Size 0", str(PICTURED),
              str(2 * PICTURED), "Laplacian, 20 passes"]  # fmt: skip
    pictures = [
        job.page.picture(
            f"bumps-{half.replace(' ', '-')}",
            sheet(titles, shown(half), 1).quantize(64),
            f"A statue, a stone and a part with bumps, and denoised; {half}",
        )
        for half in HALVES
    ]
    text = [
        "Mean angle over faces to the true normals, in degrees. *The width* and *twice*: Bump Size"
        " is that of the bumps, or twice as large. Others, each at its best setting: Laplacian and"
        " Taubin smoothing, bilateral and guided normals.",
        table(head, rows, 2),
        targets(goals),
    ]
    job.page.write("bumps", "\n\n".join(text) + "".join(pictures))
