# SPDX-License-Identifier: GPL-3.0-or-later
"""How long a filter will take and how much memory, from measured rates: good to a factor of two.

The rates are seconds of one core per million vertices, pixels or texels; ``benchmarks/rates.py``
measures them again. This module imports neither numpy nor numba.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from .settings import (
    BeltramiGeometrySettings,
    BeltramiMeshSettings,
    BeltramiSettings,
    GeometrySettings,
    ImageSettings,
    ShockSettings,
    TextureSettings,
)

_MILLION = 1e6
_MOST_CORES = 8  # more hardly help: some work is done by one


class Estimate(NamedTuple):
    """What a run is expected to take.

    Attributes
    ----------
    seconds : float
        Of one core; see `wall_seconds`.
    memory : float
        Bytes beside the input.
    """

    seconds: float
    memory: float


def estimate(settings: Any, size: int) -> Estimate:
    """Estimate what one run of a filter takes.

    Parameters
    ----------
    settings : GeometrySettings, ShockSettings, ImageSettings, TextureSettings, \
BeltramiGeometrySettings, BeltramiMeshSettings or BeltramiSettings
    size : int
        Number of vertices, pixels or texels.

    Returns
    -------
    Estimate
    """
    seconds, memory = _RATES[type(settings)]
    return Estimate(seconds(settings) * size / _MILLION, memory * size)


def wall_seconds(seconds: float, cores: int) -> float:
    """Turn seconds of one core into seconds on the clock."""
    return seconds / min(max(cores, 1), _MOST_CORES)


def _geometry(settings: GeometrySettings) -> float:
    if settings.time == 0.0:
        return 0.1
    passes = settings.smoothing_passes + settings.mollify_passes
    trace = 1.0 if math.isinf(settings.time) else 0.3
    return settings.repeat * (2.4 + 0.1 * passes + trace)


def _colors(settings: ShockSettings) -> float:
    return 0.9 + _traces(settings, finite=0.4, infinite=4.0, step=0.4)


def _image(settings: ImageSettings) -> float:
    return 0.02 + _traces(settings, finite=0.2, infinite=0.4, step=0.19)


def _texture(settings: TextureSettings) -> float:
    trace = 1.2 if math.isinf(settings.time) else 0.2
    return 0.4 + 0.05 * settings.smoothing_passes + trace


def _traces(settings: ShockSettings, finite: float, infinite: float, step: float) -> float:
    if settings.time == 0.0:
        return 0.0
    if settings.scheme != "fixed":
        return step * settings.time
    trace = infinite if math.isinf(settings.time) else finite
    return trace + 0.05 * settings.smoothing_passes


def _kernel(settings: Any, base: float, rate: float) -> float:
    """Cover an area in proportion to the time, and to the logarithm of the threshold."""
    reach = math.log(settings.threshold) / math.log(0.01)
    return settings.iterations * (base + rate * settings.time * reach)


def _denoise_geometry(settings: BeltramiGeometrySettings) -> float:
    return settings.repeat * _kernel(settings, 2.0, 8.5)


def _denoise_colors(settings: BeltramiMeshSettings) -> float:
    return _kernel(settings, 1.0, 6.0 if settings.distance == "euclidean" else 14.0)


def _denoise_image(settings: BeltramiSettings) -> float:
    return _kernel(settings, 0.5, 1.0 if settings.distance == "euclidean" else 3.5)


_RATES: dict[type, tuple[Callable[[Any], float], float]] = {
    GeometrySettings: (_geometry, 490.0),
    ShockSettings: (_colors, 590.0),
    ImageSettings: (_image, 80.0),
    TextureSettings: (_texture, 170.0),
    BeltramiGeometrySettings: (_denoise_geometry, 990.0),
    BeltramiMeshSettings: (_denoise_colors, 1200.0),
    BeltramiSettings: (_denoise_image, 140.0),
}
"""Seconds of one core per million, and bytes per vertex, pixel or texel."""
