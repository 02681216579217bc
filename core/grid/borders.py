# SPDX-License-Identifier: GPL-3.0-or-later
"""Measurements of an image: the width of its borders, its noise, and its even areas.

Borders are found where the slope is greatest across itself. From there the profile is followed in
both directions while it rises, which gives its contrast; contrast over slope is the width. Large
images are measured in tiles spread all over them.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..settings import WIDTH_OF_SIGMA
from .channels import Channels
from .windows import Plane, gaussian, least_and_greatest, smooth

_TILE = 192
_MOST_TILES = 16
_FEW_TILES = 8  # for rough measurements
_ALL_TILES = 256  # if those of _MOST_TILES hold too few borders
_MOST_BORDERS = 8000
_FEWEST_BORDERS = 30
_REACH = 24  # pixels that a profile is followed in each direction
_STEP = 0.5
_BLURRED = 3  # pixels that smoothing spreads values
_RIM = 4  # pixels at the image's rim without borders
_RISING = 0.06  # share of the greatest slope at which a profile ends
_CLEAR = 0.08  # least contrast of borders that count
_QUANTILE = 0.35  # of the widths: narrow borders show the blur, wide ones may have been soft
_PRESMOOTHED = (0.8, 1.6, 3.0)  # sigmas; the larger ones are used if noise hides the borders
_CELL = 0.15  # what reading between pixels adds to the squared sigma
_ALIKE = 1.5, 1.3  # largest spread of a drawing's border widths, at narrow and at wide ones
_MOSTLY = 0.45  # least even share of a drawing between its borders
_EVEN = 0.02  # range that counts as even, of the contrast of clear borders
_BORDER = 0.35  # range within the borders' width that tells a border, of the same contrast
_NEAR = 2
_LEVEL = 0.004  # of a byte
_SEEN_NOISE = 0.8  # what smoothing leaves of noise, as a range of neighbours
_LIGHT_NOISE, _NOISE = 0.008, 0.03
_HIDDEN = 2.2  # sigmas of the smoothing: wider borders are measured better after a wider one
_PLENTY = 200


class Borders(NamedTuple):
    """Measurements of the borders in an image.

    Attributes
    ----------
    width : float
        Width of the borders from 10 to 90 percent, in pixels; 0 if there are too few.
    number : int
        Number of borders that were measured.
    noise : float
        Standard deviation of the noise.
    contrast : float
        Contrast of clear borders.
    spread : float
        Ratio of the widths of the widest and the narrowest quarter of the strong borders, damped
        for differences of about a pixel.
    detail : float
        Mean squared difference to a smoothing, in the image's range; 0 if it is not measured.
    span : float
        Range of the values of the smoothed image; 0 if it is not measured.
    """

    width: float = 0.0
    number: int = 0
    noise: float = 0.0
    contrast: float = 0.0
    spread: float = math.inf
    detail: float = 0.0
    span: float = 0.0


def measure_borders(
    image: npt.NDArray,
    scale: float,
    channels: Channels,
    *,
    inside: npt.NDArray[np.bool_] | None = None,
    roughly: bool = False,
) -> Borders:
    """Measure the borders and the noise of an image.

    Parameters
    ----------
    image : (h, w, c) array of any real type
    scale : float
        Factor that brings values to [0, 1].
    channels : Channels
        Colors are weighted by opacity.
    inside : (h, w) bool, optional
        The pixels to measure.
    roughly : bool
        Measure half of the tiles only.
    """
    tiles = _tiles(image.shape[:2], inside)
    some = _spread_out(tiles, _FEW_TILES if roughly else _MOST_TILES)
    found = _measure_tiles(image, scale, channels, inside, some)
    if found.number < _FEWEST_BORDERS and len(some) < len(tiles):
        more = _spread_out(tiles, _ALL_TILES)
        found = _measure_tiles(image, scale, channels, inside, more)
    return found


def windows_to_measure(shape: tuple[int, ...]) -> list[tuple[slice, slice]]:
    """Return rows and columns of windows that are spread all over an image."""
    tiles = _spread_out(_tiles(shape, None), _MOST_TILES)
    return [(slice(top, bottom), slice(left, right)) for top, bottom, left, right in tiles]


def is_drawing(
    image: npt.NDArray,
    scale: float,
    channels: Channels,
    borders: Borders,
    inside: npt.NDArray[np.bool_] | None = None,
) -> bool:
    """Tell drawings from photos: their borders are alike, and the areas between them are even.

    Parameters
    ----------
    image, scale, channels, inside
        As in `measure_borders`.
    borders : Borders
        Result of `measure_borders`.
    """
    # The wider a blur is, the more alike it makes all borders.
    if borders.spread > np.interp(borders.width, (4.0, 8.0), _ALIKE):
        return False
    tiles = _spread_out(_tiles(image.shape[:2], inside), _FEW_TILES)
    counts = np.zeros((len(tiles), 2), dtype=np.int64)

    def count(start: int, stop: int) -> None:
        for i in range(start, stop):
            rows, columns = _around(tiles[i], image.shape[:2])
            planes = guide_planes(image, scale, channels, rows, columns)
            counts[i] = _count_even(planes, borders, _seen(inside, rows, columns, planes))

    run(count, len(tiles), chunk=1)
    even, between = counts.sum(axis=0)
    return bool(even > _MOSTLY * between)


def guide_planes(
    image: npt.NDArray, scale: float, channels: Channels, rows: slice, columns: slice = slice(None)
) -> npt.NDArray[np.float32]:
    """Return the guiding channels of a part of an image, weighted by opacity: (k, h, w)."""
    part = image[rows, columns]
    chosen = part[..., channels.start : channels.stop]
    planes = np.moveaxis(chosen, -1, 0).astype(np.float32)
    planes *= np.float32(scale)
    if channels.brightness.size:
        weights = channels.brightness[:, None, None]
        planes = (weights * planes[: len(weights)]).sum(axis=0, keepdims=True)
    if channels.alpha >= 0:
        planes *= np.float32(scale) * part[..., channels.alpha].astype(np.float32)
    return np.ascontiguousarray(planes)


def _tiles(
    shape: tuple[int, ...], inside: npt.NDArray[np.bool_] | None
) -> list[tuple[int, int, int, int]]:
    # First and last row and column of each tile that has something inside.
    def cuts(length: int) -> list[tuple[int, int]]:
        count = max(round(length / _TILE), 1)
        places = [length * i // count for i in range(count + 1)]
        return list(itertools.pairwise(places))

    return [
        (*rows, *columns)
        for rows in cuts(shape[0])
        for columns in cuts(shape[1])
        if inside is None or inside[slice(*rows), slice(*columns)].any()
    ]


def _seen(
    inside: npt.NDArray[np.bool_] | None,
    rows: slice,
    columns: slice,
    planes: npt.NDArray[np.float32],
) -> npt.NDArray[np.bool_]:
    # Pixels with no pixel outside nearby.
    if inside is None:
        return np.ones(planes.shape[1:], dtype=np.bool_)
    high = inside[rows, columns].astype(np.float32)
    low = high.copy()
    least_and_greatest(low, high, _BLURRED)
    return low > 0


def _spread_out(
    tiles: list[tuple[int, int, int, int]], most: int
) -> list[tuple[int, int, int, int]]:
    if len(tiles) <= most:
        return tiles
    golden = 0.5 * (math.sqrt(5.0) - 1.0)  # every n-th tile could lie in the same columns
    order = sorted(range(len(tiles)), key=lambda i: i * golden % 1.0)
    return [tiles[i] for i in sorted(order[:most])]


def _measure_tiles(
    image: npt.NDArray,
    scale: float,
    channels: Channels,
    inside: npt.NDArray[np.bool_] | None,
    tiles: list[tuple[int, int, int, int]],
) -> Borders:
    if not tiles:
        return Borders()
    seen = [np.empty((0, 0), np.bool_)] * len(tiles)
    planes: list[npt.NDArray[np.float32]] = [np.empty((0, 0, 0), np.float32)] * len(tiles)
    noises = np.zeros(len(tiles))

    def take(start: int, stop: int) -> None:
        for i in range(start, stop):
            rows, columns = _around(tiles[i], image.shape[:2])
            planes[i] = guide_planes(image, scale, channels, rows, columns)
            seen[i] = _seen(inside, rows, columns, planes[i])
            noises[i] = _noise(planes[i], seen[i])

    run(take, len(tiles), chunk=1)
    noise = float(np.median(noises))
    best = Borders(noise=noise)
    for sigma in _PRESMOOTHED:
        found = _widths(planes, seen, tiles, image.shape[:2], sigma, noise)
        if len(found) < _FEWEST_BORDERS:
            continue
        best = _typical(found, sigma, noise)
        clear = noise < _NOISE or best.width < _HIDDEN * sigma
        if noise < _LIGHT_NOISE or (best.number >= _PLENTY and clear):
            break
    return best


def _around(tile: tuple[int, int, int, int], shape: tuple[int, ...]) -> tuple[slice, slice]:
    top, bottom, left, right = tile
    rows = slice(max(top - _REACH, 0), min(bottom + _REACH, shape[0]))
    columns = slice(max(left - _REACH, 0), min(right + _REACH, shape[1]))
    return rows, columns


def _noise(planes: npt.NDArray[np.float32], seen: npt.NDArray[np.bool_]) -> float:
    # Immerkaer's mask removes linear values; the median removes rare ones, such as borders.
    inner = seen[1:-1, 1:-1]
    if not inner.any():
        return 0.0
    found = []
    for plane in planes:
        rows = plane[:-2] - 2.0 * plane[1:-1] + plane[2:]
        both = rows[:, :-2] - 2.0 * rows[:, 1:-1] + rows[:, 2:]
        found.append(float(np.median(np.abs(both[inner]))) / 6.0 / 0.6745)
    return float(np.median(found))


def _count_even(
    planes: npt.NDArray[np.float32], borders: Borders, seen: npt.NDArray[np.bool_]
) -> tuple[int, int]:
    # Number of pixels with even surroundings, and of all, among those between borders.
    near = _ranges(planes, 1.0, _NEAR)
    wide = _ranges(planes, 0.7, math.ceil(0.7 * max(borders.width, 1.0)) + 1)
    between = seen & (wide < _BORDER * borders.contrast)
    noise = _SEEN_NOISE * borders.noise * math.sqrt(len(planes))
    even = near < math.hypot(_EVEN * borders.contrast, noise) + _LEVEL
    return int((even & between).sum()), int(between.sum())


def _ranges(planes: npt.NDArray[np.float32], sigma: float, reach: int) -> Plane:
    total = np.zeros(planes.shape[1:], np.float32)
    for plane in planes:
        low = smooth(plane, gaussian(sigma))
        high = low.copy()
        least_and_greatest(low, high, reach)
        total += (high - low) ** 2
    return np.sqrt(total, out=total)


def _widths(
    planes: list[npt.NDArray[np.float32]],
    seen: list[npt.NDArray[np.bool_]],
    tiles: list[tuple[int, int, int, int]],
    shape: tuple[int, ...],
    sigma: float,
    noise: float,
) -> npt.NDArray[np.float64]:
    # Width and contrast of borders: (n, 2).
    weights = gaussian(sigma)
    slope_noise = noise * math.sqrt(len(planes[0])) / (2.0 * math.sqrt(2.0 * math.pi) * sigma**2)
    steepness = max(0.01, 4.0 * slope_noise)
    candidates: list[npt.NDArray[np.float32]] = [np.empty((0, 5), np.float32)] * len(tiles)
    smoothed = list(planes)
    found = [np.empty((0, 2))] * len(tiles)

    def find(start: int, stop: int) -> None:
        for i in range(start, stop):
            smoothed[i] = np.stack([smooth(plane, weights) for plane in planes[i]])
            top, bottom, left, right = tiles[i]
            rows, columns = _around(tiles[i], shape)
            inside = (
                max(top, _RIM) - rows.start, min(bottom, shape[0] - _RIM) - rows.start,
                max(left, _RIM) - columns.start, min(right, shape[1] - _RIM) - columns.start,
            )  # fmt: skip
            candidates[i] = _ridges(smoothed[i], seen[i], *inside, np.float32(steepness))

    run(find, len(tiles), chunk=1)
    count = sum(map(len, candidates))
    every = max(-(-count // _MOST_BORDERS), 1)
    some = [np.ascontiguousarray(each[::every]) for each in candidates]

    def follow(start: int, stop: int) -> None:
        for i in range(start, stop):
            found[i] = _profiles(smoothed[i], seen[i], some[i], sigma)

    run(follow, len(tiles), chunk=1)
    together = np.concatenate(found)
    return together[together[:, 1] > 0]


def _typical(found: npt.NDArray[np.float64], sigma: float, noise: float) -> Borders:
    widths, contrasts = found.T
    clear = float(np.quantile(contrasts, 0.8))
    strong = contrasts > max(0.5 * float(np.quantile(contrasts, 0.9)), 4.0 * noise)
    narrow, wide = _quantiles(widths[strong], contrasts[strong], (0.25, 0.75))
    keep = contrasts > max(_CLEAR, 4.0 * noise / max(1.0, 2.0 * sigma))
    if keep.sum() < _FEWEST_BORDERS:
        keep = contrasts >= np.quantile(contrasts, 0.5)
    (width,) = _quantiles(widths[keep], contrasts[keep], (_QUANTILE,))
    spread = math.sqrt((wide * wide + 1.0) / (narrow * narrow + 1.0)) if narrow else math.inf
    return Borders(width, int(keep.sum()), noise, clear, spread)


def _quantiles(
    values: npt.NDArray[np.float64], weights: npt.NDArray[np.float64], shares: tuple[float, ...]
) -> list[float]:
    if not len(values):
        return [0.0] * len(shares)
    order = np.argsort(values)
    summed = np.cumsum(weights[order])
    return [float(np.interp(share * summed[-1], summed, values[order])) for share in shares]


@kernel
def _slope(planes, y, x):
    # The greatest slope of all planes together, and its direction (down, across).
    height, width = planes.shape[1:]
    up, down = max(y - 1, 0), min(y + 1, height - 1)
    left, right = max(x - 1, 0), min(x + 1, width - 1)
    yy = xx = xy = np.float32(0.0)
    for c in range(len(planes)):
        a = (planes[c, down, x] - planes[c, up, x]) / np.float32(max(down - up, 1))
        b = (planes[c, y, right] - planes[c, y, left]) / np.float32(max(right - left, 1))
        yy += a * a
        xx += b * b
        xy += a * b
    spread = np.sqrt((xx - yy) * (xx - yy) + np.float32(4.0) * xy * xy)
    slope = np.sqrt(np.float32(0.5) * (xx + yy + spread))
    # Half the angle whose cosine is (xx - yy) / spread.
    if spread > 0:
        cosine = (xx - yy) / spread
        across = np.sqrt(np.float32(0.5) * max(np.float32(1.0) + cosine, np.float32(0.0)))
        along = np.sqrt(np.float32(0.5) * max(np.float32(1.0) - cosine, np.float32(0.0)))
        return slope, along if xy >= 0 else -along, across
    return slope, np.float32(0.0), np.float32(1.0)


@kernel
def _ridges(planes, seen, top, bottom, left, right, steepness):
    """List the maxima of the slope across itself: (n, 5), y, x, direction, slope."""
    height, width = planes.shape[1:]
    slopes = np.empty((height, width), np.float32)
    for y in range(height):
        for x in range(width):
            slopes[y, x], _, _ = _slope(planes, y, x)
    found = np.empty((max(bottom - top, 0) * max(right - left, 0), 5), np.float32)
    count = 0
    for y in range(top, bottom):
        for x in range(left, right):
            slope = slopes[y, x]
            if slope <= steepness or not seen[y, x]:
                continue
            _, down, across = _slope(planes, y, x)
            if slope < _between(slopes, y + down, x + across):
                continue
            if slope <= _between(slopes, y - down, x - across):
                continue
            ridge = found[count]
            ridge[0], ridge[1], ridge[2], ridge[3], ridge[4] = y, x, down, across, slope
            count += 1
    return found[:count].copy()


@kernel
def _between(plane, y, x):
    height, width = plane.shape
    y = min(max(y, np.float32(0.0)), np.float32(height - 1))
    x = min(max(x, np.float32(0.0)), np.float32(width - 1))
    row = min(int(y), max(height - 2, 0))
    column = min(int(x), max(width - 2, 0))
    below, beside = min(row + 1, height - 1), min(column + 1, width - 1)
    v = y - np.float32(row)
    u = x - np.float32(column)
    upper = plane[row, column] + u * (plane[row, beside] - plane[row, column])
    lower = plane[below, column] + u * (plane[below, beside] - plane[below, column])
    return upper + v * (lower - upper)


@kernel
def _profiles(planes, seen, ridges, sigma):
    """Follow the profile through each ridge: (n, 2), width and contrast.

    The contrast is 0 where the profile leads to pixels that are not seen.
    """
    steps = int(_REACH / _STEP)
    found = np.empty((len(ridges), 2), np.float64)
    color = np.empty(len(planes), np.float32)
    for i in range(len(ridges)):
        ridge = ridges[i]
        y, x, down, across, slope = ridge[0], ridge[1], ridge[2], ridge[3], ridge[4]
        _take_color(planes, int(y), int(x), down, across, color)
        middle = _value(planes, color, y, x)
        first = (_value(planes, color, y + _STEP * down, x + _STEP * across) - middle) / _STEP
        second = (middle - _value(planes, color, y - _STEP * down, x - _STEP * across)) / _STEP
        least = _RISING * max(first, second)
        contrast = 0.0
        for sign in (1.0, -1.0):
            last = middle
            for k in range(1, steps + 1):
                place = sign * k * _STEP
                value = _value(planes, color, y + place * down, x + place * across)
                rise = sign * (value - last)
                if not rise > least * _STEP:
                    break
                contrast += rise
                last = value
                if not _is_seen(seen, y + place * down, x + place * across):
                    contrast = -np.inf
                    break
        square = (WIDTH_OF_SIGMA * contrast / (np.sqrt(2.0 * np.pi) * slope)) ** 2
        square -= WIDTH_OF_SIGMA**2 * (sigma * sigma + _CELL)
        found[i, 0] = np.sqrt(max(square, 0.25))
        found[i, 1] = max(contrast, 0.0)
    return found


@kernel
def _is_seen(seen, y, x):
    row = min(max(int(np.rint(y)), 0), seen.shape[0] - 1)
    column = min(max(int(np.rint(x)), 0), seen.shape[1] - 1)
    return seen[row, column]


@kernel
def _take_color(planes, y, x, down, across, color):
    # The direction in color space in which the planes change, as a unit vector.
    height, width = planes.shape[1:]
    total = np.float32(0.0)
    for c in range(len(planes)):
        a = planes[c, min(y + 1, height - 1), x] - planes[c, max(y - 1, 0), x]
        b = planes[c, y, min(x + 1, width - 1)] - planes[c, y, max(x - 1, 0)]
        color[c] = down * a + across * b
        total += color[c] * color[c]
    for c in range(len(planes)):
        color[c] /= max(np.sqrt(total), np.float32(1e-9))


@kernel
def _value(planes, color, y, x):
    total = 0.0
    for c in range(len(planes)):
        total += color[c] * _between(planes[c], np.float32(y), np.float32(x))
    return total
