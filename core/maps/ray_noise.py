# SPDX-License-Identifier: GPL-3.0-or-later
"""Smooths the noise of ray tracing along the surface, by adaptive radii."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run
from ..base.progress import phase
from ..mesh.nearest import point_tree
from .tracing import Sites, tangents

_Single = npt.NDArray[np.float32]

_STEPS = 3
"""Number of radii of fits, each half of the one before."""

_REACH = 2.0
"""The largest radius, relative to the smoothing length."""

_AROUND = 5.0
"""Radius over which errors are averaged, in distances between places."""

_LOSS_FACTOR = 4.0
"""Factor of the squared difference to the next smaller radius, which underestimates the detail that
is lost."""

_WEIGHT_POWER = 2.0
"""Weights of radii are the inverse of their squared errors to this power."""

_LEAST_COSINE = 0.5
"""Cosine between the normals of two places at which their weight becomes 0."""

_GAP, _STEEPEST = 0.5, 0.1
"""Places belong to another sheet if they are higher or lower by more than the first value times the
distance between neighbouring places, plus the second times their distance."""

_RIDGE = 1e-3
"""Ridge regularization of slopes, which would follow noise where positions or normals hardly
differ."""

_MOST = 2048
"""Most places around a leaf of the tree; of more, some are left out evenly."""

_SLOPES = 4
"""Slopes of a fit: along two directions, and in the tilt of the normal along both."""

_TERMS = 15
"""Entries of half the symmetric matrix of the value and the slopes."""


def without_noise(sites: Sites, halves: _Single, length: float) -> _Single:
    """Smooth two independent estimates at places on a surface, and return their mean.

    Around each place, both halves are fitted within several radii by functions that are linear in
    the position and the normal (Moon et al. 2014, "Adaptive rendering based on weighted local
    regression"). Weights fall with the distance and with the angle between normals, so that values
    are not smoothed across sharp edges; places above or below belong to another sheet.

    The noise of both halves is independent (Rousselle et al. 2012, "Adaptive rendering with
    non-local means filtering"). So the product of their differences between a radius and the next
    smaller one is, averaged around a place, the square of the detail that the radius loses; the
    square of the difference between the halves is the noise that is left. If a radius loses little,
    smaller ones lose no more. Radii are mixed by weights that fall with the sum of both errors.

    Parameters
    ----------
    sites : Sites
    halves : (k, 2 c) float32
        The first estimate of c values, then the second.
    length : float
        Smoothing length, in distances between places; 0 does not smooth.

    Returns
    -------
    (k, c) float32
    """
    count = halves.shape[1] // 2
    if length <= 0 or not len(halves):
        return 0.5 * (halves[:, :count] + halves[:, count:])
    with phase(0.0, 0.1, "Smoothing"):
        tree = point_tree(sites.points.astype(np.float64))
        order = tree.numbers
        normals, spacings = sites.normals[order], sites.spacings[order]
        raw = np.ascontiguousarray(halves[order], dtype=np.float32)
    leaves = 1 << tree.depth
    tried = np.empty((len(raw), _STEPS + 1, 2 * count), dtype=np.float32)
    tried[:, _STEPS] = raw
    with phase(0.1, 0.7, "Smoothing"):
        run(
            _fit,
            leaves,
            tree,
            normals,
            spacings,
            _REACH * float(length),
            raw,
            tried,
            chunk=_chunk(leaves),
        )
    errors = _errors_of(tried)
    around = np.empty_like(errors)
    with phase(0.7, 1.0, "Smoothing"):
        run(_average, leaves, tree, normals, spacings, _AROUND, errors, around,
            chunk=_chunk(leaves))  # fmt: skip
    result = np.empty((len(raw), count), dtype=np.float32)
    result[order] = _mixed(tried, around)
    return result


def _chunk(leaves: int) -> int:
    return min(max(leaves // 64, 1), 256)


def _errors_of(tried: _Single) -> _Single:
    # For each radius and value, the squares of the detail that is lost, and of the noise left.
    count = tried.shape[2] // 2
    away = tried[:, :-1] - tried[:, 1:]
    lost = away[..., :count] * away[..., count:]
    noise = np.float32(0.25) * (tried[..., count:] - tried[..., :count]) ** 2
    return np.concatenate([lost, noise], axis=1).reshape(len(tried), -1)


def _mixed(tried: _Single, errors: _Single) -> _Single:
    # Weighted means over the radii; each value has its own weights.
    count = tried.shape[2] // 2
    every = errors.reshape(len(tried), -1, count)
    squares = every[:, _STEPS:] + np.float32(1e-12)
    lost = np.minimum.accumulate(np.maximum(every[:, :_STEPS], 0.0), axis=1)
    squares[:, :_STEPS] += np.float32(_LOSS_FACTOR) * lost
    weights = (squares.min(axis=1, keepdims=True) / squares) ** np.float32(_WEIGHT_POWER)
    weights /= weights.sum(axis=1, keepdims=True)
    means = 0.5 * (tried[..., :count] + tried[..., count:])
    mixed: _Single = (weights * means).sum(axis=1)
    return mixed


@kernel
def _leaf(tree, leaf):
    # The points of a leaf.
    count = len(tree.points)
    return (count * leaf) >> tree.depth, (count * (leaf + 1)) >> tree.depth


@kernel
def _gather(tree, leaf, reach, stack, found):
    # Lists the points of leaves within reach of a leaf's box; returns their number.
    first = (1 << tree.depth) - 1
    box = tree.boxes[first + leaf]
    stride = 1
    while True:
        count, seen, fits = 0, 0, True
        stack[0, 0], stack[0, 1] = 0, 0
        waiting = 1
        while waiting > 0 and fits:
            waiting -= 1
            level, node = stack[waiting, 0], stack[waiting, 1]
            other = tree.boxes[(1 << level) - 1 + node]
            square = 0.0
            for x in range(3):
                away = max(other[0, x] - box[1, x], box[0, x] - other[1, x], 0.0)
                square += away * away
            if square > reach * reach:
                continue
            if level < tree.depth:
                stack[waiting, 0] = stack[waiting + 1, 0] = level + 1
                stack[waiting, 1], stack[waiting + 1, 1] = 2 * node + 1, 2 * node
                waiting += 2
                continue
            low, high = _leaf(tree, node)
            for k in range(low, high):
                if node == leaf or seen % stride == 0:
                    if count == len(found):
                        fits = False
                        break
                    found[count] = k
                    count += 1
                seen += 1
        if fits:
            return count
        stride *= 2


@kernel
def _closeness(mx, my, mz, dx, dy, dz, square, nx, ny, nz, spacing):
    # The weight between two places: 1 on the same plane, 0 across an edge or a gap.
    agrees = (mx * nx + my * ny + mz * nz - _LEAST_COSINE) / (1.0 - _LEAST_COSINE)
    if agrees <= 0.0:
        return 0.0
    up = 0.5 * (dx * (mx + nx) + dy * (my + ny) + dz * (mz + nz))
    most = _GAP * spacing + _STEEPEST * np.sqrt(square)
    level = 1.0 - up * up / (most * most + 1e-30)
    if level <= 0.0:
        return 0.0
    return min(agrees * agrees, 1.0) * level * level


@kernel
def _average(start, stop, tree, normals, spacings, radius, values, out):
    # Means around each place, (n, c).
    stack, found = np.empty((128, 2), np.int64), np.empty(_MOST, np.int64)
    points, columns = tree.points, values.shape[1]
    sums = np.empty(columns)
    for leaf in range(start, stop):
        low, high = _leaf(tree, leaf)
        count = _gather(tree, leaf, radius * spacings[low:high].max(), stack, found)
        for i in range(low, high):
            nx, ny = np.float64(normals[i, 0]), np.float64(normals[i, 1])
            nz = np.float64(normals[i, 2])
            spacing = np.float64(spacings[i])
            farthest = (radius * spacing) ** 2
            total = 1.0
            for c in range(columns):
                sums[c] = values[i, c]
            for n in range(count):
                j = found[n]
                dx, dy = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
                dz = points[j, 2] - points[i, 2]
                square = dx * dx + dy * dy + dz * dz
                if square >= farthest or j == i:
                    continue
                weight = _closeness(
                    np.float64(normals[j, 0]), np.float64(normals[j, 1]),
                    np.float64(normals[j, 2]), dx, dy, dz, square, nx, ny, nz, spacing,
                )  # fmt: skip
                near = 1.0 - square / farthest
                weight *= near * near
                total += weight
                for c in range(columns):
                    sums[c] += weight * values[j, c]
            for c in range(columns):
                out[i, c] = sums[c] / total


@kernel
def _fit(start, stop, tree, normals, spacings, radius, values, out):
    # Values of linear fits at each place, (n, radii, c), from the largest radius down by halves;
    # clipped to the range of near values, so that black and white areas stay so.
    stack, found = np.empty((128, 2), np.int64), np.empty(_MOST, np.int64)
    points, columns, steps = tree.points, values.shape[1], out.shape[1] - 1
    matrices = np.empty((steps, _TERMS))
    sides = np.empty((steps, 1 + _SLOPES, columns))
    lows, highs = np.empty(columns), np.empty(columns)  # within the smallest radius
    x = np.empty(1 + _SLOPES)
    for leaf in range(start, stop):
        low, high = _leaf(tree, leaf)
        count = _gather(tree, leaf, radius * spacings[low:high].max(), stack, found)
        for i in range(low, high):
            nx, ny = np.float64(normals[i, 0]), np.float64(normals[i, 1])
            nz = np.float64(normals[i, 2])
            ax, ay, az, bx, by, bz = tangents(nx, ny, nz)
            spacing = np.float64(spacings[i])
            farthest = (radius * spacing) ** 2
            scale = 1.0 / max(radius * spacing, 1e-30)
            matrices[:] = 0.0
            sides[:] = 0.0
            for c in range(columns):
                lows[c] = highs[c] = values[i, c]
            for step in range(steps):
                matrices[step, 0] = 1.0
                for c in range(columns):
                    sides[step, 0, c] = values[i, c]
            for n in range(count):
                j = found[n]
                dx, dy = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
                dz = points[j, 2] - points[i, 2]
                square = dx * dx + dy * dy + dz * dz
                if square >= farthest or j == i:
                    continue
                mx, my = np.float64(normals[j, 0]), np.float64(normals[j, 1])
                mz = np.float64(normals[j, 2])
                close = _closeness(mx, my, mz, dx, dy, dz, square, nx, ny, nz, spacing)
                if close <= 0.0:
                    continue
                x[0] = 1.0
                x[1] = scale * (dx * ax + dy * ay + dz * az)
                x[2] = scale * (dx * bx + dy * by + dz * bz)
                x[3] = mx * ax + my * ay + mz * az
                x[4] = mx * bx + my * by + mz * bz
                limit = farthest
                for step in range(steps):
                    if square >= limit:
                        break
                    near = 1.0 - square / limit
                    weight = close * near * near
                    entry = 0
                    for r in range(1 + _SLOPES):
                        part = weight * x[r]
                        for s in range(r + 1):
                            matrices[step, entry] += part * x[s]
                            entry += 1
                        for c in range(columns):
                            sides[step, r, c] += part * values[j, c]
                    limit *= 0.25
                    if step == steps - 1:
                        for c in range(columns):
                            lows[c] = min(lows[c], values[j, c])
                            highs[c] = max(highs[c], values[j, c])
            small = 1.0
            for step in range(steps):
                _solve(matrices[step], sides[step], _RIDGE * matrices[step, 0], small)
                small *= 0.25
                for c in range(columns):
                    out[i, step, c] = min(max(sides[step, 0, c], lows[c]), highs[c])


@kernel
def _solve(matrix, sides, ridge, small):
    # Eliminates slopes from the last one on; the values come to be in the first row of `sides`.
    columns, size = sides.shape[1], 1 + _SLOPES
    matrix[2] += ridge * small
    matrix[5] += ridge * small
    matrix[9] += ridge
    matrix[14] += ridge
    for r in range(size - 1, 0, -1):
        pivot = matrix[r * (r + 1) // 2 + r]
        for s in range(r):
            factor = matrix[r * (r + 1) // 2 + s] / pivot
            for t in range(s + 1):
                matrix[s * (s + 1) // 2 + t] -= factor * matrix[r * (r + 1) // 2 + t]
            for c in range(columns):
                sides[s, c] -= factor * sides[r, c]
    for c in range(columns):
        sides[0, c] /= matrix[0]
