# SPDX-License-Identifier: GPL-3.0-or-later
"""Train the networks that mix smoothed normals for denoising.

``python tools/training/train_denoising.py`` makes meshes from seeds, trains on them, and writes
``core/shape/denoise.npz``. It needs the packages of the extra ``training``, and less than 40
minutes on two cores. Meshes are stored in the folder, so that a stopped run can continue.
"""

from __future__ import annotations

import argparse
import os
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the same sums on any machine

import adam
import numpy as np
from denoise_examples import (
    cage,
    displaced,
    divided,
    drawn,
    example,
    export,
    figure,
    rough,
    scan,
    short,
    steep,
)
from scripts import meaning_of
from shock_filter import core
from shock_filter.core.base import parallel
from shock_filter.core.mixture.choice import free_mixture
from shock_filter.core.mixture.network import Network, load, save
from shock_filter.core.shape.learned import STAGES, WEIGHTS, found_in_stage
from shock_filter.core.shape.smoothings import DEFINITION, GIVEN

HERE = Path(__file__).resolve().parent

MADE_OF = ("adam.py", "crease_examples.py", "denoise_examples.py", "depth_cameras.py",
           "distances.py", "even_meshes.py", "exports.py", "meshings.py", "solids.py",
           "train_denoising.py")  # fmt: skip
"""The scripts that the networks depend on."""

VERSION = 7
"""Number of shipped trainings."""

MAKERS = {"solid": example, "white": partial(example, kind="white"),
          "field": partial(example, kind="field"), "range": partial(example, kind="range"),
          "figure": figure, "displaced": displaced, "drawn": drawn, "cage": cage,
          "divided": divided, "rough": rough, "steep": steep, "short": short,
          "export": export, "scan": scan}  # fmt: skip
COUNTS = {"solid": 1500, "white": 200, "field": 150, "range": 200, "figure": 350, "displaced": 350,
          "drawn": 160, "cage": 400, "divided": 250, "rough": 150, "steep": 400,
          "short": 300, "export": 400, "scan": 400}  # fmt: skip
"""Number of seeds for each of `MAKERS`."""

LATE = "cage", "divided", "rough", "steep", "short", "export"
"""Names of makers that only the last stage is trained on."""

CLEAN_ONLY = ("short",)
"""Names of makers of which only meshes without noise are used. Noisy relief of so few edges a wave
teaches the network to smooth springs and letters of exports."""

FACES, ROWS = (24, 60_000), (400, 1600)
"""Fewest and most faces of a mesh that is used; and fewest and most faces sampled from a mesh.
Small meshes are sampled with replacement."""

FEWEST_OF_SOLIDS = 1500
"""Fewest faces of solids meshed from voxels: with fewer, their shape is lost."""

HIDDEN = 128, 64
"""Sizes of the hidden layers."""

EPOCHS = 10, 10, 16
"""Of each stage."""

KEPT_ASIDE = 16
"""One mesh in this many is for validation, not for training."""

USUAL = 1.5
"""Degrees. The weight of a mesh is 1 / (mean error of its best candidate + this)."""

UNTOUCHED = {"modelled": 2.0, "decimated": 2.0, "subdivided": 2.0, "uneven": 2.0, "figure": 2.0,
             "displaced": 2.0, "drawn": 2.0, "divided": 2.0, "export": 2.0}  # fmt: skip
"""Factors of that weight for kinds of meshes without noise; noisy kinds have 1."""

IN_DOUBT = 3.0
"""Added after training to the bias of the score of a face's input normal: this reduces the changes
of coarse models unlike the training set by up to a fifth, and denoises noisy meshes just as well.
"""

TURNED = np.cos(np.radians(60.0))
"""Cosine of the angle between the true normal and the nearest candidate. Faces below it are left
out: they lie on the wrong side of a thin wall."""


def made(job: tuple[str, int], folder: Path) -> Path | None:
    """Make a mesh, unless it is in the folder already."""
    name, seed = job
    path = folder / f"denoise_{name}_{seed}.npz"
    if path.exists():
        return path
    try:
        mesh, truth, kind = MAKERS[name](seed)
    except (IndexError, ValueError, core.ShockError):  # the solid is empty
        return None
    if name in CLEAN_ONLY and kind.startswith("noisy"):
        return None
    of_solid = kind in ("clean", "crisp", "white", "field", "both", "binary", "range", "scan")
    if not (FEWEST_OF_SOLIDS if of_solid else FACES[0]) <= mesh.face_count <= FACES[1]:
        return None
    part = path.with_suffix(".part")
    with part.open("wb") as file:
        np.savez(file, vertices=mesh.vertices, faces=mesh.faces, truth=truth.astype(np.float32),
                 kind=kind)  # fmt: skip
    part.rename(path)
    return path


def table(path: Path, networks: list[Network]) -> dict[str, np.ndarray]:
    """Compute the training data of one mesh for the network after `networks`."""
    with np.load(path) as data:
        mesh = core.TriangleMesh(data["vertices"], data["faces"])
        truth, kind = data["truth"], data["kind"].item()
    found = found_in_stage(mesh, networks)
    seed = int(path.stem.rsplit("_", 1)[1])
    rng = np.random.default_rng(seed)
    faces = np.flatnonzero(mesh.areas > 0)
    fewest, most = ROWS
    count = min(max(len(faces), fewest), most)
    rows = rng.choice(faces, count, replace=len(faces) < count)
    candidates, told = found.told(mesh, rows)
    cosines = (candidates * truth[rows][:, None]).sum(2)
    keep = cosines.max(1) > TURNED
    off = np.degrees(np.arccos(np.clip(cosines, -1, 1))).mean(0).min() if len(rows) else 0.0
    weight = UNTOUCHED.get(kind, 1.0) / (off + USUAL)
    count = int(keep.sum())
    return {
        "told": told[keep], "candidates": candidates[keep], "targets": truth[rows[keep]],
        "weights": np.full(count, weight, np.float32),
        "aside": np.full(count, seed % KEPT_ASIDE == 0), "kind": np.full(count, kind, "U24"),
    }  # fmt: skip


def errors(network: Network, rows: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors, in degrees, of the normals before a stage and of its mixtures."""
    mixed = free_mixture(rows["candidates"], network.scores(rows["told"]))
    pair = []
    for normals in (rows["candidates"][:, 0], mixed):
        cosines = (normals * rows["targets"]).sum(1)
        pair.append(np.degrees(np.arccos(np.clip(cosines, -1, 1))))
    return pair[0], pair[1]


def gathered(function, jobs: list, processes: int) -> list:
    """Call a function for each job, in parallel processes if there are several."""
    if processes == 1:
        return [function(job) for job in jobs]
    with ProcessPoolExecutor(processes, initializer=_alone) as pool:
        return list(pool.map(function, jobs, chunksize=8))


def _alone() -> None:
    parallel.most_threads = 1  # other cores run other processes


def make_all(counts: dict[str, int], folder: Path, processes: int) -> list[Path]:
    """Make a number of meshes for each maker."""
    folder.mkdir(parents=True, exist_ok=True)
    jobs = [(name, seed) for name, count in counts.items() for seed in range(count)]
    found = gathered(partial(made, folder=folder), jobs, processes)
    return [path for path in found if path is not None]


def train(
    paths: list[Path], processes: int = 1, epochs=EPOCHS, hidden=HIDDEN, log=print, begun=()
) -> dict[str, Network]:
    """Train the stages in turn, and log their errors on validation meshes.

    `epochs` are those of each stage. `begun` are networks of the first stages, if they are trained
    already.
    """
    networks: list[Network] = list(begun)
    for stage, name in list(enumerate(STAGES))[len(networks) :]:
        chosen = [path for path in paths if stage == len(STAGES) - 1 or not _is_late(path)]
        each = gathered(partial(table, networks=networks), chosen, processes)
        held = [bool(part["aside"].any()) for part in each]
        aside = _together([part for part, off in zip(each, held, strict=True) if off])
        rows = _together([part for part, off in zip(each, held, strict=True) if not off])
        del each
        log(f"{name}: {rows['told'].shape} rows, {aside['told'].shape} aside")
        weights = rows["weights"].astype(np.float64)
        weights = (weights / weights.mean()).astype(np.float32)
        network = adam.trained_free_mixture(
            rows["told"],
            rows["candidates"],
            rows["targets"],
            weights,
            hidden,
            epochs[stage],
            seed=stage,
            log=log,
        )
        del rows
        tell(network, aside, log)
        networks.append(network)
    networks[-1] = hesitant(networks[-1])
    facts = {"definition": DEFINITION, "made_of": made_of(), "version": VERSION}
    return {name: replace(each, **facts) for name, each in zip(STAGES, networks, strict=True)}


def hesitant(network: Network) -> Network:
    """Raise the score of the input normals by `IN_DOUBT`."""
    *shifts, last = network.shifts
    last = last + np.float32(IN_DOUBT) * (np.arange(len(last)) == GIVEN)
    return replace(network, shifts=(*shifts, last.astype(np.float32)))


def _is_late(path: Path) -> bool:
    return path.stem.split("_")[1] in LATE


def _together(each: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    # Concatenates large parts, and frees each one once it is copied.
    rows = {}
    for key in list(each[0]):
        parts = [part.pop(key) for part in each]
        count = sum(map(len, parts))
        rows[key] = np.empty((count, *parts[0].shape[1:]), parts[0].dtype)
        end = count
        while parts:
            part = parts.pop()
            rows[key][end - len(part) : end] = part
            end -= len(part)
    return rows


def tell(network: Network, aside: dict[str, np.ndarray], log) -> None:
    """Log the errors on validation meshes, before and after a stage."""
    own, new = errors(network, aside)
    for kind in (*np.unique(aside["kind"]), "all"):
        at = (aside["kind"] == kind) | (kind == "all")
        log(f"{kind:24s} {at.sum():7d} {own[at].mean():6.2f} -> {new[at].mean():6.2f}")


def made_of() -> str:
    """Return the digest of the scripts that the networks depend on."""
    return meaning_of(HERE / name for name in MADE_OF)


def main() -> None:
    """Make meshes, train, and write the networks."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--folder", type=Path, default=HERE / ".made", help="for made meshes")
    parser.add_argument("--out", type=Path, default=WEIGHTS)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--share", type=float, default=1.0, help="of all that is made, to try out")
    parser.add_argument("--last", action="store_true", help="train the last stage only")
    options = parser.parse_args()
    begin = time.time()
    log = lambda text: print(f"{time.time() - begin:6.0f} s  {text}", flush=True)  # noqa: E731
    counts = {name: max(int(options.share * count), 1) for name, count in COUNTS.items()}
    paths = make_all(counts, options.folder, options.processes)
    log(f"{len(paths)} meshes")
    begun = [load(WEIGHTS, DEFINITION)[name] for name in STAGES[:-1]] if options.last else []
    save(options.out, train(paths, options.processes, log=log, begun=begun))
    log(f"written: {options.out}")


if __name__ == "__main__":
    main()
