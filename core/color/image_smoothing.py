# SPDX-License-Identifier: GPL-3.0-or-later
"""Steps of smoothing an image by the Beltrami kernel, whose arguments were checked (paper C)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base.checks import (
    BAND,
    SCALES,
)
from ..base.findings import tell
from ..base.parallel import blocks
from ..base.progress import aside, ask, phase
from ..beltrami.grid_smoothing import smooth_grid, surface_areas
from ..grid.channels import opacity_channel
from ..grid.noise import measure_noise
from ..grid.pixels import copied, mix
from ..settings import BETA_UNKNOWN, BeltramiSettings

_FARTHEST = 1e15  # its square is far from the ends of float32
_LEAST_NOISE, _MOST = 1e-30, 1e6

_TOLD = 1e-3
"""Least noise that is reported as a number: rounding to bytes makes as much."""


_NOISE = 1.1
"""Distance, in pixels, that a difference of one standard deviation of the noise counts as.

Chosen on pictures of `tools/training/image_examples.py`, by the mean and the least gain.
"""


def with_beta(
    settings: BeltramiSettings, image: Any, inside: npt.NDArray[np.bool_] | None = None
) -> Any:
    """Return settings whose `beta` follows from the noise, if `settings.by_noise` says so.

    Parameters
    ----------
    settings : BeltramiSettings
    image : (h, w, c) array
        Or an object whose windows are read as those of arrays.
    inside : (h, w) bool, optional
        The pixels in which noise is measured.
    """
    if not settings.by_noise:
        return settings
    alpha = opacity_channel(image.shape[2], settings.alpha)
    count = image.shape[2] if alpha < 0 else alpha
    noise = measure_noise(image, SCALES[image.dtype.name], alpha, inside=inside)
    if noise is None:
        return settings.changed(beta=BETA_UNKNOWN)
    # Distances add up over the channels.
    beta = min(_NOISE / max(noise * math.sqrt(count), _LEAST_NOISE), _MOST)
    if noise < _TOLD:
        tell("Hardly any noise was found.")
    else:
        tell("Noise of {noise:.2g}; Keep Edges {beta:.3g}.", noise=noise, beta=beta)
    return settings.changed(beta=beta)


def smoothed_image(
    given: npt.NDArray, settings: BeltramiSettings, weights: npt.NDArray | None
) -> npt.NDArray:
    """Denoise an image as `beltrami_image` does, from checked arguments."""
    if settings.time == 0:
        return given.copy()
    with aside("Smoothing"):
        settings = with_beta(settings, given.reshape(*given.shape[:2], -1))
    flat = np.empty((*given.shape[:2], 0), dtype=np.float32)
    return smoothed(given, flat, settings, weights, "image")[0]


def smoothed(
    given: npt.NDArray,
    points: npt.NDArray,
    settings: BeltramiSettings,
    mask: npt.NDArray | None,
    smooth: str,
) -> tuple[npt.NDArray, npt.NDArray]:
    """Smooth an image, its points in space, or both.

    Parameters
    ----------
    given : (h, w) or (h, w, c) array
    points : (h, w, 3) or (h, w, 0) array
        Positions of the pixels, in mean distances between neighbours; (h, w, 0) for a flat image.
    settings : BeltramiSettings
    mask : (h, w) array of float, optional
    smooth : {"image", "embedding", "both"}

    Returns
    -------
    image, points : array
    """
    pixels = given.reshape(*given.shape[:2], -1)
    scale = SCALES[given.dtype.name]
    floats = np.float64 if given.dtype == np.float64 else np.float32
    alpha = opacity_channel(pixels.shape[2], settings.alpha)
    count = pixels.shape[2] if alpha < 0 else alpha
    colors = np.empty((*pixels.shape[:2], count), dtype=floats)
    opacity = np.empty((*pixels.shape[:2], pixels.shape[2] - count), dtype=floats)  # of 0 or 1
    with aside("Smoothing"):
        for band in blocks(len(pixels), BAND):
            np.multiply(pixels[band, :, :count], scale, out=colors[band], dtype=floats)
            np.multiply(pixels[band, :, count:], scale, out=opacity[band], dtype=floats)
            np.clip(opacity[band], 0.0, 1.0, out=opacity[band])
    for i in range(settings.iterations):
        with phase(i / settings.iterations, (i + 1) / settings.iterations, "Smoothing"):
            new_colors, new_points = _step(colors, opacity, points, settings)
        colors = colors if smooth == "embedding" else new_colors
        points = points if smooth == "image" else new_points
    with phase(1.0, 1.0, "Smoothing"):
        result = copied(pixels)
        if smooth != "embedding":
            for band in blocks(len(pixels), BAND):
                values = np.divide(colors[band], scale)
                result[band, :, :count] = np.rint(values) if scale != 1.0 else values
            if mask is not None:
                mix(pixels, mask, result)
    return result.reshape(given.shape), points


def _step(
    colors: npt.NDArray,
    opacity: npt.NDArray,
    points: npt.NDArray,
    settings: BeltramiSettings,
) -> tuple[npt.NDArray, npt.NDArray]:
    # Colors are weighted by opacity, for distances and for means.
    (height, width, count), transparent = colors.shape, opacity.shape[2] > 0
    beside = count + opacity.shape[2]
    kind = np.result_type(colors, points)
    signal = np.empty((height, width, beside + points.shape[2]), dtype=kind)
    guide = np.empty((height, width, count + points.shape[2]), dtype=np.float32)
    with aside("Smoothing"):
        for band in blocks(height, BAND):
            covered = colors[band] * opacity[band] if transparent else colors[band]
            signal[band, :, :count] = covered
            signal[band, :, count:beside] = opacity[band]
            signal[band, :, beside:] = points[band]
            with np.errstate(over="ignore"):  # too bright for float32: an edge nothing crosses
                guide[band, :, :count] = np.clip(settings.beta * covered, -_FARTHEST, _FARTHEST)
            guide[band, :, count:] = points[band]
        # Pixels are weighted by their area in space.
        areas = np.ones((height, width), dtype=np.float32)
        if points.shape[2]:
            areas = surface_areas(points.astype(np.float32))
        ask()
    means = smooth_grid(signal, guide, points.shape[2] == 0, areas, settings)
    if not transparent:
        return means[..., :count], means[..., beside:]
    new_colors = np.empty_like(colors, dtype=means.dtype)
    with phase(1.0, 1.0, "Smoothing"):
        for band in blocks(height, BAND):
            share = means[band, :, count:beside]
            shown = means[band, :, :count] / np.where(share > 0, share, 1)
            new_colors[band] = np.where(share > 0, shown, colors[band])
    return new_colors, means[..., beside:]
