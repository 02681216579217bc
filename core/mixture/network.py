# SPDX-License-Identifier: GPL-3.0-or-later
"""Small networks of fully connected layers, and their files."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..base.parallel import chunk_size, kernel, run

Singles = npt.NDArray[np.float32]

_CHUNK = 2048
"""Most rows per chunk of a thread; small, because a row costs more here than in other kernels."""


@dataclass(frozen=True)
class Network:
    """A network of fully connected layers with ReLU between them, and its origin.

    Attributes
    ----------
    weights : tuple of (inputs, outputs) float32
        One matrix for each layer.
    shifts : tuple of (outputs,) float32
        The biases of each layer.
    definition : str
        Digest of what its inputs and outputs mean; see `digest`.
    made_of : str
        Digest of the scripts that trained it.
    version : int
        Number of shipped trainings, including this one.
    """

    weights: tuple[Singles, ...]
    shifts: tuple[Singles, ...]
    definition: str = ""
    made_of: str = ""
    version: int = 0

    def scores(self, told: Singles) -> Singles:
        """Evaluate the network for rows of features: (n, inputs) -> (n, outputs) float32.

        Each row is computed by itself, in a fixed order, so its bits do not depend on other rows
        or the number of threads.
        """
        rows = told
        chunk = min(_CHUNK, chunk_size(len(rows)))
        for i, (weights, shift) in enumerate(zip(self.weights, self.shifts, strict=True)):
            out = np.empty((len(rows), len(shift)), dtype=np.float32)
            last = i + 1 == len(self.weights)
            run(_layer, len(rows), rows, weights, shift, last, out, chunk=chunk)
            rows = out
        return rows

    def of_columns(self, told: Singles) -> Singles:
        """Evaluate the network for columns of features: (inputs, n) -> (outputs, n).

        Meant for some thousand columns at once, on one thread. The bits of a column do not depend
        on others, but may differ in the last places from those of `scores`.
        """
        columns = told
        for i, (weights, shift) in enumerate(zip(self.weights, self.shifts, strict=True)):
            out = np.empty((len(shift), columns.shape[1]), dtype=np.float32)
            _layer_of_columns(columns, weights, shift, i + 1 == len(self.weights), out)
            columns = out
        return columns


def digest(*texts: str) -> str:
    """Return a hash of texts, of 16 hexadecimal digits."""
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()[:16]


def load(path: Path, definition: str) -> dict[str, Network]:
    """Read the networks of a file, by name.

    Parameters
    ----------
    path : Path
        A file written by `save`.
    definition : str
        Digest of what inputs and outputs mean in the calling code.

    Raises
    ------
    ValueError
        If they were trained for another definition.
    """
    with np.load(path, allow_pickle=False) as data:
        arrays = {key: data[key] for key in data.files}
    facts = {name: arrays.pop(name).item() for name in ("definition", "made_of", "version")}
    if facts["definition"] != definition:
        raise ValueError(f"{path.name} was trained for other inputs; train it again.")
    found = {}
    for name in {key.partition(".")[0] for key in arrays}:
        count = sum(key.startswith(f"{name}.weights") for key in arrays)
        weights, shifts = (
            tuple(arrays[f"{name}.{what}{i}"].astype(np.float32) for i in range(count))
            for what in ("weights", "shift")
        )
        found[name] = Network(weights, shifts, **facts)
    return found


def save(path: Path, networks: dict[str, Network]) -> None:
    """Write the networks of one training to a file; weights are rounded to half precision."""
    arrays: dict[str, npt.NDArray] = {}
    for name, network in networks.items():
        for i, (weights, shift) in enumerate(zip(network.weights, network.shifts, strict=True)):
            arrays[f"{name}.weights{i}"] = weights.astype(np.float16)
            arrays[f"{name}.shift{i}"] = shift
    facts = {name: getattr(network, name) for name in ("definition", "made_of", "version")}
    np.savez_compressed(path, **facts, **arrays)


@kernel
def _layer(start, stop, rows, weights, shift, last, out):
    # Four inputs at a time, so that outputs are read and written a quarter as often.
    inputs, outputs = weights.shape
    for r in range(start, stop):
        x, y = rows[r], out[r]
        for j in range(outputs):
            y[j] = shift[j]
        i = 0
        while i + 4 <= inputs:
            a, b, c, d = x[i], x[i + 1], x[i + 2], x[i + 3]
            if a != 0 or b != 0 or c != 0 or d != 0:
                for j in range(outputs):
                    y[j] += (a * weights[i, j] + b * weights[i + 1, j]) + (
                        c * weights[i + 2, j] + d * weights[i + 3, j]
                    )
            i += 4
        while i < inputs:
            a = x[i]
            for j in range(outputs):
                y[j] += a * weights[i, j]
            i += 1
        if not last:
            for j in range(outputs):
                y[j] = max(y[j], np.float32(0))


@kernel
def _add_input(column, weight, out):
    for n in range(len(out)):
        out[n] += weight * column[n]


@kernel
def _layer_of_columns(columns, weights, shift, last, out):
    # Four inputs and four outputs at a time; the loops along columns are vectorized.
    inputs, outputs = weights.shape
    count = columns.shape[1]
    least = np.float32(-np.inf) if last else np.float32(0)
    k = 0
    while k + 4 <= outputs:
        a, b, c, d = out[k], out[k + 1], out[k + 2], out[k + 3]
        a[:], b[:], c[:], d[:] = shift[k], shift[k + 1], shift[k + 2], shift[k + 3]
        i = 0
        while i + 4 <= inputs:
            p, q, r, s = columns[i], columns[i + 1], columns[i + 2], columns[i + 3]
            pa, pb, pc, pd = weights[i, k], weights[i, k + 1], weights[i, k + 2], weights[i, k + 3]
            i += 1
            qa, qb, qc, qd = weights[i, k], weights[i, k + 1], weights[i, k + 2], weights[i, k + 3]
            i += 1
            ra, rb, rc, rd = weights[i, k], weights[i, k + 1], weights[i, k + 2], weights[i, k + 3]
            i += 1
            sa, sb, sc, sd = weights[i, k], weights[i, k + 1], weights[i, k + 2], weights[i, k + 3]
            i += 1
            for n in range(count):
                u, v, x, y = p[n], q[n], r[n], s[n]
                a[n] += (pa * u + qa * v) + (ra * x + sa * y)
                b[n] += (pb * u + qb * v) + (rb * x + sb * y)
                c[n] += (pc * u + qc * v) + (rc * x + sc * y)
                d[n] += (pd * u + qd * v) + (rd * x + sd * y)
        while i < inputs:
            _add_input(columns[i], weights[i, k], a)
            _add_input(columns[i], weights[i, k + 1], b)
            _add_input(columns[i], weights[i, k + 2], c)
            _add_input(columns[i], weights[i, k + 3], d)
            i += 1
        k += 4
    while k < outputs:
        out[k, :] = shift[k]
        for i in range(inputs):
            _add_input(columns[i], weights[i, k], out[k])
        k += 1
    for k in range(outputs):
        row = out[k]
        for n in range(count):
            row[n] = max(row[n], least)
