# SPDX-License-Identifier: GPL-3.0-or-later
"""Train the network that weighs the normals of faces along creases.

``python tools/training/train_creases.py`` makes solids from seeds, learns from them, and writes
``core/shape/creases.npz``. It needs what the extra ``training`` names, and some twenty minutes
on two cores. Made solids stay in the folder, so that a run that was stopped goes on.
"""

from __future__ import annotations

import argparse
import os
import time
from concurrent.futures import ProcessPoolExecutor
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
"""The scripts that the networks come from."""

VERSION = 4
"""Counts the trainings that were shipped."""

COUNTS = {"remeshed": 1300, "narrow": 350, "coarse": 350, "relief": 225, "scanned": 175,
          "modelled": 960, "softened": 210, "sculpted": 700, "sharp": 390,
          "decimated": 790, "exact": 440, "voxels": 1900, "subdivided": 350,
          "displaced": 700, "cage": 900, "drawn": 500, "divided": 400}  # fmt: skip
"""How many seeds of each kind; see `made.MAKERS`."""

HIDDEN = 128, 64
GATE = (24,)
"""Sizes of the inner layers of both networks."""

EPOCHS, GATE_EPOCHS = 10, 3
KEPT_ASIDE = 12
"""One mesh in so many tells the error and is not learned from."""

PIECE = 1 << 18
"""Rows that are looked at at once."""

TURNS = 2.0
"""Degrees that a mixture turns a face, from which the gate is to let it pass."""

MISSED = 0.01
"""Share of all turns that the gate may miss."""

IN_DOUBT = 3.5
"""What is added, at last, to the score of a face's own normal: models that nobody here has seen
change by half as much, and parts are closed as well."""

FEWEST_ROWS = 600
"""A mesh of fewer counts as one of so many."""

USUAL, AS_IT_IS = 5.0, 5.0
"""Degrees: a mesh counts the less the more wrong it is, beyond the first; and how much those count
that are as they should be."""


def made_of() -> str:
    """Digest of the scripts that the networks come from."""
    return meaning_of(HERE / name for name in MADE_OF)


def table(path: Path) -> dict[str, np.ndarray] | None:
    """What is learned from one mesh."""
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
    keep = near.max((1, 2)) > 0.3  # faces of the other side say nothing
    own = near[keep, 0].max(1)
    off = np.degrees(np.arccos(np.clip(own, -1, 1))).mean() if keep.any() else 0.0
    count = int(keep.sum())
    weight = weight_of(off) * max(FEWEST_ROWS / max(count, 1), 1)
    name, seed = path.stem.rsplit("_", 1)
    return {
        "told": told[keep], "candidates": candidates[keep], "targets": targets[keep],
        "weights": np.full(count, weight, np.float32),
        "aside": np.full(count, int(seed) % KEPT_ASIDE == 0),
        "kind": np.full(count, f"{name} {kind}".encode(), "S24"),
    }  # fmt: skip


def weight_of(off: float) -> float:
    """How much the rows of a mesh count that is wrong by so many degrees in the mean."""
    return 1 / (off + USUAL if off > 0.1 else AS_IT_IS)


def errors(network: Network, rows: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Degrees to the nearer target, of faces' own normals and of the mixtures."""
    mixed, _ = mixture(rows["candidates"], network.scores(rows["told"]))
    pair = []
    for normals in (rows["candidates"][:, 0], mixed):
        near = (normals[:, None] * rows["targets"]).sum(2).max(1)
        pair.append(np.degrees(np.arccos(np.clip(near, -1, 1))))
    return pair[0], pair[1]


def gathered(paths: list[Path], processes: int) -> dict[str, np.ndarray]:
    if processes == 1:
        found = [table(path) for path in paths]
    else:
        with ProcessPoolExecutor(processes) as pool:
            found = list(pool.map(table, paths, chunksize=16))
    # Those kept aside come last, so that both are views.
    found = [rows for rows in found if rows is not None]
    found.sort(key=lambda rows: bool(rows["aside"].any()))
    return {name: np.concatenate([rows.pop(name) for rows in found]) for name in list(found[0])}


def chosen(rows: dict[str, np.ndarray], which: slice | np.ndarray) -> dict[str, np.ndarray]:
    return {name: values[which] for name, values in rows.items()}


def train(rows: dict[str, np.ndarray], epochs: int = EPOCHS, log=print) -> dict[str, Network]:
    """Learn from the rows that are not kept aside, and say how well it does on the others."""
    first = int(np.count_nonzero(~rows["aside"]))
    learned, aside = chosen(rows, slice(first)), chosen(rows, slice(first, None))
    weights = learned["weights"] / learned["weights"].mean()
    network = adam.trained_mixture(learned["told"], learned["candidates"], learned["targets"],
                                   weights, HIDDEN, epochs, log=log)  # fmt: skip
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
    """Learn which faces a mixture turns, from what is known before anything takes sides."""
    told, turns = learned["told"][:, TOLD_FIRST], turns_of(network, learned)
    wanted = np.where(turns > TURNS, 1 + turns / 5, 0).astype(np.float32)
    gate = adam.trained_gate(np.ascontiguousarray(told), wanted, GATE, epochs, log=log)
    # As low as the missed turns allow.
    scores = gate.scores(np.ascontiguousarray(told))[:, 0]
    order = np.argsort(scores)
    missed = np.cumsum(np.where(wanted > 0, turns, 0)[order])
    last = max(int(np.searchsorted(missed, MISSED * max(missed[-1], 1e-12))), 0)
    shift = gate.shifts[-1] - scores[order[min(last, len(order) - 1)]]
    gate = replace(gate, shifts=(*gate.shifts[:-1], shift.astype(np.float32)))
    if len(aside["kind"]):
        told, turns = aside["told"][:, TOLD_FIRST], turns_of(network, aside)
        passed = gate.scores(np.ascontiguousarray(told))[:, 0] > 0
        for kind in np.unique(aside["kind"]):
            at = aside["kind"] == kind
            log(f"gate {kind.decode():24s} {passed[at].mean():5.1%}")
        missed = turns[~passed & (turns > TURNS)].sum() / max(turns.sum(), 1e-12)
        log(f"gate: {passed.mean():.1%} of the faces pass, {missed:.2%} of the turns are missed")
    return gate


def turns_of(network: Network, rows: dict[str, np.ndarray]) -> np.ndarray:
    """Degrees between the mixtures and the faces' own normals."""
    found = np.empty(len(rows["told"]), np.float32)
    for first in range(0, len(found), PIECE):  # all at once would take as much memory again
        piece = slice(first, first + PIECE)
        candidates = rows["candidates"][piece]
        mixed, _ = mixture(candidates, network.scores(rows["told"][piece]))
        cosines = (mixed * candidates[:, 0]).sum(1)
        found[piece] = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    return found


def main() -> None:
    """Make solids, learn, write."""
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
