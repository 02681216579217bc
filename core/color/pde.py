# SPDX-License-Identifier: GPL-3.0-or-later
"""Osher and Rudin's PDE shock filter, the baseline (paper A, section 3.1, equations 1 and 2)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..base.progress import phase
from ..errors import InvalidSettings, InvalidSignal

DETECTORS = {"laplacian": 0, "gradient": 1, "flow": 2}

_ROWS = 16
LARGEST = 1e9  # its cube is far from the end of float32
_MOST_PARTS = 10_000  # of a step


def check_kind(array: npt.NDArray) -> None:
    """Raise `InvalidSignal` unless an image has a type and size that can evolve."""
    if array.dtype.kind != "f" or min(array.shape[:2]) < 2:
        raise InvalidSignal("Give an image of float32 or float64 of at least 2 x 2 pixels.")


def evolved(array: npt.NDArray, steps: int, time_step: float, detector: int) -> npt.NDArray:
    """Evolve an image of finite values as `osher_rudin_image` does."""
    check_kind(array)
    if max(array.max(), -array.min()) > LARGEST:
        raise InvalidSignal(f"The image holds values beyond {LARGEST:g}; scale them to [0, 1].")
    # Planar layout, which can be vectorized.
    planes = np.moveaxis(array.reshape(*array.shape[:2], -1), 2, 0).copy(order="C")
    spares = np.empty_like(planes)
    count = len(planes) * steps
    for number in range(len(planes)):
        here, there = planes[number], spares[number]
        for step in range(steps):
            done = number * steps + step
            with phase(done / count, (done + 1) / count, "Sharpening"):
                here, there = _step(here, there, time_step, detector)
        planes[number] = here
    return np.moveaxis(planes, 0, 2).reshape(array.shape).copy()


def _step(
    here: npt.NDArray, there: npt.NDArray, time_step: float, detector: int
) -> tuple[npt.NDArray, npt.NDArray]:
    # Evolve the plane `here` by a time step; returns the result and the other one of both.
    left = time_step
    while left > 0:
        part = left
        if detector == DETECTORS["flow"]:
            fastest = _fastest(here)
            if fastest * left > 0.5 * _MOST_PARTS:
                raise InvalidSettings(
                    f"time_step is {time_step!r}, too long for values that change by so much; scale"
                    " them to [0, 1] or give a shorter one."
                )
            part = min(left, 0.5 / fastest) if fastest > 0 else left
        run(_pde_rows, len(here), here, there, here.dtype.type(part), detector, chunk=_ROWS)
        here, there = there, here
        left -= part
    return here, there


def _fastest(plane: npt.NDArray) -> float:
    # max|L| of "flow", over the pixels that move.
    peaks = np.zeros((-(-len(plane) // _ROWS), plane.shape[1]), dtype=plane.dtype)
    run(_find_peaks, len(plane), plane, peaks, chunk=_ROWS)
    return float(peaks.max())


@kernel
def _find_peaks(start, stop, image, peaks):
    # The largest |L| in each column of a band.
    height, width = image.shape
    last = width - 1
    peak = peaks[start // _ROWS]
    for y in range(start, stop):
        above = image[max(y - 1, 0)]
        row = image[y]
        below = image[min(y + 1, height - 1)]
        for x in range(1, last):
            speed = _speed(above, row, below, x - 1, x, x + 1)
            peak[x] = speed if speed > peak[x] else peak[x]
        peak[0] = max(peak[0], _speed(above, row, below, 0, 0, 1))
        peak[last] = max(peak[last], _speed(above, row, below, last - 1, last, last))


@kernel
def _speed(above, row, below, left, x, right):
    edge, slope = _edge_and_slope(above, row, below, left, x, right, 2)
    return abs(edge) if slope > 0 else row.dtype.type(0)


@kernel
def _pde_rows(start, stop, image, out, time_step, detector):
    height, width = image.shape
    for y in range(start, stop):
        above = image[max(y - 1, 0)]
        row = image[y]
        below = image[min(y + 1, height - 1)]
        target = out[y]
        last = width - 1
        # One loop per detector, with separate borders, can be vectorized.
        if detector == 0:
            for x in range(1, last):
                target[x] = _evolved(above, row, below, x - 1, x, x + 1, time_step, 0)
        elif detector == 1:
            for x in range(1, last):
                target[x] = _evolved(above, row, below, x - 1, x, x + 1, time_step, 1)
        else:
            for x in range(1, last):
                target[x] = _evolved(above, row, below, x - 1, x, x + 1, time_step, 2)
        target[0] = _evolved(above, row, below, 0, 0, 1, time_step, detector)
        target[last] = _evolved(above, row, below, last - 1, last, last, time_step, detector)


@kernel
def _evolved(above, row, below, left, x, right, time_step, detector):
    # A pixel's value after a step.
    kind = row.dtype.type
    zero = kind(0)
    edge, slope = _edge_and_slope(above, row, below, left, x, right, detector)
    if detector == 2:
        speed = time_step * edge
    else:
        speed = time_step if edge > zero else (-time_step if edge < zero else zero)
    return row[np.uint64(x)] - speed * slope


@kernel
def _edge_and_slope(above, row, below, left, x, right, detector):
    # L and the upwind |grad I|.
    kind = row.dtype.type
    zero = kind(0)
    half = kind(0.5)
    left, x, right = np.uint64(left), np.uint64(x), np.uint64(right)
    here = row[x]
    west = here - row[left]
    east = row[right] - here
    north = here - above[x]
    south = below[x] - here
    second_x = east - west
    second_y = south - north
    gx = half * (east + west)
    gy = half * (south + north)
    if detector == 0:
        edge = second_x + second_y
    else:
        mixed = kind(0.25) * (below[right] - below[left] - above[right] + above[left])
        edge = gx * gx * second_x + kind(2) * gx * gy * mixed + gy * gy * second_y
        if detector == 2:
            edge /= max(np.sqrt(gx * gx + gy * gy), kind(1e-12))
    # minmod of both one-sided differences: zero at extrema
    mx = min(abs(west), abs(east)) if west * east > zero else zero
    my = min(abs(north), abs(south)) if north * south > zero else zero
    return edge, np.sqrt(mx * mx + my * my)
