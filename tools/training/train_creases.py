# SPDX-License-Identifier: GPL-3.0-or-later
"""Train the networks that weigh candidate normals of faces along creases.

``python tools/training/train_creases.py`` makes meshes from seeds, trains on them, and writes
``core/shape/creases.npz``. It needs the packages of the extra ``training``, and about half an hour
on two cores. Meshes are stored in the folder, so that a stopped run can continue.
"""

from __future__ import annotations

import argparse
import os
import time
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the same sums on any machine

import adam
import numpy as np
from made import make_all
from scripts import meaning_of
from shock_filter import core
from shock_filter.core.mixture.choice import mixture
from shock_filter.core.mixture.network import Network, save
from shock_filter.core.shape.candidates import DEFINITION, TOLD_FIRST, find_candidates
from shock_filter.core.shape.creases import WEIGHTS

HERE = Path(__file__).resolve().parent

MADE_OF = ("adam.py", "crease_examples.py", "denoise_examples.py", "distances.py",
           "even_meshes.py", "made.py", "meshings.py", "solids.py", "train_creases.py")  # fmt: skip
"""The scripts that the networks depend on."""

VERSION = 7
"""Number of shipped trainings."""

COUNTS = {"remeshed": 1300, "narrow": 350, "coarse": 350, "relief": 225, "scanned": 175,
          "modelled": 960, "softened": 210, "sculpted": 700, "sharp": 390,
          "decimated": 790, "exact": 440, "voxels": 1900, "subdivided": 350,
          "displaced": 700, "cage": 900, "drawn": 500, "divided": 400, "lettered": 350,
          "preserved": 1200}  # fmt: skip
"""Number of seeds for each of `made.MAKERS`."""

HIDDEN = 128, 64
GATE = (24,)
"""Sizes of the hidden layers of the two networks."""

EPOCHS, GATE_EPOCHS = 10, 3
KEPT_ASIDE = 12
"""One mesh in this many is for validation, not for training."""

BLOCK = 256
"""Number of meshes whose training data are one block of memory."""

PIECE = 1 << 18
"""Number of rows per call of a network."""

TURNS = 2.0
"""Turn in degrees, by the mixture, above which the gate should let a face pass."""

MISSED = 0.01
"""Share of the sum of all turns that the gate may miss."""

HARM = 0.5
"""How much more a face counts, as a share, while it is farther from its target than the input."""

IN_DOUBT = 2.5
"""Added after training to the bias of the score of a face's own normal: models unlike the training
set then change less."""

USUAL, AS_IT_IS = 5.0, 5.0
"""Degrees. The weight of a mesh is 1 / (its mean error + the first), or 1 / the second if its own
normals are the targets."""


def made_of() -> str:
    """Return the digest of the scripts that the networks depend on."""
    return meaning_of(HERE / name for name in MADE_OF)


def table(path: Path) -> dict[str, np.ndarray] | None:
    """Compute the training data of one mesh; None if no sampled face has candidates."""
    with np.load(path) as data:
        mesh = core.TriangleMesh(data["vertices"], data["faces"])
        rows, one, two, kind = data["rows"], data["one"], data["two"], data["kind"].item()
    found = find_candidates(mesh, core.GeometrySettings(), None)
    place = np.full(mesh.face_count, -1)
    place[found.rows] = np.arange(len(found.rows))
    asked = place[rows] >= 0
    rows, one, two = rows[asked], one[asked], two[asked]
    if len(rows) == 0:
        return None
    told, candidates = found.told[place[rows]], found.normals[place[rows]]
    targets = np.stack([one, two], 1)
    near = (candidates[:, :, None] * targets[:, None]).sum(3)
    keep = near.max((1, 2)) > 0.3  # not faces on the wrong side of a thin wall
    own = near[keep, 0].max(1)
    off = np.degrees(np.arccos(np.clip(own, -1, 1))).mean() if keep.any() else 0.0
    count = int(keep.sum())
    weight = weight_of(off)
    name, seed = path.stem.rsplit("_", 1)
    return {
        "told": told[keep], "candidates": candidates[keep], "targets": targets[keep],
        "weights": np.full(count, weight, np.float32),
        "aside": np.full(count, int(seed) % KEPT_ASIDE == 0),
        "kind": np.full(count, f"{name} {kind}".encode(), "S24"),
    }  # fmt: skip


def weight_of(off: float) -> float:
    """Return the weight of the rows of a mesh whose mean error is `off` degrees."""
    return 1 / (off + USUAL if off > 0.1 else AS_IT_IS)


def errors(network: Network, rows: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors of own and of mixed normals: degrees to the nearer target."""
    mixed, _ = mixture(rows["candidates"], network.scores(rows["told"]))
    pair = []
    for normals in (rows["candidates"][:, 0], mixed):
        near = (normals[:, None] * rows["targets"]).sum(2).max(1)
        pair.append(np.degrees(np.arccos(np.clip(near, -1, 1))))
    return pair[0], pair[1]


def gathered(paths: list[Path], processes: int) -> dict[str, np.ndarray]:
    """Compute the training data of all meshes; the validation set comes last."""
    learned, aside = _Rows(), _Rows()
    with ExitStack() as stack:
        found = map(table, paths)
        if processes > 1:
            pool = stack.enter_context(ProcessPoolExecutor(processes))
            found = pool.map(table, paths, chunksize=16)
        for rows in found:
            if rows is not None:
                (aside if rows["aside"].any() else learned).append(rows)
    return together(learned.blocks() + aside.blocks())


class _Rows:
    # Collects small arrays in large blocks, whose memory the system gets back when they are freed.

    def __init__(self) -> None:
        self._large: list[dict[str, np.ndarray]] = []
        self._small: list[dict[str, np.ndarray]] = []

    def append(self, rows: dict[str, np.ndarray]) -> None:
        self._small.append(rows)
        if len(self._small) == BLOCK:
            self._large.append(together(self._small))
            self._small = []

    def blocks(self) -> list[dict[str, np.ndarray]]:
        return self._large + self._small


def together(parts: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Concatenate arrays of the same names, which are removed from the parts."""
    return {name: np.concatenate([rows.pop(name) for rows in parts]) for name in list(parts[0])}


def chosen(rows: dict[str, np.ndarray], which: slice | np.ndarray) -> dict[str, np.ndarray]:
    return {name: values[which] for name, values in rows.items()}


def train(rows: dict[str, np.ndarray], epochs: int = EPOCHS, log=print) -> dict[str, Network]:
    """Train the networks on the training set, and log their errors on the validation set."""
    first = int(np.count_nonzero(~rows["aside"]))
    learned, aside = chosen(rows, slice(first)), chosen(rows, slice(first, None))
    weights = learned["weights"] / learned["weights"].mean()
    network = adam.trained_mixture(learned["told"], learned["candidates"], learned["targets"],
                                   weights, HIDDEN, epochs, log=log, harm=HARM)  # fmt: skip
    if len(aside["kind"]):
        own, new = errors(network, aside)
        for kind in np.unique(aside["kind"]):
            at = aside["kind"] == kind
            log(f"{kind.decode():24s} {at.sum():7d} {own[at].mean():6.2f} -> {new[at].mean():6.2f}")
        log(f"{'all':24s} {len(own):7d} {own.mean():6.2f} -> {new.mean():6.2f}")
        if new.mean() >= own.mean():
            raise RuntimeError("Nothing was learned: all faces keep their normals.")
    gate = train_gate(learned, aside, network, min(GATE_EPOCHS, epochs), log)
    *shifts, last = network.shifts
    last = last + np.where(np.arange(len(last)) == 0, np.float32(IN_DOUBT), np.float32(0))
    network = replace(network, shifts=(*shifts, last))
    facts = {"definition": DEFINITION, "made_of": made_of(), "version": VERSION}
    return {"mixture": replace(network, **facts), "gate": replace(gate, **facts)}


def train_gate(learned, aside, network: Network, epochs: int, log) -> Network:
    """Train the gate to predict, from the features of `TOLD_FIRST`, which faces a mixture turns."""
    told, turns = told_first(learned), turns_of(network, learned)
    wanted = np.where(turns > TURNS, 1 + turns / 5, 0).astype(np.float32)
    gate = adam.trained_gate(told, wanted, GATE, epochs, log=log)
    # Shifts the threshold so that the allowed share of turns is missed.
    scores = gate.scores(told)[:, 0]
    order = np.argsort(scores)
    missed = np.cumsum(np.where(wanted > 0, turns, 0)[order])
    last = max(int(np.searchsorted(missed, MISSED * max(missed[-1], 1e-12))), 0)
    shift = gate.shifts[-1] - scores[order[min(last, len(order) - 1)]]
    gate = replace(gate, shifts=(*gate.shifts[:-1], shift.astype(np.float32)))
    if len(aside["kind"]):
        turns = turns_of(network, aside)
        passed = gate.scores(told_first(aside))[:, 0] > 0
        for kind in np.unique(aside["kind"]):
            at = aside["kind"] == kind
            log(f"gate {kind.decode():24s} {passed[at].mean():5.1%}")
        missed = turns[~passed & (turns > TURNS)].sum() / max(turns.sum(), 1e-12)
        log(f"gate: {passed.mean():.1%} of the faces pass, {missed:.2%} of the turns are missed")
    return gate


def told_first(rows: dict[str, np.ndarray]) -> np.ndarray:
    """Return the features that the gate sees."""
    found = np.empty((len(rows["told"]), len(TOLD_FIRST)), np.float32)
    for first in range(0, len(found), PIECE):  # indexing all at once would need twice the memory
        found[first : first + PIECE] = rows["told"][first : first + PIECE][:, TOLD_FIRST]
    return found


def turns_of(network: Network, rows: dict[str, np.ndarray]) -> np.ndarray:
    """Return the turns by the mixtures: degrees from the faces' own normals."""
    found = np.empty(len(rows["told"]), np.float32)
    for first in range(0, len(found), PIECE):  # one call for all would need much memory
        piece = slice(first, first + PIECE)
        candidates = rows["candidates"][piece]
        mixed, _ = mixture(candidates, network.scores(rows["told"][piece]))
        cosines = (mixed * candidates[:, 0]).sum(1)
        found[piece] = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    return found


def main() -> None:
    """Make examples, train, and write the networks."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--folder", type=Path, default=HERE / ".made", help="for made solids")
    parser.add_argument("--out", type=Path, default=WEIGHTS)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--share", type=float, default=1.0, help="of all that is made, to try out")
    options = parser.parse_args()
    begin = time.time()
    log = lambda text: print(f"{time.time() - begin:6.0f} s  {text}", flush=True)  # noqa: E731
    counts = {name: max(int(options.share * count), 1) for name, count in COUNTS.items()}
    paths = make_all(counts, options.folder, options.processes)
    log(f"{len(paths)} meshes")
    rows = gathered(paths, options.processes)
    log(f"{rows['told'].shape} rows")
    save(options.out, train(rows, log=log))
    log(f"written: {options.out}")


if __name__ == "__main__":
    main()
