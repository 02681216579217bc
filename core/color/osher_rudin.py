# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpening of images by explicit steps of a PDE, for comparison."""

from __future__ import annotations

import numpy.typing as npt

from ..base.checks import (
    by_keyword,
    checked_count,
    checked_image,
    checked_number,
    checked_word,
    is_dask,
    refuse_with_dask,
)
from ..base.progress import ProgressCallback, reporting
from ..errors import InvalidSettings
from ..settings import MOST_STEPS
from .pde import DETECTORS, LARGEST, evolved


@by_keyword
def osher_rudin_image(
    image: npt.ArrayLike,
    *,
    steps: int,
    time_step: float = 0.4,
    edge_detector: str = "gradient",
    progress: ProgressCallback | None = None,
) -> npt.NDArray:
    """Sharpen an image by explicit steps of the PDE I_t = -|grad I| F(L(I)).

    The scheme is upwind (Osher and Rudin 1990): one-sided differences are chosen by the direction
    of the flow and limited by minmod, so that no new extrema arise. Channels are independent.

    Parameters
    ----------
    image : (h, w) or (h, w, c) array of float32 or float64
        Values in [0, 1]. May be a dask array, but not for "flow".
    steps : int
        Number of steps; 0 returns the input.
    time_step : float
        Length of a step, above 0. With F = sign, steps are stable up to 0.5. For "flow", times are
        those of :func:`sharpen_image`, and a step longer than 0.5 / max|L| is divided into stable
        parts.
    edge_detector : {"gradient", "laplacian", "flow"}
        L is the second derivative along the gradient, or the Laplacian, with F = sign; or
        "flow": L = (grad I)^T H (grad I) / |grad I| with F the identity, the PDE that the
        advection solves (equation 2).
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    array like `image`

    Raises
    ------
    InvalidSignal
        If the image is not of floats, is smaller than 2 x 2, or holds NaN, infinity or huge
        values.
    InvalidSettings
        If steps, time_step or edge_detector are out of range, or a step needs 10,000 parts.
    Cancelled
        If `progress` returned False.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter import core
    >>> step = 1 / (1 + np.exp(-np.linspace(-4, 4, 16)))
    >>> sharp = core.osher_rudin_image(np.tile(step, (4, 1)), steps=50)
    >>> bool(np.diff(sharp).max() > 2 * np.diff(step).max())
    True
    """
    checked_word(edge_detector, "edge_detector", DETECTORS)
    count = checked_count(steps, "steps", most=MOST_STEPS)
    longest = LARGEST if edge_detector == "flow" else 0.5
    length = checked_number(time_step, "time_step", longest)
    if is_dask(image):
        from .chunked import evolve_chunks

        refuse_with_dask(progress=progress)
        if edge_detector == "flow":
            raise InvalidSettings(
                "edge_detector is 'flow', whose steps are as long as the fastest pixel of the whole"
                " image allows, which no chunk of a dask array knows; choose 'gradient' or"
                " 'laplacian'."
            )
        return evolve_chunks(image, count, length, DETECTORS[edge_detector])
    with reporting(progress):
        return evolved(checked_image(image), count, length, DETECTORS[edge_detector])
