# SPDX-License-Identifier: GPL-3.0-or-later
"""Train the networks that sharpen vertex colors, starting from those for images.

``python tools/training/train_meshes.py`` makes pictures and meshes from seeds, trains on them, and
writes ``core/color/learned/vertices.npz``. It needs what `train_images` needs, and scikit-image.
Pictures are stored in the folder, so that a stopped run can continue.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import adam
import numpy as np
from mesh_pictures import example
from scripts import meaning_of
from shock_filter import core
from shock_filter.core.color.learned.first import First
from shock_filter.core.color.learned.recipe import (
    FAINT,
    STAGES,
    Wishes,
    mixed,
    networks,
    second_of,
)
from shock_filter.core.color.vertex_planes import VertexPlanes, Vertices
from shock_filter.core.color.vertices_learned import DEFINITION as DEFINITION_OF_VERTICES
from shock_filter.core.color.vertices_learned import WEIGHTS, detail_at
from shock_filter.core.mixture.network import Network, save
from train_images import ANYWHERE, KEPT_ASIDE, PictureLoss, gains, gathered, joined

HERE = Path(__file__).resolve().parent

MADE_OF = ("adam.py", "image_examples.py", "mesh_pictures.py", "train_images.py",
           "train_meshes.py")  # fmt: skip
"""The scripts that the networks depend on, besides the networks for images."""

VERSION = 1
"""Number of shipped trainings."""

FIRST_SEED, COUNT = 50000, 800

CHOSEN = 700
"""Number of vertices sampled from each mesh."""

EPOCHS, RATE = 10, 1e-3

NONE = np.empty(0, np.float32)

BESIDE = 1
"""Number of additional features of the networks for meshes."""


def made(seed: int, folder: Path) -> Path:
    """Make a mesh with values and degraded copies, unless it is in the folder already."""
    path = folder / f"mesh_{seed}.npz"
    if not path.exists():
        vertices, faces, truth, spoiled = example(seed)
        part = path.with_suffix(".part")
        with part.open("wb") as file:
            np.savez(file, vertices=vertices, faces=faces, truth=truth,
                     given=[values for values, _ in spoiled],
                     same=[same for _, same in spoiled])  # fmt: skip
        part.rename(path)
    return path


def table(path: Path, nets: list[Network]) -> list[dict[str, np.ndarray]]:
    """Compute the training data of one mesh for the network after `nets`."""
    seed = int(path.stem.rpartition("_")[2])
    random = np.random.default_rng([seed, len(nets)])
    with np.load(path) as data:
        vertices = Vertices(core.TriangleMesh(data["vertices"], data["faces"]))
        truth = vertices.planes_of(data["truth"])
        pairs = list(zip(data["given"], data["same"], strict=True))
    even = float(np.median(vertices.unevenness)) < 0.01
    found = []
    for values, same in pairs:
        planes = VertexPlanes.of_vertices(vertices, values)
        wishes = Wishes(FAINT * detail_at(planes))
        stage = first = First(planes, wishes.floor)
        if nets:
            result, shares = mixed(first, nets[0])
            stage = second_of(first, planes.with_values(result), shares, NONE, wishes)
        error = float(((truth - planes.values) ** 2).sum() / truth[0].size / 3)
        error *= truth[0].size / vertices.mesh.vertex_count
        found.append({
            **rows_of(stage, truth, random), "error": np.array([error]),
            "same": np.array([same]), "even": np.array([even]),
            "aside": np.array([seed % KEPT_ASIDE == 0]),
        })  # fmt: skip
    return found


def rows_of(stage, truth: np.ndarray, random: np.random.Generator) -> dict[str, np.ndarray]:
    """Sample training data of vertices, as `train_images.pixels_of` of pixels."""
    c, height, _ = stage.base.shape
    count = stage.planes.vertices.mesh.vertex_count
    strip = stage.strip(0, height)
    differences, told = strip.rows(0, height)
    differences = differences.reshape(len(differences), c, -1)[..., :count]
    told = told.reshape(len(told), -1)[:, :count]
    more = stage.planes.told(0, height)
    told = np.concatenate([told, more.reshape(len(more), -1)[:, :count]])
    _, low, high = strip.limits
    missing, low, high = (
        (wanted - stage.base).reshape(c, -1)[:, :count] for wanted in (truth, low, high)
    )  # fmt: skip
    energy = (differences**2).sum((0, 1), dtype=np.float64) + (missing**2).sum(0)
    share = np.full(count, 1 / count)
    if energy.sum() > 0:
        share = ANYWHERE * share + (1 - ANYWHERE) * energy / energy.sum()
    rows = random.choice(count, CHOSEN, p=share / share.sum())
    return {
        "told": told[:, rows].T, "differences": differences[:, :, rows].transpose(2, 0, 1),
        "missing": missing[:, rows].T, "low": low[:, rows].T, "high": high[:, rows].T,
        "weights": (1 / (share[rows] * count)).astype(np.float32),
    }  # fmt: skip


def begun(network: Network) -> Network:
    """Add inputs of weight 0, for the additional features of meshes, to a network for images."""
    first = np.pad(network.weights[0], ((0, BESIDE), (0, 0)))
    return replace(network, weights=(first, *network.weights[1:]))


def train(paths: list[Path], processes: int, log=print) -> dict[str, Network]:
    """Train the networks further, and log the gain on validation meshes."""
    found: list[Network] = []
    facts = {"definition": DEFINITION_OF_VERTICES, "made_of": made_of(), "version": VERSION}
    for stage, start in enumerate(map(begun, networks())):
        tables = gathered(partial(table, nets=found), paths, processes)
        each = [part for parts in tables for part in parts]
        learned, aside = (
            joined([part for part in each if part["aside"][0] == kept]) for kept in (False, True)
        )
        del tables, each
        log(f"{STAGES[stage]}: {learned['told'].shape} rows")
        loss = PictureLoss(learned)
        network = adam.trained_on(start, learned["told"], loss, EPOCHS, RATE, stage, log)
        for which, net in (("of images", start), ("learned on", network)):
            gain, same, even = gains(net, aside), aside["same"], aside["even"]
            kinds = {"spoiled": ~same, "of these on even meshes": ~same & even, "sharp": same}
            means = [
                f"{kind} {gain[some].mean():.3f}" for kind, some in kinds.items() if some.any()
            ]
            log(
                f"{which}: mean gain in dB: {', '.join(means)};"
                f" worse by .1: {(gain < -0.1).mean():.3f}, by .5: {(gain < -0.5).mean():.3f}"
            )
        found.append(replace(network, **facts))
    return dict(zip(STAGES, found, strict=True))


def made_of() -> str:
    """Return the digest of the scripts that the networks depend on."""
    return meaning_of(HERE / name for name in MADE_OF)


def main() -> None:
    """Make examples, train, and write the networks."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--folder", type=Path, default=HERE / ".made", help="for made pictures")
    parser.add_argument("--out", type=Path, default=WEIGHTS)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--share", type=float, default=1.0, help="of all that is made, to try out")
    options = parser.parse_args()
    begin = time.time()
    log = lambda text: print(f"{time.time() - begin:6.0f} s  {text}", flush=True)  # noqa: E731
    options.folder.mkdir(parents=True, exist_ok=True)
    count = max(int(options.share * COUNT), 1)
    seeds = range(FIRST_SEED, FIRST_SEED + count)
    paths = gathered(partial(made, folder=options.folder), list(seeds), options.processes)
    log(f"{len(paths)} pictures")
    save(options.out, train(paths, options.processes, log=log))
    log(f"written: {options.out}")


if __name__ == "__main__":
    main()
