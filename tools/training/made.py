# SPDX-License-Identifier: GPL-3.0-or-later
"""Stores examples of creases on disk: meshes, sampled faces, and their target normals."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import crease_examples as examples
import denoise_examples
import numpy as np
from shock_filter import core
from shock_filter.core.mesh.calculus import average_to_faces, average_to_vertices, smooth_vertices

FACES = 24, 60_000
"""Fewest and most faces of a mesh that is used."""

ROWS = 2400
"""Most faces sampled from a mesh: two thirds where normals differ from those around them, the
others anywhere."""

DIFFERS = np.cos(np.radians(4.0))


def _clean(make: Callable, seed: int) -> examples.Example:
    # An example of denoising, if it has no noise.
    mesh, _, kind = make(seed)
    if kind.startswith("noisy"):
        raise ValueError("This one has noise.")
    return examples.as_it_is(mesh, kind, kind)


MAKERS: dict[str, Callable[[int], examples.Example]] = {
    "remeshed": examples.remeshed,
    "narrow": partial(examples.remeshed, kinds=("narrow",)),
    "coarse": partial(
        examples.remeshed, cells=(14, 44), meshings=("crisp", "crisp", "nets", "uneven", "cubes")
    ),
    "relief": examples.relief,
    "scanned": examples.scanned,
    "modelled": examples.modelled,
    "softened": examples.softened,
    "sculpted": examples.sculpted,
    "sharp": partial(
        examples.remeshed,
        kinds=("filleted", "filleted", "part", "mixed"),
        meshings=("crisp", "crisp", "uneven", "softened"),
    ),
    "decimated": examples.decimated,
    "exact": partial(
        examples.remeshed,
        kinds=("profiled", "profiled", "exact"),
        meshings=("nets", "nets", "nets", "cubes", "blurred", "crisp"),
    ),
    "voxels": partial(
        examples.remeshed,
        kinds=(
            "part",
            "exact",
            "exact",
            "profiled",
            "profiled",
            "filleted",
            "filleted",
            "plinth",
            "statue",
            "thin",
            "smooth",
            "mixed",
        ),
        meshings=("voxels",),
        closer=3.0,
    ),
    "subdivided": examples.subdivided,
    "displaced": examples.displaced,
    "cage": partial(_clean, denoise_examples.cage),
    "drawn": partial(_clean, denoise_examples.drawn),
    "divided": partial(_clean, denoise_examples.divided),
    "lettered": partial(
        examples.remeshed, kinds=("lettered",), meshings=("voxels", "nets", "cubes"), closer=3.0
    ),
    "preserved": partial(
        examples.remeshed,
        kinds=4 * ("lettered",)
        + 3 * ("exact",)
        + 3 * ("profiled",)
        + ("filleted", "smooth", "statue"),
        meshings=("preserved",),
        closer=3.0,
    ),
}
"""Makers of training examples, by name."""


def make_all(counts: dict[str, int], folder: Path, processes: int) -> list[Path]:
    """Make a number of examples of each maker; files that exist in the folder are kept."""
    jobs = [(name, seed, folder) for name, count in counts.items() for seed in range(count)]
    folder.mkdir(parents=True, exist_ok=True)
    if processes == 1:
        found = [_make(*job) for job in jobs]
    else:
        with ProcessPoolExecutor(processes) as pool:
            found = list(pool.map(_make, *zip(*jobs, strict=True), chunksize=8))
    return [path for path in found if path is not None]


def _make(name: str, seed: int, folder: Path) -> Path | None:
    path = folder / f"{name}_{seed}.npz"
    if path.exists():
        return path
    try:
        example = MAKERS[name](_seed(name, seed))
    except (IndexError, ValueError, core.ShockError):  # the solid is empty, or the mesh has noise
        return None
    mesh = example.mesh
    if not FACES[0] <= mesh.face_count <= FACES[1] or not mesh.areas.min() > 0:
        return None
    rows = _rows(mesh, seed)
    one, two = example.targets(rows)
    off = np.degrees(np.arccos(np.clip(np.maximum(
        (one * mesh.normals[rows]).sum(1), (two * mesh.normals[rows]).sum(1)), -1, 1)))  # fmt: skip
    if (off > 60).mean() > 0.1:
        return None  # the mesh does not fit the solid
    part = path.with_suffix(".part")
    with part.open("wb") as file:
        np.savez(file, vertices=mesh.vertices.astype(np.float32), faces=mesh.faces, rows=rows,
                 one=one.astype(np.float32), two=two.astype(np.float32), kind=example.kind,
                 how=example.how)  # fmt: skip
    part.rename(path)
    return path


def _seed(name: str, seed: int) -> int:
    return 1_000_000 * (1 + list(MAKERS).index(name)) + seed


def _rows(mesh: core.TriangleMesh, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    mean = smooth_vertices(mesh, average_to_vertices(mesh, mesh.normals), 8)
    mean = average_to_faces(mesh, mean)
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-12)
    hard = np.flatnonzero((mean * mesh.normals).sum(1) < DIFFERS)
    chosen = rng.choice(hard, min(len(hard), 2 * ROWS // 3), replace=False)
    others = rng.choice(mesh.face_count, min(mesh.face_count, ROWS // 3), replace=False)
    return np.unique(np.concatenate([chosen, others]))
