# SPDX-License-Identifier: GPL-3.0-or-later
"""Smoothing of images, flat or painted on a parametric manifold, that keeps edges (paper C)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.checks import (
    LARGEST,
    as_array,
    by_keyword,
    checked_image,
    checked_weights,
    checked_word,
    is_dask,
    refuse_with_dask,
)
from ..base.progress import ProgressCallback, phase, reporting
from ..errors import InvalidSignal
from ..grid.pixels import mix
from ..settings import BETA_UNKNOWN, BeltramiSettings, given_or_default
from .image_smoothing import smoothed, smoothed_image

_SMOOTHED = ("image", "embedding", "both")


@by_keyword
def beltrami_image(
    image: npt.ArrayLike,
    settings: BeltramiSettings | None = None,
    *,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
) -> npt.NDArray:
    """Smooth an image by the short-time Beltrami kernel, which keeps edges.

    Each pixel becomes a weighted mean of those around it. Weights are Gaussians of the distance
    along the surface (x, y, beta I), so pixels beyond an edge have little weight.

    Parameters
    ----------
    image : (h, w) or (h, w, c) array of uint8, uint16, float32 or float64
        Any number of channels. Whole numbers are scaled to [0, 1]; floats may go beyond. May be a
        dask array.
    settings : BeltramiSettings, optional
    mask : (h, w) array of float in [0, 1], optional
        1 smooths fully, less mixes with the input, 0 keeps it bit for bit.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    array like `image`
        Each value is within the range of the input near it. A time of 0 returns the input bit for
        bit; opacity (see `BeltramiSettings.alpha`) always stays. A dask array gives a dask array,
        computed later chunk by chunk, with the same bits; see `color.chunked`.

    Raises
    ------
    InvalidSignal
        If the image's shape or type is not supported, it holds NaN or infinity, or the mask does
        not fit it.
    Cancelled
        If `progress` returned False.

    Notes
    -----
    In the paper, beta is chosen by hand. Here its default follows from the noise, which is measured
    in windows all over the image: noise of one standard deviation counts as about one pixel, so
    that a clean image hardly changes. Where it cannot be measured, on a line of pixels, beta is 7.

    Equations 20 to 23 of paper C: weights are exp(-d^2 / 4t), normalized to a sum of 1. Pixels are
    weighted by their area in space. With their area on the surface (x, y, beta I) instead, the
    change of smooth images tends to t times the Laplace-Beltrami operator as t goes to 0, but edges
    blur. In the paper, the front within a triangle is a line; here it is a circle around a point.
    So distances on planes are exact, and beta = 0 gives exact Gaussians.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> step = np.where(np.arange(16) < 8, 0.2, 0.8) * np.ones((12, 1))
    >>> noisy = step + 0.05 * np.random.default_rng(0).normal(size=step.shape)
    >>> smooth = core.beltrami_image(noisy, core.BeltramiSettings(beta=15))
    >>> bool(abs(smooth - step).mean() < 0.4 * abs(noisy - step).mean())
    True
    """
    settings = given_or_default(settings, BeltramiSettings)
    if is_dask(image):
        from .chunked import smooth_chunks

        refuse_with_dask(progress=progress)
        return smooth_chunks(image, settings, mask)
    given = checked_image(image, LARGEST if settings.by_noise else None)
    weights = checked_weights(mask, given)
    with reporting(progress):
        return smoothed_image(given, settings, weights)


@by_keyword
def beltrami_manifold(
    image: npt.ArrayLike,
    embedding: npt.ArrayLike,
    settings: BeltramiSettings | None = None,
    *,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
    smooth: str = "image",
) -> tuple[npt.NDArray, npt.NDArray]:
    """Smooth an image painted on a parametric manifold, the manifold, or both.

    Parameters
    ----------
    image : (h, w) or (h, w, c) array
        As in `beltrami_image`.
    embedding : (h, w, 3) array of float32 or float64
        Positions of the pixels in space. The unit of lengths, a pixel for `time` and `beta`, is the
        mean distance between neighbours along the grid's axes.
    settings, mask, progress
        As in `beltrami_image`, but the default beta is 7.
    smooth : {"image", "embedding", "both"}
        Which components the kernel is applied to (equation 7 of paper C).

    Returns
    -------
    image : array like `image`
    embedding : array like `embedding`
        Components that are not smoothed are returned bit for bit.

    Raises
    ------
    InvalidSignal, Cancelled
        As in `beltrami_image`; also if the embedding does not fit the image.
    InvalidSettings
        If `smooth` is another word.

    Notes
    -----
    Paper C, equations 7 and 20 to 23, as in `beltrami_image`.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> x, y = np.meshgrid(np.arange(8.0), np.arange(6.0))
    >>> image, roof = x / 8, np.stack([x, y, abs(x - 4)], axis=-1)
    >>> smooth, points = core.beltrami_manifold(image, roof, core.BeltramiSettings(time=0.5))
    >>> smooth.shape, bool((points == roof).all())
    ((6, 8), True)
    """
    given = checked_image(image)
    places = _checked_embedding(embedding, given)
    weights = checked_weights(mask, given)
    settings = given_or_default(settings, BeltramiSettings)
    if settings.beta < 0:
        settings = settings.changed(beta=BETA_UNKNOWN)
    checked_word(smooth, "smooth", _SMOOTHED)
    if settings.time == 0:
        return given.copy(), places.copy()
    center, unit = places.mean(axis=(0, 1), dtype=np.float64), _mean_distance(places)
    points = (places - center) / unit
    with reporting(progress):
        result, points = smoothed(given, points, settings, weights, smooth)
        new_places = places.copy()
        if smooth != "image":
            new_places[...] = points * unit + center
            if weights is not None:
                with phase(1.0, 1.0, "Smoothing"):
                    mix(places, weights, new_places)
        return result, new_places


def _checked_embedding(embedding: npt.ArrayLike, given: npt.NDArray) -> npt.NDArray:
    points = as_array(embedding, "embedding")
    if points.dtype not in (np.float32, np.float64):
        raise InvalidSignal(f"The embedding is of type {points.dtype}; give float32 or float64.")
    if points.shape != (*given.shape[:2], 3):
        raise InvalidSignal(
            f"The embedding has the shape {points.shape}; give {(*given.shape[:2], 3)}."
        )
    if not np.isfinite(points).all():
        raise InvalidSignal("The embedding holds NaN or infinity; replace these values first.")
    return points


def _mean_distance(embedding: npt.NDArray) -> float:
    with np.errstate(over="ignore"):
        steps = [np.linalg.norm(np.diff(embedding, axis=axis), axis=2).ravel() for axis in (0, 1)]
    mean = float(np.concatenate(steps).mean(dtype=np.float64)) if embedding[..., 0].size > 1 else 0
    if mean == 0:
        raise InvalidSignal("All points of the embedding are one; give a surface.")
    if mean == np.inf:
        raise InvalidSignal("The embedding is too large to measure; scale it down.")
    return mean
