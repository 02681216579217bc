# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoising of models from other sources: clean ones should stay, noisy ones should improve.

Models lie in folders below ``models`` of the data, in any format that trimesh reads. They are not
used for training.
"""

from __future__ import annotations

from pathlib import Path

import common
import numpy as np
import trimesh
from report import table
from shock_filter import core

ENDINGS = ".off", ".obj", ".ply", ".stl"

FACES = 12, 60_000
"""Least and greatest number of faces of a measured model."""

FEWEST_WITH_NOISE = 1500

NOISE = 0.1, 0.3
"""In all directions, in mean edges."""

SHOWN = 2.0
"""Degrees from which a clean model counts as changed."""

NAMED = 6
"""How many of each folder, those that turn most, are named."""


def models(job: common.Job) -> None:
    """Change of clean models, and error of noisy ones, as mean angles over faces."""
    if job.data is None:
        return
    rows, worst = [], []
    for folder in sorted(path for path in (job.data / "models").glob("*") if path.is_dir()):
        found = {path: mesh for path in _paths(folder) if (mesh := _model(path)) is not None}
        turned = {path: _left(mesh, mesh) for path, mesh in found.items()}
        worst += sorted(((off, path.name) for path, off in turned.items()), reverse=True)[:NAMED]
        off = np.array(list(turned.values()))
        row = [folder.name, str(len(off)), f"{off.mean():.2f}", str((off > SHOWN).sum())]
        large = [mesh for mesh in found.values() if mesh.face_count >= FEWEST_WITH_NOISE]
        rng = np.random.default_rng(1)
        for amount in NOISE:
            pairs = np.array([_with_noise(mesh, amount, rng) for mesh in large])
            row.append(f"{pairs[:, 0].mean():.1f} to {pairs[:, 1].mean():.1f}" if large else "")
        rows.append(row)
    if not rows:
        raise SystemExit("There are no models: put folders of them into the folder models.")
    heads = ["models", "count", "clean ones turn by", f"by over {SHOWN:.0f}"]
    text = [
        "In degrees, at the default; models count alike. Those of at least"
        f" {FEWEST_WITH_NOISE:,} faces, with noise added:",
        table([*heads, *(f"noise {amount}" for amount in NOISE)], rows),
        f"Most, {NAMED} of each: "
        + ", ".join(f"{name} ({off:.1f})" for off, name in sorted(worst, reverse=True))
        + ".",
    ]
    job.page.write("models", "\n\n".join(text))


def _paths(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.suffix.lower() in ENDINGS)


def _model(path: Path) -> core.TriangleMesh | None:
    try:
        read = trimesh.load(path, process=False, force="mesh", skip_materials=True)
        representatives, index = core.weld(np.asarray(read.vertices, float))
        faces = index[np.asarray(read.faces)]
        faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
        mesh = core.TriangleMesh(np.asarray(read.vertices, float)[representatives], faces)
    except (core.ShockError, ValueError, TypeError, IndexError):  # not of triangles, or empty
        return None
    fits = FACES[0] <= mesh.face_count <= FACES[1] and (mesh.areas > 0).all()
    return mesh if fits else None


def _left(mesh: core.TriangleMesh, truth: core.TriangleMesh) -> float:
    return common.normal_error(mesh.moved_to(core.denoise_geometry(mesh)), truth)


def _with_noise(
    mesh: core.TriangleMesh, amount: float, rng: np.random.Generator
) -> tuple[float, float]:
    move = amount * mesh.mean_edge_length * rng.normal(size=mesh.vertices.shape)
    noisy = mesh.moved_to(mesh.vertices + move)
    return common.normal_error(noisy, mesh), _left(noisy, mesh)
