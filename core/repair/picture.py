# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures for reports: textured models side by side in soft light, and repeated pictures."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.checks import SCALES, Floats
from ..grid.resize import resized

_TURN, _TILT = 0.6, 0.35
"""Angles in radians by which models are rotated to the side and down."""

_FINE = 1.4
"""Samples per pixel along each axis of a triangle, so that there are no holes."""

_BACK = 0.93
_LEAST_LIGHT = 0.45
_MARGIN = 1.08


class Painted(NamedTuple):
    """Triangles that show an image.

    Attributes
    ----------
    corners : (t, 3, 3) float
    uv : (t, 3, 2) float
    image : (h, w) or (h, w, c) array
        Row 0 is at v = 0.
    """

    corners: Floats
    uv: Floats
    image: npt.NDArray


def side_by_side(models: list[list[Painted]], size: int = 512) -> npt.NDArray[np.uint8]:
    """Draw models in a row, at a scale at which the first one fills its square.

    Parameters
    ----------
    models : list of list of Painted
        The parts of each model.
    size : int
        Height of the picture, and width of each model, in pixels.

    Returns
    -------
    (size, n * size, 3) uint8
        Row 0 is at the top.
    """
    points = np.concatenate([part.corners.reshape(-1, 3) for part in models[0]]) @ _view()
    low, high = points.min(axis=0), points.max(axis=0)
    middle, width = (low + high) / 2, max(float((high - low)[:2].max()), 1e-30) * _MARGIN
    return np.concatenate([_drawn(parts, middle, width, size) for parts in models], axis=1)


def repeated(image: npt.NDArray, axes: str = "both", size: int = 512) -> npt.NDArray[np.uint8]:
    """Draw a picture three times along each joined axis, to show how it tiles.

    Parameters
    ----------
    image : (h, w) or (h, w, c) array
        Of more than two channels, the first three are shown; of fewer, the first.
    axes : {"both", "x", "y"}
        As `TileSettings.axes`.
    size : int
        Most pixels of one tile along each side; larger ones are reduced.

    Returns
    -------
    (3 * h, 3 * w, 3) uint8
        Not repeated along an axis that is not joined.
    """
    pixels = image.reshape(*image.shape[:2], -1)
    shown = pixels[..., :3] if pixels.shape[2] >= 3 else np.repeat(pixels[..., :1], 3, axis=2)
    values = np.ascontiguousarray(shown, dtype=np.float32) * np.float32(SCALES[image.dtype.name])
    factor = max(*values.shape[:2], size) / size
    height, width = (max(round(n / factor), 1) for n in values.shape[:2])
    tile = np.rint(255 * np.clip(resized(values, (height, width)), 0, 1)).astype(np.uint8)
    return np.tile(tile, (1 if axes == "x" else 3, 1 if axes == "y" else 3, 1))


def _view() -> Floats:
    # Columns: right, up and towards the viewer, of models that stand on the plane y = 0.
    cos, sin = np.cos(_TURN), np.sin(_TURN)
    turn = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
    cos, sin = np.cos(_TILT), np.sin(_TILT)
    return turn @ np.array([[1, 0, 0], [0, cos, sin], [0, -sin, cos]])


def _drawn(parts: list[Painted], middle: Floats, width: float, size: int) -> npt.NDArray[np.uint8]:
    depth = np.full(size * size, -np.inf)
    colors = np.full((size * size, 3), _BACK)
    for part in parts:
        seen = (part.corners @ _view() - middle) * (size / width)
        sides = np.cross(seen[:, 1] - seen[:, 0], seen[:, 2] - seen[:, 0])
        lengths = np.linalg.norm(sides, axis=1)
        facing = np.abs(sides @ np.array([0.35, 0.45, 0.82])) / np.maximum(lengths, 1e-30)
        light = _LEAST_LIGHT + (1 - _LEAST_LIGHT) * facing
        spans = np.abs(seen - np.roll(seen, 1, axis=1))[..., :2].max(axis=(1, 2))
        steps = np.ceil(_FINE * np.minimum(spans, 4.0 * size)).astype(int) + 1
        for count in np.unique(steps):
            some = np.flatnonzero(steps == count)
            shares = _shares(count)
            for few in np.array_split(some, -(-len(some) * len(shares) // (1 << 21))):
                _paint(part, few, seen, light, shares, size, depth, colors)
    picture = colors.reshape(size, size, 3)[::-1]
    return np.rint(255 * np.clip(picture, 0, 1)).astype(np.uint8)


def _shares(count: int) -> Floats:
    # Barycentric coordinates of points all over a triangle.
    i, j = np.mgrid[: count + 1, : count + 1]
    inside = i + j <= count
    return np.column_stack([i[inside], j[inside], count - i[inside] - j[inside]]) / count


def _paint(
    part: Painted,
    triangles: npt.NDArray[np.int64],
    seen: Floats,
    light: Floats,
    shares: Floats,
    size: int,
    depth: Floats,
    colors: Floats,
) -> None:
    places = np.einsum("kc,tcx->tkx", shares, seen[triangles]).reshape(-1, 3)
    pixels = np.floor(places[:, :2] + size / 2).astype(int)
    owners = np.repeat(triangles, len(shares))
    there = ((pixels >= 0) & (pixels < size)).all(axis=1)
    order = np.flatnonzero(there)
    order = order[np.argsort(places[order, 2], kind="stable")]
    flat = pixels[order, 1] * size + pixels[order, 0]
    # Of several points in a pixel the last one, which is the nearest.
    last = len(flat) - 1 - np.unique(flat[::-1], return_index=True)[1]
    chosen, flat = order[last], flat[last]
    nearer = places[chosen, 2] > depth[flat]
    chosen, flat = chosen[nearer], flat[nearer]
    depth[flat] = places[chosen, 2]
    uv = np.einsum("kc,kcx->kx", shares[chosen % len(shares)], part.uv[owners[chosen]])
    colors[flat] = _read(part.image, uv) * light[owners[chosen], None]


def _read(image: npt.NDArray, uv: Floats) -> Floats:
    # Linear between texels; the image repeats.
    values = image if image.ndim == 3 else image[..., None]
    values = values[..., :3] if values.shape[2] >= 3 else np.repeat(values[..., :1], 3, axis=2)
    height, width = values.shape[:2]
    rows, columns = uv[:, 1] * height - 0.5, uv[:, 0] * width - 0.5
    row, column = np.floor(rows).astype(int), np.floor(columns).astype(int)
    down, across = (rows - row)[:, None], (columns - column)[:, None]
    result = np.zeros((len(uv), 3))
    for i, share in ((0, 1 - down), (1, down)):
        for j, part in ((0, 1 - across), (1, across)):
            result += share * part * values[(row + i) % height, (column + j) % width]
    return result * SCALES[image.dtype.name]
