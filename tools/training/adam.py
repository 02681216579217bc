# SPDX-License-Identifier: GPL-3.0-or-later
"""Trains small networks by the Adam optimizer; one core and one seed give the same bits."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from shock_filter.core.mixture.network import Network

RATE, LAST_RATE = 2e-3, 1e-5
WARM_UP = 500
"""Steps over which the learning rate rises at first, at most a tenth of all. Without them, the
first steps may end where all units of a layer are 0, and learning stops."""

BATCH = 1024
FADES = 0.9, 0.999
"""Decay rates of Adam's running means: of gradients, and of squared gradients."""

HELD = 1e-4
"""Weight of the L2 penalty on the free terms of a free mixture."""

SOFT = 0.02
"""The loss is sqrt(d^2 + SOFT^2) for a distance d between unit vectors: improving a result by the
last degree is not worth much."""


def trained_mixture(
    told: np.ndarray,
    candidates: np.ndarray,
    targets: np.ndarray,
    weights: np.ndarray,
    hidden: tuple[int, ...],
    epochs: int,
    seed: int = 0,
    log: Callable[[str], None] = print,
    harm: float = 0.0,
) -> Network:
    """Train a network whose mixtures of candidates come close to targets.

    Parameters
    ----------
    told : (n, inputs) float32
        Features of each row.
    candidates : (n, k, 3) float32
        Unit vectors.
    targets : (n, 2, 3) float32
        Unit vectors; the loss is the distance to the nearer one.
    weights : (n,) float32
        Weights of the rows in the loss.
    hidden : tuple of int
        Sizes of the hidden layers.
    epochs, seed, log
    harm : float
        How much more the loss of a row counts, as a share, while the mixture is farther from the
        targets than the first candidate, the input.
    """
    components = np.ascontiguousarray(candidates.transpose(0, 2, 1))

    def back(y, rows):
        return _mixture_back(y, components[rows], targets[rows], weights[rows], harm)

    return _trained(told, back, (*hidden, candidates.shape[1]), epochs, seed, log)


def trained_free_mixture(
    told: np.ndarray,
    candidates: np.ndarray,
    targets: np.ndarray,
    weights: np.ndarray,
    hidden: tuple[int, ...],
    epochs: int,
    seed: int = 0,
    log: Callable[[str], None] = print,
) -> Network:
    """Train as `trained_mixture`, but for `free_mixture` and with one target per row: (n, 3)."""
    components = np.ascontiguousarray(candidates.transpose(0, 2, 1))

    def back(y, rows):
        return _free_back(y, components[rows], targets[rows], weights[rows])

    # Along an axis, numpy copies the array, which has gigabytes here.
    moments = (np.array([f(column) for column in told.T]) for f in (np.mean, np.std))
    sizes = *hidden, 2 * candidates.shape[1]
    return _trained(told, back, sizes, epochs, seed, log, *moments)


def trained_gate(
    told: np.ndarray,
    wanted: np.ndarray,
    hidden: tuple[int, ...],
    epochs: int,
    seed: int = 0,
    log: Callable[[str], None] = print,
) -> Network:
    """Train a binary classifier by logistic loss: its output is above 0 for wanted rows.

    Parameters
    ----------
    told : (n, inputs) float32
        Features of each row.
    wanted : (n,) float32
        0 for rows that are not wanted; else the weight of the row in the loss, where others have 1.
    hidden, epochs, seed, log
        As above.
    """
    sign = np.where(wanted > 0, np.float32(1), np.float32(-1))[:, None]
    weight = np.where(wanted > 0, wanted, np.float32(1))[:, None]

    def back(y, rows):
        s, w = sign[rows], weight[rows]
        miss = 1 / (1 + np.exp(np.clip(s * y, -30, 30)))
        loss = float((w * np.logaddexp(0, -s * y)).sum())
        return loss, -s * w * miss / len(y)

    return _trained(told, back, (*hidden, 1), epochs, seed, log)


def trained_on(
    network: Network, told: np.ndarray, back: Callable, epochs: int, rate: float, seed: int, log
) -> Network:
    """Train a network further, at a given rate; `back` returns loss and gradient of some rows."""
    layers = [[w.copy(), b.copy()] for w, b in zip(network.weights, network.shifts, strict=True)]
    spread = (told.std(0) + 1e-2).astype(np.float32)
    return _learned(layers, spread, told, back, epochs, rate, np.random.default_rng(seed), log)


def _trained(told, back, sizes, epochs, seed, log, mean=None, spread=None) -> Network:
    rng = np.random.default_rng(seed)
    mean = told.mean(0) if mean is None else mean
    spread = (told.std(0) if spread is None else spread) + np.float32(1e-2)
    layers = _begun(rng, [told.shape[1], *sizes], mean, spread)
    return _learned(layers, spread, told, back, epochs, RATE, rng, log)


def _learned(layers, spread, told, back, epochs, top, rng, log) -> Network:
    # The first layer learns as if its inputs had unit variance.
    scale = [np.float32(1) for _ in layers]
    scale[0] = (1 / spread[:, None]).astype(np.float32)
    means = [[np.zeros_like(p) for p in layer] for layer in layers]
    squares = [[np.zeros_like(p) for p in layer] for layer in layers]
    step, total = 0, epochs * (len(told) // BATCH)
    rise = min(WARM_UP, max(total // 10, 1))
    for epoch in range(epochs):
        order, loss = rng.permutation(len(told)), 0.0
        for i in range(0, len(told) - BATCH + 1, BATCH):
            rows = order[i : i + BATCH]
            found, slopes = _slopes(layers, told[rows], lambda y, rows=rows: back(y, rows))
            loss += found
            step += 1
            rate = LAST_RATE + top * 0.5 * (1 + np.cos(np.pi * step / total))
            rate *= min(step / rise, 1.0)
            for n, layer in enumerate(layers):
                for j, slope in enumerate(slopes[n]):
                    factor = scale[n] if j == 0 else np.float32(1)
                    slope = slope * factor
                    m, s = means[n][j], squares[n][j]
                    m += (1 - FADES[0]) * (slope - m)
                    s += (1 - FADES[1]) * (slope * slope - s)
                    change = (m / (1 - FADES[0] ** step)) / (
                        np.sqrt(s / (1 - FADES[1] ** step)) + 1e-8
                    )
                    layer[j] -= (rate * change * factor).astype(np.float32)
        log(f"epoch {epoch}: {loss / max(len(told) // BATCH * BATCH, 1):.5f}")
    return Network(
        tuple(w.astype(np.float16).astype(np.float32) for w, _ in layers),
        tuple(b for _, b in layers),
    )


def _begun(rng, sizes, mean, spread):
    layers = [
        [(rng.normal(size=(a, b)) * np.sqrt(2 / a)).astype(np.float32), np.zeros(b, np.float32)]
        for a, b in pairwise(sizes)
    ]
    layers[-1][0] *= 0.1
    layers[0][0] /= spread[:, None]
    layers[0][1] -= mean @ layers[0][0]
    return [[np.ascontiguousarray(w, np.float32), b.astype(np.float32)] for w, b in layers]


def _slopes(layers, told, back_of):
    # The loss, and its gradient with respect to all weights and biases.
    values = [told]
    for w, b in layers[:-1]:
        values.append(np.maximum(values[-1] @ w + b, 0))
    loss, back = back_of(values[-1] @ layers[-1][0] + layers[-1][1])
    slopes = [None] * len(layers)
    for n in range(len(layers) - 1, -1, -1):
        slopes[n] = values[n].T @ back, back.sum(0)
        if n:
            back = (back @ layers[n][0].T) * (values[n] > 0)
    return loss, slopes


def _mixture_back(y, components, targets, weights, harm=0.0):
    shares = _shares(y)
    loss, slope = _share_back(shares, components, targets, weights, harm)
    return loss, shares * (slope - (shares * slope).sum(1, keepdims=True))


def _free_back(y, components, targets, weights):
    count = components.shape[2]
    shares, further = _shares(y[:, :count]), y[:, count:]
    loss, slope = _share_back(shares + further, components, targets[:, None], weights)
    bent = shares * (slope - (shares * slope).sum(1, keepdims=True))
    return loss, np.concatenate([bent, slope + HELD * further / len(y)], 1)


def _shares(y):
    z = np.exp(y - y.max(1, keepdims=True))
    return z / z.sum(1, keepdims=True)


def _distances(cosines):
    return np.sqrt(np.maximum(2 - 2 * cosines, 0) + SOFT**2)


def _share_back(shares, components, targets, weights, harm=0.0):
    mixed = np.stack([(shares * components[:, j]).sum(1) for j in range(3)], 1)
    length = np.maximum(np.sqrt((mixed * mixed).sum(1)), 1e-3)
    unit = mixed / length[:, None]
    both = (unit[:, None] * targets).sum(2)
    nearer = targets[np.arange(len(targets)), both.argmax(1)]
    far = loss = _distances(both.max(1))
    rise = np.float32(1)
    if harm:
        before = _distances((components[:, None, :, 0] * targets).sum(2).max(1))
        loss = far + harm * np.maximum(far - before, 0)
        rise = np.where(far > before, np.float32(1 + harm), rise)
    back = -(rise * weights / far / len(shares))[:, None] * nearer
    back = (back - (back * unit).sum(1, keepdims=True) * unit) / length[:, None]
    slope = sum(components[:, j] * back[:, j, None] for j in range(3))
    return float((loss * weights).sum()), slope
