# SPDX-License-Identifier: GPL-3.0-or-later
"""Scans of solids by simulated depth cameras: range images, and several fused into voxels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.ndimage
from distances import Floats, Solid, gradient, norm, turn
from meshings import EXTENT

REACH = 1.9
"""Range images show what is at most this far from their center."""

FACING = 0.2
"""Least cosine between a surface that is seen and the direction to the camera."""

SURE = 0.3
"""Least sum of weights of a voxel that is known."""


class Camera(NamedTuple):
    """Noise of a depth camera.

    Attributes
    ----------
    noise : float
        Standard deviation of its bumps, in pixels.
    width : float
        Standard deviation of the Gaussian that makes bumps of white noise, in pixels.
    white : float
        White noise in addition, as a share of `noise`.
    power : float
        Noise grows with the slant of the surface to this power.
    step : float
        Depths are rounded to multiples of this, in pixels; 0 for none.
    mixed : float
        Share of the pixels at outlines that see a mean of near and far.
    """

    noise: float
    width: float
    white: float
    power: float
    step: float
    mixed: float


def some_camera(rng) -> Camera:
    """Choose a random camera."""
    noise = np.exp(rng.uniform(np.log(0.05), np.log(0.7)))
    step = noise * rng.uniform(0.2, 2) if rng.random() < 0.6 else 0.0
    mixed = rng.uniform(0, 0.2) if rng.random() < 0.5 else 0.0
    bumps = rng.uniform(0.3, 2.5), rng.uniform(0, 0.6), rng.uniform(0, 1)
    return Camera(noise, *bumps, step, mixed)


def one_view(rng, shape: Solid, pixels: int, camera: Camera) -> tuple[Floats, np.ndarray, float]:
    """Mesh a range image: vertices, some of them not a number and unused; faces; pixel width."""
    pixel, view = 2 * REACH / pixels, turn(rng)
    line, depth, *_ = _depths(rng, shape, view, pixel, camera)
    x, y = np.meshgrid(line, line, indexing="ij")
    at = np.arange(x.size).reshape(x.shape)
    a, b = at[:-1, :-1].reshape(-1), at[1:, :-1].reshape(-1)
    c, d = at[1:, 1:].reshape(-1), at[:-1, 1:].reshape(-1)
    f = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    v = np.stack([x, y, depth], -1).reshape(-1, 3)
    longest = norm(v[f] - v[np.roll(f, -1, 1)], 2).max(1)
    f = f[longest < rng.uniform(3, 6) * pixel]  # neither across outlines nor where nothing is seen
    return v @ view, f, pixel


def fused(rng, shape: Solid, exact: Floats, h: float, camera: Camera) -> tuple[Floats, np.ndarray]:
    """Fuse range images from random directions into voxels (Curless and Levoy 1996).

    Each view adds its truncated distances, weighted by how the surface faces it.

    Parameters
    ----------
    rng, shape, camera
    exact : (n, n, n)
        Distances at the voxels, from -EXTENT to EXTENT; returned where no view saw anything.
    h : float
        Width of the voxels.

    Returns
    -------
    d : (n, n, n)
        Distances.
    known : (n, n, n) bool
        Where they were seen, or are far from the surface.
    """
    pixel, band = rng.uniform(0.5, 1.2) * h, rng.uniform(2, 3.5) * h
    asked = abs(exact) < 4 * h
    places = np.linspace(-EXTENT, EXTENT, len(exact))[np.argwhere(asked)]
    total, weight = np.zeros(len(places)), np.zeros(len(places))
    for _ in range(rng.integers(6, 17)):
        view = turn(rng)
        line, depth, slant, empty = _depths(rng, shape, view, pixel, camera)
        # Registration errs a little.
        axis, shift = rng.normal(0, (0.15, 0.3), (3, 2)).T * camera.noise * pixel
        x, y, z = ((places + np.cross(axis, places) + shift) @ view.T).T
        at = (np.stack([x, y]) - line[0]) / pixel
        one = tuple(np.clip(np.round(at).astype(int), 0, len(line) - 1))
        between = scipy.ndimage.map_coordinates(depth, at, order=1, cval=np.nan)
        smooth = np.isfinite(between) & (abs(between - depth[one]) < 2 * pixel)
        facing = slant[one]
        distance = z - np.where(smooth, between, depth[one])
        distance *= np.maximum(facing, 0.3) ** rng.choice([0.5, 1.0])
        seen = np.isfinite(distance) & (distance > -band)
        total[seen] += facing[seen] * np.minimum(distance[seen], band)
        weight[seen] += facing[seen]
        through = empty[one]
        total[through] += 0.5 * band
        weight[through] += 0.5
    sure = weight > SURE
    d, known = exact.copy(), np.ones(exact.shape, bool)
    d[asked] = np.where(sure, total / np.maximum(weight, 1e-9), exact[asked])
    known[asked] = sure
    return d, known


def _depths(rng, shape, view, pixel, camera):
    # Depths along the last axis of the view, by sphere tracing, with noise; not a number where
    # nothing is seen. Also: cosines to the view, and pixels that see no surface around them.
    line = np.arange(-REACH, REACH, pixel)
    x, y = np.meshgrid(line, line, indexing="ij")
    start = x.reshape(-1, 1) * view[0] + y.reshape(-1, 1) * view[1]
    z, far = np.full(x.size, REACH + 0.5), np.full(x.size, np.inf)
    going = np.arange(x.size)
    for _ in range(60):
        far[going] = shape(start[going] + z[going, None] * view[2])
        z[going] -= 0.8 * np.maximum(far[going], 0)
        going = going[(far[going] > 2e-3) & (z[going] > -REACH)]
    hit = far < 4e-3
    slant = np.zeros(x.size)
    slant[hit] = gradient(shape, start[hit] + z[hit, None] * view[2]) @ view[2]
    seen = hit & (slant > FACING)
    noise = scipy.ndimage.gaussian_filter(rng.normal(size=x.shape), camera.width)
    noise = noise / noise.std() + camera.white * rng.normal(size=x.shape)
    depth = z + camera.noise * pixel * noise.reshape(-1) / np.maximum(slant, FACING) ** camera.power
    z, depth = (np.where(seen, a, np.nan).reshape(x.shape) for a in (z, depth))
    if camera.mixed:
        near = scipy.ndimage.maximum_filter(np.nan_to_num(z, nan=-9), 3)
        low = scipy.ndimage.minimum_filter(np.nan_to_num(z, nan=9), 3)
        at = np.isfinite(z) & (near - low > 5 * pixel) & (rng.random(z.shape) < camera.mixed)
        share = rng.random(int(at.sum()))
        depth[at] = share * near[at] + (1 - share) * low[at]
    if camera.step:
        depth = camera.step * pixel * np.round(depth / (camera.step * pixel))
    empty = scipy.ndimage.binary_erosion(~hit.reshape(x.shape))
    return line, depth, slant.reshape(x.shape), empty
