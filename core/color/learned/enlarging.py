# SPDX-License-Identifier: GPL-3.0-or-later
"""Learned enlarging of images: a network adds to cubic interpolation what reduction has removed.

Not in the papers. For each pixel and channel, the features are the pixels around it, minus their
mean and divided by their contrast, and how fine, sparse and strong the detail farther around is.
The outputs are corrections to the cubic interpolation at the new pixels inside it, in units of that
contrast. They are averaged over all eight rotations and reflections, so that the result is
equivariant: turning, mirroring, shifting the image or scaling its values does the same to the
result. Uniform areas stay so bit for bit, and no value leaves the range of those within `NEARBY`
pixels.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ...base.parallel import kernel, run
from ...grid.enlarge import cubic_weights
from ...grid.windows import gaussian
from ...mixture.network import Network, digest, load
from .planes import Planes
from .rows import half_log, multiply, put_logs
from .surroundings import Singles

Places = npt.NDArray[np.int64]

WEIGHTS = Path(__file__).with_name("enlarging.npz")

FACTORS = 2, 3, 4
"""Factors by which images can be enlarged at once; each has a network."""

REACH = 3
"""Largest distance, in rows and in columns, of the pixels that are features."""

NEARBY = 2
"""Results stay within the range of values up to this distance, in rows and in columns."""

OFFSETS: Places = np.array(
    [
        (y, x)
        for y in range(-REACH, REACH + 1)
        for x in range(-REACH, REACH + 1)
        if y * y + x * x <= REACH * REACH + 1
    ]
)
"""Rows and columns of the pixels that are features, relative to the central one."""

SPREAD = 1.5
"""Sigma of the Gaussian weights of these pixels in their mean and contrast."""

SIGMAS = 0.7, 1.4, 2.8
"""Sigmas of the smoothings whose differences are the bands of detail."""

AROUND = 6.0
"""Sigma of the smoothing of the energies of the bands."""

TOLD = len(OFFSETS) + len(SIGMAS) + 3
"""Number of features of a pixel: besides the pixels around it, the energies of the bands, how
sparse two of them are, and the contrast."""

VIEWS = 8
"""Number of rotations and reflections of an image."""

DEFINITION = digest("enlarging 1", repr((REACH, NEARBY, SPREAD, SIGMAS, AROUND, VIEWS)))
"""Digest of what the features mean. When a change of the code changes them, raise the number in the
first text."""

STRIP = 64
"""Rows per chunk of a thread."""

_PIXELS = 2048
"""Pixels per call of a network."""


@cache
def networks() -> dict[int, tuple[Network, ...]]:
    """Load the networks of each factor, one for each rotation and reflection."""
    found = load(WEIGHTS, DEFINITION)
    return {times: views_of(found[name_of(times)]) for times in FACTORS}


def name_of(times: int) -> str:
    """Return the name of a factor's network."""
    return f"x{times}"


def views_of(network: Network) -> tuple[Network, ...]:
    """Return networks that do what one does to the rotated and reflected image."""
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
    """Return the order of the features for each rotation and reflection: (TOLD,) each."""
    grid = np.full((2 * REACH + 1,) * 2, -1)
    grid[tuple((OFFSETS + REACH).T)] = np.arange(len(OFFSETS))
    others = np.arange(len(OFFSETS), TOLD)
    return [np.concatenate([view[view >= 0], others]) for view in _turned(grid)]


def turned_places(times: int) -> list[Places]:
    """Return the order of the new pixels inside one, for each rotation and reflection."""
    return [view.ravel() for view in _turned(np.arange(times * times).reshape(times, times))]


def _turned(grid: Places) -> list[Places]:
    return [np.rot90(each, turns) for each in (grid, grid.T) for turns in range(VIEWS // 2)]


def reach_of_enlarging() -> int:
    """Return the radius in pixels within which an image affects a result."""
    return len(gaussian(AROUND)) + len(gaussian(SIGMAS[-1]))


@cache
def cubic(times: int) -> Network:
    """Return cubic interpolation as a network, whose inputs are the pixels around."""
    line = np.zeros((times, 2 * REACH + 1))
    line[:, REACH - 2 : REACH + 3] = cubic_weights(times)
    both = line[:, None, :, None] * line[None, :, None, :]
    weights = both[:, :, *(OFFSETS + REACH).T].reshape(times * times, -1).T
    return Network((np.ascontiguousarray(weights, np.float32),), (np.zeros(times**2, np.float32),))


@cache
def _pixel_weights() -> Singles:
    # Weights of the pixels around in their mean and contrast.
    weights = np.exp(-(OFFSETS**2).sum(1) / (2 * SPREAD**2))
    return (weights / weights.sum()).astype(np.float32)


def enlarged_planes(planes: Planes, times: int, nets: tuple[Network, ...] | None = None) -> Singles:
    """Enlarge planes of an image.

    Parameters
    ----------
    planes : Planes
    times : int
        One of `FACTORS`.
    nets : tuple of Network, optional
        As from `views_of`; by default the shipped ones.

    Returns
    -------
    (c, times * h, times * w) float32
        Hidden pixels with only hidden ones around keep their value.
    """
    nets = networks()[times] if nets is None else nets
    count, height, width = planes.values.shape
    rows = max(_PIXELS // width, 1)
    out = np.empty((count, times * height, times * width), np.float32)

    def work(start: int, stop: int) -> None:
        around = told_farther(planes, start, stop)
        for c in range(count):
            for top in range(start, stop, rows):
                bottom = min(top + rows, stop)
                told, mean, contrast = told_of(
                    planes, c, top, bottom, around[c, :, top - start : bottom - start]
                )
                total = nets[0].of_columns(told)
                for net in nets[1:]:
                    total += net.of_columns(told)
                total *= np.float32(1 / len(nets))
                total += cubic(times).of_columns(told[: len(OFFSETS)])
                _put(top, bottom, planes.values[c], planes.opacity, mean, contrast, total, NEARBY,
                     out[c])  # fmt: skip

    run(work, height, chunk=STRIP)
    return out


def told_farther(planes: Planes, start: int, stop: int) -> Singles:
    """Compute the features of wider surroundings.

    Returns
    -------
    (c, len(SIGMAS) + 3, stop - start, w) float32
        Half logarithms of the bands' energies over their sum, and of how sparse two of them are;
        last, the inverse of the sum.
    """
    count, height, width = planes.values.shape
    reach = len(gaussian(AROUND))
    top, bottom = max(start - reach, 0), min(stop + reach, height)
    smooth = planes.smoothed(SIGMAS, top, bottom)
    out = np.empty((count, len(SIGMAS) + 3, stop - start, width), np.float32)
    energies = np.empty((len(SIGMAS) + 2, bottom - top, width), np.float32)
    for c in range(count):
        _energies(top, planes.values[c], planes.opacity, smooth[:, c], energies)
        _tell_farther(planes.averaged(energies, top, AROUND, start, stop), out[c])
    return out


def told_of(
    planes: Planes, channel: int, top: int, bottom: int, around: Singles
) -> tuple[Singles, Singles, Singles]:
    """Compute the features of the pixels of some rows.

    Parameters
    ----------
    planes : Planes
    channel, top, bottom : int
    around : (len(SIGMAS) + 3, bottom - top, w) float32
        As from `told_farther`.

    Returns
    -------
    told : (TOLD, n) float32
    mean, contrast : (n,) float32
        Mean and contrast of the pixels around each one.
    """
    count = around[0].size
    told = np.empty((TOLD, count), np.float32)
    mean, contrast = np.empty((2, count), np.float32)
    _tell(top, bottom, planes.values[channel], planes.opacity, OFFSETS, _pixel_weights(), around,
          told, mean, contrast)  # fmt: skip
    return told, mean, contrast


@kernel
def _energies(top, values, opacity, smooth, out):
    # Squared bands, and the absolute values of two of them.
    bands = len(smooth)
    for n in range(out.shape[1]):
        for x in range(out.shape[2]):
            before, share = values[top + n, x], np.float32(1)
            if opacity.size > 0:
                share = opacity[top + n, x]
            for k in range(bands):
                band = before - smooth[k, n, x]
                before = smooth[k, n, x]
                out[k, n, x] = share * band * band
                if k < 2:
                    out[bands + k, n, x] = share * abs(band)


@kernel
def _tell_farther(energies, out):
    bands = len(energies) - 2
    tiny = np.float32(1e-30)
    for y in range(out.shape[1]):
        for x in range(out.shape[2]):
            total = tiny
            for k in range(bands):
                total += energies[k, y, x]
            for k in range(bands):
                out[k, y, x] = half_log(energies[k, y, x] / total)
            for k in range(2):
                root = energies[bands + k, y, x]
                out[bands + k, y, x] = half_log(root * root / (energies[k, y, x] + tiny))
            out[bands + 2, y, x] = np.float32(1) / total


@kernel
def _tell(start, stop, values, opacity, offsets, weights, around, told, mean, contrast):
    # Pixels minus their mean, over their contrast; 0 where all are equal. They are weighted by
    # their opacity, relative to the largest one.
    width = values.shape[1]
    count, last = len(offsets), len(around) - 1
    total, average, energy, inverse = np.empty((4, width), np.float32)
    base = np.empty(width, np.float32)
    shares = np.ones((count if opacity.size > 0 else 1, width), np.float32)
    for y in range(start, stop):
        here = slice((y - start) * width, (y - start + 1) * width)
        base[:] = values[y]
        for k in range(count):
            _read(values, y, offsets[k], told[k, here])
        if opacity.size > 0:
            for k in range(count):
                _read(opacity, y, offsets[k], shares[k])
            _compare_opacity(opacity[y], told[:, here], shares, base)
        total[:], average[:], energy[:] = 0, 0, 0
        for k in range(count):
            line, share, weight = told[k, here], shares[k % len(shares)], weights[k]
            for x in range(width):
                line[x] -= base[x]
                total[x] += weight * share[x]
                average[x] += weight * share[x] * line[x]
        for x in range(width):
            average[x] = average[x] / total[x] if total[x] > 0 else np.float32(0)
        for k in range(count):
            line, share, weight = told[k, here], shares[k % len(shares)], weights[k]
            for x in range(width):
                line[x] = share[x] * (line[x] - average[x])
                energy[x] += weight * line[x] * line[x]
        middle, root = mean[here], contrast[here]
        for x in range(width):
            middle[x], root[x] = base[x] + average[x], np.sqrt(energy[x])
            inverse[x] = np.float32(1) / root[x] if root[x] > 0 else np.float32(0)
        for k in range(count):
            multiply(inverse, told[k, here])
        for k in range(last):
            told[count + k, here] = around[k, y - start]
        put_logs(around[last, y - start], energy, told[count + last, here])


@kernel
def _read(plane, y, offset, out):
    # Reads a row at an offset; beyond the border, the values at the border.
    height, width = plane.shape
    row = plane[min(max(y + offset[0], 0), height - 1)]
    away = offset[1]
    first, end = min(max(-away, 0), width), max(min(width - away, width), 0)
    for x in range(first):
        out[x] = row[0]
    for x in range(first, end):
        out[x] = row[x + away]
    for x in range(max(first, end), width):
        out[x] = row[width - 1]


@kernel
def _compare_opacity(opacity, values, shares, base):
    # Scales weights so that the largest is 1; the base of a hidden pixel is the first visible one.
    for x in range(len(base)):
        most = np.float32(0)
        for k in range(len(shares)):
            if opacity[x] == 0 and most == 0 and shares[k, x] > 0:
                base[x] = values[k, x]
            most = max(most, shares[k, x])
        for k in range(len(shares)):
            shares[k, x] = shares[k, x] / most if most > 0 else np.float32(0)


@kernel
def _put(start, stop, values, opacity, mean, contrast, lacking, nearby, out):
    height, width = values.shape
    times = out.shape[0] // height
    for y in range(start, stop):
        for x in range(width):
            n = (y - start) * width + x
            low, high = np.float32(np.inf), np.float32(-np.inf)
            for row in range(max(y - nearby, 0), min(y + nearby + 1, height)):
                for column in range(max(x - nearby, 0), min(x + nearby + 1, width)):
                    if opacity.size == 0 or opacity[row, column] > 0:
                        low = min(low, values[row, column])
                        high = max(high, values[row, column])
            for j in range(times):
                for i in range(times):
                    new = values[y, x]
                    if low <= high:
                        new = mean[n] + contrast[n] * lacking[j * times + i, n]
                        new = min(max(new, low), high)
                    out[y * times + j, x * times + i] = new
