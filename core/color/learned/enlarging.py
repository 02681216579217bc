# SPDX-License-Identifier: GPL-3.0-or-later
"""Enlarging of images as was learned: a network adds to the cubic what reducing has taken away.

Not in the papers. For each pixel and channel a network is told the pixels around, less their mean
and over their contrast, and gives what the new pixels within lack, in units of that contrast. It is
asked in all eight ways to turn and mirror these pixels, and the mean counts: images that are
turned, mirrored, shifted or scaled have results that are so, too. What is even stays so bit for
bit, and no value leaves the range of those within `NEARBY` pixels.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ...base.parallel import kernel, run
from ...grid.enlarge import cubic_weights
from ...mixture.network import Network, digest, load

Singles = npt.NDArray[np.float32]
Places = npt.NDArray[np.int64]

WEIGHTS = Path(__file__).with_name("enlarging.npz")

FACTORS = 2, 3, 4
"""How many times images can be enlarged at once; there is a network for each."""

REACH = 3
"""How many pixels away those lie at most that a network is told of, in rows and columns."""

NEARBY = 2
"""Results stay within the values of pixels that are so far away, in rows and columns."""

OFFSETS: Places = np.array(
    [
        (y, x)
        for y in range(-REACH, REACH + 1)
        for x in range(-REACH, REACH + 1)
        if y * y + x * x <= REACH * REACH + 1
    ]
)
"""Rows and columns of the pixels that a network is told of, from the one in the middle."""

SPREAD = 1.5
"""Sigma of the weights of these pixels in their mean and contrast."""

VIEWS = 8
"""Ways to turn and mirror an image."""

DEFINITION = digest("enlarging 1", repr((REACH, NEARBY, SPREAD, VIEWS)))
"""Changes with what the numbers mean; count the first word up when the code changes them."""

_PIXELS = 2048
"""That a network looks at at once."""


@cache
def networks() -> dict[int, tuple[Network, ...]]:
    """The networks of each factor, one for each way to turn and mirror."""
    found = load(WEIGHTS, DEFINITION)
    return {times: views_of(found[name_of(times)]) for times in FACTORS}


def name_of(times: int) -> str:
    """Name of a factor's network."""
    return f"x{times}"


def views_of(network: Network) -> tuple[Network, ...]:
    """Return networks that do what one would with the image turned and mirrored."""
    times = round(len(network.shifts[-1]) ** 0.5)
    found = []
    for told, given in zip(turned_offsets(), turned_places(times), strict=True):
        weights, shifts = list(network.weights), list(network.shifts)
        weights[0] = np.ascontiguousarray(weights[0][told])
        weights[-1] = np.ascontiguousarray(weights[-1][:, given])
        shifts[-1] = np.ascontiguousarray(shifts[-1][given])
        found.append(replace(network, weights=tuple(weights), shifts=tuple(shifts)))
    return tuple(found)


def turned_offsets() -> list[Places]:
    """Where the pixels around lie after turning and mirroring, for each way: places in `OFFSETS`."""
    grid = np.full((2 * REACH + 1,) * 2, -1)
    grid[tuple((OFFSETS + REACH).T)] = np.arange(len(OFFSETS))
    return [view[view >= 0] for view in _turned(grid)]


def turned_places(times: int) -> list[Places]:
    """Where the new pixels within one lie after turning and mirroring, for each way."""
    return [view.ravel() for view in _turned(np.arange(times * times).reshape(times, times))]


def _turned(grid: Places) -> list[Places]:
    return [np.rot90(each, turns) for each in (grid, grid.T) for turns in range(VIEWS // 2)]


def cubic_of_told(times: int) -> Singles:
    """Weights of the pixels around in the cubic at each new pixel within: (len(OFFSETS), times²)."""
    line = np.zeros((times, 2 * REACH + 1))
    line[:, REACH - 2 : REACH + 3] = cubic_weights(times)
    both = line[:, None, :, None] * line[None, :, None, :]
    places = OFFSETS + REACH
    return np.float32(both[:, :, places[:, 0], places[:, 1]].reshape(times * times, -1).T)


def pixel_weights() -> Singles:
    """Weights of the pixels around in their mean and contrast."""
    weights = np.exp(-(OFFSETS**2).sum(1) / (2 * SPREAD**2))
    return np.float32(weights / weights.sum())


def enlarge_learned(
    plane: npt.NDArray,
    times: int,
    out: npt.NDArray,
    nets: tuple[Network, ...] | None = None,
) -> None:
    """Enlarge one channel.

    Parameters
    ----------
    plane : (h, w) array
    times : int
        One of `FACTORS`.
    out : (times * h, times * w) array
    nets : tuple of Network, optional
        As from `views_of`; those that are shipped by default.
    """
    nets = networks()[times] if nets is None else nets
    cubic, weights = cubic_of_told(times), pixel_weights()
    height, width = plane.shape
    rows = max(_PIXELS // width, 1)

    def work(start: int, stop: int) -> None:
        for top in range(start, stop, rows):
            bottom = min(top + rows, stop)
            count = (bottom - top) * width
            told = np.empty((len(OFFSETS), count), np.float32)
            mean, contrast = np.empty((2, count), np.float32)
            tell(top, bottom, plane, OFFSETS, weights, told, mean, contrast)
            total = np.zeros((times * times, count), np.float32)
            for net in nets:
                total += net.of_columns(told)
            _put(top, bottom, plane, told, mean, contrast, total, np.float32(1 / len(nets)),
                 cubic, NEARBY, out)  # fmt: skip

    run(work, height, chunk=rows)


@kernel
def tell(start, stop, plane, offsets, weights, told, mean, contrast):
    """Tell of the pixels of some rows what lies around them.

    Parameters
    ----------
    start, stop : int
        Rows.
    plane : (h, w)
    offsets : (k, 2) int64
    weights : (k,) float32
    told : (k, n) float32
        Differences from the mean, over the contrast; 0 where all is even.
    mean : (n,) float32
        Less the pixel itself.
    contrast : (n,) float32
    """
    height, width = plane.shape
    mean[:], contrast[:] = 0, 0
    for k in range(len(offsets)):
        for y in range(start, stop):
            row = min(max(y + offsets[k, 0], 0), height - 1)
            for x in range(width):
                column = min(max(x + offsets[k, 1], 0), width - 1)
                n = (y - start) * width + x
                told[k, n] = plane[row, column] - plane[y, x]
                mean[n] += weights[k] * told[k, n]
    for k in range(len(offsets)):
        for n in range(len(mean)):
            away = told[k, n] - mean[n]
            told[k, n] = away
            contrast[n] += weights[k] * away * away
    for n in range(len(mean)):
        contrast[n] = np.sqrt(contrast[n])
    for k in range(len(offsets)):
        for n in range(len(mean)):
            told[k, n] = told[k, n] / contrast[n] if contrast[n] > 0 else np.float32(0)


@kernel
def _put(start, stop, plane, told, mean, contrast, total, share, cubic, nearby, out):
    height, width = plane.shape
    times = out.shape[0] // height
    for y in range(start, stop):
        for x in range(width):
            n = (y - start) * width + x
            value = plane[y, x]
            low, high = value, value
            for row in range(max(y - nearby, 0), min(y + nearby + 1, height)):
                for column in range(max(x - nearby, 0), min(x + nearby + 1, width)):
                    low = min(low, plane[row, column])
                    high = max(high, plane[row, column])
            for j in range(times):
                for i in range(times):
                    p = j * times + i
                    lacking = share * total[p, n]
                    for k in range(len(told)):
                        lacking += cubic[k, p] * told[k, n]
                    new = value + (mean[n] + contrast[n] * lacking)
                    out[y * times + j, x * times + i] = min(max(new, low), high)
