# SPDX-License-Identifier: GPL-3.0-or-later
"""How well creases of remeshed solids are restored, on shapes that are not used for training.

Errors are mean degrees between the faces' normals and those of the solid near them, by area. Folds
are edges that close beyond 150 degrees, and did not before. ``--meshes FOLDER`` adds how far files
change, such as statues; ``--draw FOLDER`` draws the curves of steadiness.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import common
import numpy as np
import scipy.ndimage
from relief_meshes import RELIEF, SHAPES, with_relief
from report import Page, table
from shock_filter import core

sys.path.append(str(Path(__file__).resolve().parent.parent / "tools" / "training"))
import crease_examples
from distances import (
    Floats,
    Solid,
    ball,
    both,
    box,
    bumpy,
    cylinder,
    gradient,
    grown,
    minus,
    nearest,
    norm,
    placed,
    torus,
    turn,
    union,
)
from meshings import EXTENT, marching_cubes, sampled, surface_nets

FIRST_SEED = 50_000_000
"""Seeds of generated solids; training uses lower ones."""

TURN = turn(np.random.default_rng(77))
"""Askew to the grid."""

MESHINGS = "nets", "cubes", "blurred", "noisy", "coarse"

WAVES, STEEP = (3, 4, 6, 10), (0.05, 0.15)
"""Mean edges from bump to bump of relief, and its height, in these."""


def cells_of(meshing: str) -> int:
    return 48 if meshing == "coarse" else 80


def meshed(solid: Solid, cells: int, meshing: str = "nets", noise: float = 0.0, seed: int = 0):
    """Vertices, faces and the width of the voxels."""
    rng = np.random.default_rng(seed)
    h = 2 * EXTENT / (cells - 1)
    d = sampled(solid, cells)
    if meshing == "blurred":
        d = scipy.ndimage.gaussian_filter(d, 1.0)
    v, f = marching_cubes(d) if meshing == "cubes" else surface_nets(d)
    noise = 0.03 if meshing == "noisy" else noise
    return v * h - EXTENT + rng.normal(size=v.shape) * noise * h, f, h


def normals_of(v: Floats, f) -> tuple[Floats, Floats]:
    n = np.cross(v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]])
    size = norm(n)
    return n / np.maximum(size, 1e-300)[:, None], size


def error(solid: Solid, v: Floats, f, h: float, among=None) -> float:
    """Mean degrees to the solid's normals within 0.05 edges; of chosen faces, if asked for."""
    n, areas = normals_of(v, f)
    edge = norm(v[f] - v[np.roll(f, -1, 1)], 2).mean()
    centre = nearest(solid, v[f].mean(1), h)
    best = np.full(len(f), -2.0)
    for way in np.r_[np.zeros((1, 3)), np.eye(3), -np.eye(3)]:
        best = np.maximum(best, (gradient(solid, centre + 0.05 * edge * way) * n).sum(1))
    off = np.degrees(np.arccos(np.clip(best, -1, 1)))
    weights = areas if among is None else areas * among(v[f].mean(1))
    return float((off * weights).sum() / weights.sum())


def folds(v: Floats, f) -> int:
    """Edges that close beyond 150 degrees."""
    n, _ = normals_of(v, f)
    ends = np.sort(np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]]), 1)
    faces = np.tile(np.arange(len(f)), 3)
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    ends, faces = ends[order], faces[order]
    same = (ends[1:] == ends[:-1]).all(1)
    cosines = (n[faces[1:][same]] * n[faces[:-1][same]]).sum(1)
    return int((cosines < np.cos(np.radians(150.0))).sum())


class Row:
    """The result for one mesh."""

    def __init__(self, solid: Solid, v: Floats, f, h: float, among=None) -> None:
        out = core.sharpen_geometry(core.TriangleMesh(v, f))
        self.before, self.after = (error(solid, x, f, h, among) for x in (v, out))
        self.folds = max(folds(out, f) - folds(v, f), 0)

    @property
    def share(self) -> float:
        return self.after / max(self.before, 1e-9)


def bump_on_box(relief: float, rotation: Floats) -> tuple[Solid, Callable[[Floats], Floats]]:
    """A box under a bumpy ball, and which places lie on the box's faces."""
    low = box((0, 0, -0.55), (0.7, 0.6, 0.3))
    on = bumpy((0, 0, 0.2), 0.5, np.random.default_rng(5), relief, 7.0)
    whole = union(low, on)
    away = lambda p: (low(p @ rotation) < on(p @ rotation) - 0.12).astype(float)  # noqa: E731
    return (lambda p: whole(p @ rotation)), away


def filleted_part(rotation: Floats) -> Solid:
    """Fillets beside crisp edges, a slot, a hole and a rib."""
    body = grown(box((0, 0, 0), (0.9 - 0.18, 0.6 - 0.18, 0.45 - 0.18)), 0.18)
    whole = union(
        minus(body, cylinder((0.45, 0, 0), 0.2, 2), box((-0.3, 0, 0.45), (0.12, 2, 0.2))),
        box((0, -0.55, -0.1), (0.5, 0.15, 0.25)),
    )
    return lambda p: whole(p @ rotation)


def bracket() -> Solid:
    return minus(
        union(box((0, 0, -0.5), (0.9, 0.6, 0.1)), box((-0.8, 0, 0), (0.1, 0.6, 0.6)),
              box((-0.3, 0, -0.2), (0.5, 0.05, 0.25))),
        cylinder((0.5, 0.3, -0.5), 0.12, 1), cylinder((0.5, -0.3, -0.5), 0.12, 1),
        cylinder((-0.8, 0, 0.3), 0.2, 1, 0),
    )  # fmt: skip


def _around(count: int, make: Callable[[], Solid]) -> list[Solid]:
    angles = np.arange(count) * 2 * np.pi / count
    turns = [np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
             for a in angles]  # fmt: skip
    return [placed(make(), np.zeros(3), q.T) for q in turns]


PARTS: dict[str, Callable[[], Solid]] = {
    "bracket": bracket,
    "cog": lambda: minus(
        union(
            cylinder((0, 0, 0), 0.7, 0.25),
            *_around(12, lambda: box((0.75, 0, 0), (0.15, 0.09, 0.25))),
        ),
        cylinder((0, 0, 0), 0.25, 1),
    ),
    "flange": lambda: minus(
        union(cylinder((0, 0, -0.4), 0.95, 0.12), cylinder((0, 0, 0.1), 0.45, 0.5)),
        cylinder((0, 0, 0), 0.25, 2),
        *_around(6, lambda: cylinder((0.7, 0, -0.4), 0.1, 1)),
    ),
    "stairs": lambda: union(
        *[box((-0.75 + 0.3 * i, 0, -0.6 + 0.12 * i), (0.15, 0.6, 0.12 + 0.12 * i))
          for i in range(6)]
    ),
    "nut": lambda: minus(
        both(
            *[(lambda p, a=a: p[:, 0] * np.cos(a) + p[:, 1] * np.sin(a) - 0.8)
              for a in np.arange(6) * np.pi / 3],
            lambda p: abs(p[:, 2]) - 0.35,
        ),
        cylinder((0, 0, 0), 0.4, 1),
    ),
    "wedge": lambda: both(box((0, 0, 0), (0.9, 0.5, 0.5)),
                          lambda p: (0.5 * p[:, 0] + 0.866 * p[:, 2]) - 0.15),
    "cross": lambda: union(box((0, 0, 0), (0.95, 0.25, 0.25)), box((0, 0, 0), (0.25, 0.95, 0.25)),
                           box((0, 0, 0), (0.25, 0.25, 0.95))),
    "hollow": lambda: minus(box((0, 0, 0), (0.8, 0.8, 0.8)), box((0, 0, 0.2), (0.6, 0.6, 0.8))),
    "cone": lambda: union(cylinder((0, 0, 0), 0.5, 0.8, 2, 0.45),
                          cylinder((0, 0, -0.85), 1.0, 0.15)),
    "dome": lambda: minus(both(ball((0, 0, -0.3), 1.0), lambda p: -0.3 - p[:, 2]),
                          cylinder((0, 0, 0), 0.3, 2)),
    "ball": lambda: ball((0, 0, 0), 0.9),
    "torus": lambda: torus((0, 0, 0), 0.7, 0.3),
    "pillow": lambda: grown(box((0, 0, 0), (0.5, 0.3, 0.15)), 0.35),
}  # fmt: skip

ROUND = "ball", "torus", "pillow"


def plinths() -> Iterator[list[str]]:
    for relief in (0.05, 0.1, 0.15, 0.25, 0.3):
        for name, q in (("upright", np.eye(3)), ("turned", TURN)):
            solid, away = bump_on_box(relief, q)
            v, f, h = meshed(solid, 90)
            low, high = Row(solid, v, f, h, away), Row(solid, v, f, h, lambda p: 1 - away(p))  # noqa: B023
            yield [f"relief {relief}, {name}", f"{low.before:.2f}", f"{low.after:.2f}",
                   f"{high.before:.2f}", f"{high.after:.2f}", str(low.folds)]  # fmt: skip


def fillets() -> Iterator[list[str]]:
    for cells in (48, 64, 96, 128):
        for name, q in (("upright", np.eye(3)), ("turned", TURN)):
            solid = filleted_part(q)
            v, f, h = meshed(solid, cells)
            row = Row(solid, v, f, h)
            yield [f"{cells} cells, {name}", f"{0.18 / h:.1f}", f"{row.before:.2f}",
                   f"{row.after:.2f}", f"{row.share:.2f}", str(row.folds)]  # fmt: skip


def brackets() -> Iterator[list[str]]:
    for size in (0.05, 0.04, 0.03, 0.02, 0.0137):
        cells = round(2 * EXTENT / size) + 1
        for name, q in (("upright", np.eye(3)), ("turned", TURN)):
            solid = lambda p, q=q: bracket()(p @ q)  # noqa: E731
            v, f, h = meshed(solid, cells)
            row = Row(solid, v, f, h)
            yield [f"voxel {size}, {name}", f"{row.before:.2f}", f"{row.after:.2f}",
                   f"{row.share:.2f}", str(row.folds)]  # fmt: skip


def parts() -> Iterator[list[str]]:
    all_rows: list[Row] = []
    for name, make in PARTS.items():
        rows = []
        for number, meshing in enumerate(MESHINGS):
            q = TURN if number % 2 else np.eye(3)
            whole = make()
            solid = lambda p, q=q, s=whole: s(p @ q)  # noqa: E731
            v, f, h = meshed(solid, cells_of(meshing), meshing)
            rows.append(Row(solid, v, f, h))
        share, folded = np.mean([r.share for r in rows]), sum(r.folds for r in rows)
        yield [name, *(f"{r.before:.2f} to {r.after:.2f}" for r in rows), f"{share:.2f}",
               str(folded)]  # fmt: skip
        if name not in ROUND:
            all_rows += rows
    shares = [r.share for r in all_rows]
    yield ["parts", *[""] * len(MESHINGS), f"{np.mean(shares):.3f}, worst {max(shares):.2f}",
           str(sum(r.folds for r in all_rows))]  # fmt: skip


def solids(count: int) -> Iterator[list[str]]:
    rows: dict[str, list[Row]] = {}
    seed = FIRST_SEED
    while sum(map(len, rows.values())) < count:
        seed += 1
        try:
            e = crease_examples.remeshed(seed, cells=(30, 125))
        except (IndexError, ValueError, core.ShockError):
            continue
        v, f = e.mesh.vertices, e.mesh.faces
        if not 1200 <= len(f) <= 120_000 or error(e.solid, v, f, e.spacing) > 25:
            continue
        row = Row(e.solid, v, f, e.spacing)
        rows.setdefault(e.kind, []).append(row)
        if row.share > 1.03 or row.folds:
            print(f"  worse: seed {seed} {e.kind} {e.how} {len(f)} {row.before:.2f}"
                  f" {row.after:.2f}, {row.folds} folds", flush=True)  # fmt: skip
    rows["all"] = [row for each in rows.values() for row in each]
    for kind, each in rows.items():
        shares = np.array([row.share for row in each])
        yield [kind, str(len(each)), f"{np.mean([r.before for r in each]):.2f}",
               f"{np.mean([r.after for r in each]):.2f}", f"{shares.mean():.3f}",
               f"{shares.max():.2f}", f"{(shares > 1.03).mean():.1%}",
               str(sum(r.folds for r in each))]  # fmt: skip


def kept(folder: Path) -> Iterator[list[str]]:
    """How far files change: mean degrees, and the share of their faces by more than 10."""
    import trimesh

    for path in sorted(
        p for p in folder.rglob("*") if p.suffix in (".obj", ".ply", ".stl", ".off")
    ):
        found = trimesh.load(path, process=path.suffix == ".stl", force="mesh")
        try:
            mesh = core.TriangleMesh(np.asarray(found.vertices), np.asarray(found.faces))
        except core.ShockError:
            continue
        moved = mesh.moved_to(core.sharpen_geometry(mesh))
        off = np.degrees(np.arccos(np.clip((mesh.normals * moved.normals).sum(1), -1, 1)))
        off = off[mesh.areas > 0]
        yield [path.stem, f"{mesh.vertex_count:,}", f"{off.mean():.2f}", f"{(off > 10).mean():.1%}"]


def reliefs() -> Iterator[list[str]]:
    """How far clean relief on even meshes turns, in the mean and at most."""
    for name in RELIEF:
        for wave in WAVES:
            row = [name, str(wave)]
            for steep in STEEP:
                turned = []
                for shape in SHAPES:
                    mesh = with_relief(shape, name, wave, steep)
                    moved = mesh.moved_to(core.sharpen_geometry(mesh))
                    turned.append(common.normal_error(moved, mesh))
                row.append(f"{np.mean(turned):.2f}, {max(turned):.2f}")
            yield row


def steadiness() -> dict[str, dict[str, tuple[list[float], list[float]]]]:
    """Share left over the number of cells, the turning, and the noise: for three solids."""
    found: dict[str, dict[str, tuple[list[float], list[float]]]] = {}
    part = lambda q: lambda p: PARTS["flange"]()(p @ q)  # noqa: E731
    makers = {"crisp part": part, "fillets": filleted_part,
              "statue on a box": lambda q: bump_on_box(0.15, q)[0]}  # fmt: skip
    for name, make in makers.items():
        curves = found[name] = {}
        cells = list(range(48, 129, 8))
        curves["cells"] = cells, [_share(make(TURN), n, 0.0) for n in cells]
        angles = list(range(0, 46, 5))
        curves["degrees"] = angles, [_share(make(_about_x(a)), 72, 0.0) for a in angles]
        noise = [round(0.01 * k, 2) for k in range(8)]
        curves["noise"] = noise, [_share(make(TURN), 72, x) for x in noise]
    return found


def _about_x(degrees: float) -> Floats:
    a = np.radians(degrees)
    return np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])


def _share(solid: Solid, cells: int, noise: float) -> float:
    v, f, h = meshed(solid, cells, noise=noise)
    return Row(solid, v, f, h).share


def draw(curves, folder: Path) -> None:
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(12, 3.5), sharey=True)
    for axis, (key, label) in zip(axes, (("cells", "cells along a side"), ("degrees", "turned by"),
                                         ("noise", "noise in voxels")), strict=True):  # fmt: skip
        for name, each in curves.items():
            axis.plot(*each[key], label=name)
        axis.set_xlabel(label)
        axis.set_ylim(0, 1.1)
    axes[0].set_ylabel("share of the error left")
    axes[0].legend()
    figure.tight_layout()
    figure.savefig(folder / "creases-steadiness.png", dpi=80)


def main() -> None:
    """Print the tables, or write them into a page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--write", type=Path, help="Markdown page to write the tables into")
    parser.add_argument("--solids", type=int, default=200, help="how many made solids")
    parser.add_argument("--meshes", type=Path, help="folder of meshes whose change is told")
    parser.add_argument("--draw", type=Path, help="folder for the curves")
    parser.add_argument(
        "--only", default="plinths,fillets,brackets,parts,solids,reliefs,steadiness"
    )
    options = parser.parse_args()
    tables: dict[str, tuple[list[str], Callable[[], Iterator[list[str]]]]] = {
        "plinths": (["box under a bumpy ball", "box, before", "after", "ball, before", "after",
                     "folds"], plinths),
        "fillets": (["part with fillets", "radius in voxels", "before", "after", "share",
                     "folds"], fillets),
        "brackets": (["bracket", "before", "after", "share", "folds"], brackets),
        "parts": (["part", *MESHINGS, "share left", "folds"], parts),
        "solids": (["made solids", "count", "before", "after", "share left", "worst",
                    "more than 3 % worse", "folds"], lambda: solids(options.solids)),
        "reliefs": (["relief", "edges from bump to bump",
                     *(f"height {steep:g} of these: turned by, most" for steep in STEEP)],
                    reliefs),
    }  # fmt: skip
    page = Page(options.write)
    for name in options.only.split(","):
        if name == "steadiness":
            curves = steadiness()
            rows = [
                [solid, key, f"{max(abs(np.diff(values))):.2f}"]
                for solid, each in curves.items()
                for key, (_, values) in each.items()
            ]
            page.write("crease-steadiness", table(["", "over", "greatest step"], rows))
            if options.draw:
                draw(curves, options.draw)
            continue
        head, make = tables[name]
        page.write(f"crease-{name}", table(head, list(make())))
    if options.meshes:
        head = ["file", "vertices", "mean change", "by more than 10 degrees"]
        page.write("crease-kept", table(head, list(kept(options.meshes))))


if __name__ == "__main__":
    main()
