# SPDX-License-Identifier: GPL-3.0-or-later
"""Weighted means over images and grids of points: the short-time kernel."""

from __future__ import annotations

import logging
import math

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..grid.geodesics import FARTHEST_SPLIT, MOST_SPLITS, march, open_band
from ..settings import BeltramiSettings

log = logging.getLogger(__name__)

_ROWS = 16  # most rows that are smoothed at once

REACHED = 2_000_000
"""Approximate number of pixels that the kernels of a chunk reach: tenths of a second."""

FASTEST = 1e38
"""Near the end of float32."""

Coordinates = npt.NDArray[np.float32]


def smooth_grid(
    signal: npt.NDArray,
    guide: Coordinates,
    flat: bool,
    areas: npt.NDArray[np.float32],
    settings: BeltramiSettings,
) -> npt.NDArray:
    """Apply the kernel once.

    Parameters
    ----------
    signal : (h, w, k) float32 or float64
        Values to average.
    guide : (h, w, g) float32
        The coordinates of the points of the surface on which distances are measured.
    flat : bool
        Whether the pixel's own x and y are further coordinates.
    areas : (h, w) float32
        Weights of the pixels.
    settings : BeltramiSettings
        `time` greater than 0.

    Returns
    -------
    array like `signal`
    """
    out = np.empty_like(signal)
    rows = _reachable_rows(guide, flat, math.sqrt(settings.limit))
    rate = np.float32(min(0.25 / settings.time, FASTEST))
    around = math.pi * settings.limit + 1.0
    chunk = max(min(int(REACHED / (around * signal.shape[1])), _ROWS), 1)
    unsplit = np.zeros(len(signal), dtype=np.int64)  # in the bands that begin there
    wanted = np.zeros((0, 0), dtype=np.bool_)
    run(smooth_rows, len(signal), signal, guide, np.float32(flat), areas,
        np.float32(settings.limit), rate, -1, rows, unsplit, wanted, out, chunk=chunk)  # fmt: skip
    if unsplit.any():
        log.info("Some obtuse triangles of pixels are split into %d parts, and not to the end:"
                 " distances through them are too long.", MOST_SPLITS)  # fmt: skip
    return out


def reach_of(settings: BeltramiSettings) -> int:
    """Return the radius in pixels that the kernel reaches in one pass over a flat image."""
    # Splits of obtuse triangles look farther than any kernel reaches. In no known image does that
    # make a difference, but this is not proven.
    return math.ceil(math.sqrt(settings.limit)) + FARTHEST_SPLIT


def surface_areas(points: Coordinates) -> npt.NDArray[np.float32]:
    """Compute the area element, sqrt(det g), of points (h, w, 3) from central differences."""
    areas = np.empty(points.shape[:2], dtype=np.float32)
    run(_measure_areas, len(points), points, areas, chunk=_ROWS)
    return areas


@kernel
def _measure_areas(start, stop, points, areas):
    height, width = areas.shape
    for y in range(start, stop):
        for x in range(width):
            up, down = max(y - 1, 0), min(y + 1, height - 1)
            left, right = max(x - 1, 0), min(x + 1, width - 1)
            rows = np.float32(max(down - up, 1))
            columns = np.float32(max(right - left, 1))
            g_yy = g_xx = g_xy = 0.0  # squares of squares leave float32
            for c in range(3):
                slope_y = (points[down, x, c] - points[up, x, c]) / rows
                slope_x = (points[y, right, c] - points[y, left, c]) / columns
                g_yy += slope_y * slope_y
                g_xx += slope_x * slope_x
                g_xy += slope_x * slope_y
            areas[y, x] = np.sqrt(max(g_yy * g_xx - g_xy * g_xy, 0.0))


def _reachable_rows(guide: Coordinates, flat: bool, radius: float) -> npt.NDArray[np.int64]:
    # For each row, the first one within the radius, and the end of these rows.
    height = len(guide)
    number = np.arange(height)
    if flat:
        reach = min(math.ceil(radius), height)
        first, last = np.maximum(number - reach, 0), np.minimum(number + reach + 1, height)
    else:
        depth = np.concatenate([[0.0], np.cumsum(_row_gaps(guide))])
        first = np.searchsorted(depth, depth - radius, "left")
        last = np.searchsorted(depth, depth + radius, "right")
    return np.stack([first, last], axis=1)


def _row_gaps(guide: Coordinates) -> npt.NDArray[np.float64]:
    # The least heights of the triangles between two rows: no path across is shorter.
    if guide.shape[1] == 1:
        return np.linalg.norm((guide[1:] - guide[:-1])[:, 0].astype(np.float64), axis=1)
    gaps = np.full(len(guide) - 1, np.inf)
    for base, apex in ((guide[:-1], guide[1:]), (guide[1:], guide[:-1])):
        side = (base[:, 1:] - base[:, :-1]).astype(np.float64)
        side /= np.maximum(np.linalg.norm(side, axis=2, keepdims=True), 1e-30)
        for corner in (apex[:, :-1], apex[:, 1:]):
            leg = (corner - base[:, :-1]).astype(np.float64)
            along = (leg * side).sum(axis=2, keepdims=True)
            gaps = np.minimum(gaps, np.linalg.norm(leg - along * side, axis=2).min(axis=1))
    return gaps


@kernel
def smooth_rows(
    start, stop, signal, guide, spacing, areas, limit, rate, half_window, rows, unsplit, wanted, out
):
    """Average in rows ``start <= y < stop``, with weights of distances along the surface.

    Parameters
    ----------
    signal, guide, areas
        As in `smooth_grid`. The guide is NaN where there is nothing.
    spacing : float32
        See `chord`.
    limit, rate : float32
        Squared distance beyond which weights are 0, and the one by which they fall: exp(-rate d^2).
    half_window : int
        Radius of the kernel in pixels; -1: as far as the limit.
    rows : (h, 2) int64
        For each row, the first row that its pixels reach, and the end of these rows.
    unsplit : (h,) int64
        Its item at `start` is set to the number of triangles that were not split to the end.
    wanted : (h, w) bool
        Pixels to compute; all if empty.
    out : array like `signal`
        Set for these.
    """
    first, last = rows[start, 0], rows[stop - 1, 1]
    columns = guide.shape[1]
    width = columns + 2
    band, front = open_band(guide, spacing, limit, first, last)
    unsplit[start] = band.unsplit
    final, tentative, _, reached = front
    values = np.zeros((final.size, signal.shape[2]), signal.dtype)
    shares = np.empty(final.size, np.float32)
    for y in range(first, last):
        for x in range(columns):
            cell = (y - first + 1) * width + x + 1
            shares[cell] = areas[y, x]
            for c in range(signal.shape[2]):
                values[cell, c] = signal[y, x, c]
    total = np.empty(signal.shape[2])
    for y in range(start, stop):
        if half_window >= 0:  # only the window is open; it slides along the row
            tentative[:] = -1.0
            above, below = max(y - half_window, first), min(y + half_window + 1, last)
            window = tentative.reshape(-1, width)[above - first + 1 : below - first + 1, 1:-1]
            window[:, :half_window] = np.inf
        for x in range(columns):
            source = (y - first + 1) * width + x + 1
            if half_window >= 0:
                window[:, x + half_window : x + half_window + 1] = np.inf
                if x > half_window:
                    window[:, x - half_window - 1] = -1.0
            if wanted.size > 0 and not wanted[y, x]:
                continue
            count = march(source, limit, band, front)
            total[:] = 0.0
            weight = 0.0
            for i in range(count):
                cell = reached[i]
                share = shares[cell] * np.exp(-rate * final[cell])
                weight += share
                for c in range(total.size):
                    total[c] += np.float64(share) * values[cell, c]  # float32 could overflow
                final[cell] = np.inf
                tentative[cell] = np.inf
            for c in range(total.size):
                out[y, x, c] = total[c] / weight if weight > 0 else signal[y, x, c]
