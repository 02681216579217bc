# SPDX-License-Identifier: GPL-3.0-or-later
"""Contrast, opacity and background of noise (paper D, section 4.10.2)."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ..base.checks import as_array
from ..base.parallel import kernel, run
from ..errors import InvalidSignal
from ..settings import NoiseSettings
from .velocity import ROWS, Motion

_Singles = npt.NDArray[np.float32]

DEVIATION = 0.18
"""Standard deviation of the values at a contrast of 1."""

_ENTRIES = 1 << 12  # of the table of opacities


_SLOWEST = 1e-30
"""Shorter steps count as 0 in single precision."""


class Look:
    """The conversion of blended noise to a frame.

    Parameters
    ----------
    longest : float
        Longest step in pixels.
    settings : NoiseSettings
    background : (h, w) or (h, w, 3) float32 or None
    colors : (n, 3) float32 or None
    """

    def __init__(
        self,
        longest: float,
        settings: NoiseSettings,
        background: _Singles | None,
        colors: _Singles | None,
    ) -> None:
        self._longest = longest
        self._exponent = settings.speed_mask
        self._colored = colors is not None or (background is not None and background.ndim == 3)
        channels = 3 if self._colored else 1
        if background is None:
            background = np.zeros((0, 0, 1), dtype=np.float32)
        behind = background[..., None] if background.ndim == 2 else background
        self._behind = np.ascontiguousarray(np.broadcast_to(behind, (*behind.shape[:2], channels)))
        self._masked = settings.noise_mask > 0 or colors is not None
        self._colors = np.empty((0, 3), dtype=np.float32) if colors is None else colors
        # Linear reading makes a third of two values 0 and 1 vary, and blending averages these.
        deviation = math.sqrt(settings.blending / (2.0 - settings.blending)) / 3.0
        self._gain = np.float32(settings.contrast * max(DEVIATION / deviation, 1.0))
        self._opacities = _power_mask(np.linspace(0.0, 1.0, _ENTRIES), settings.noise_mask)
        self._speeds: _Singles | None = None
        self._shares: _Singles | None = None
        self._known: Motion | None = None

    def shown(self, blended: _Singles, motion: Motion) -> _Singles:
        """Return a frame: (h, w), or (h, w, 3) with colors."""
        if self._known is not motion:
            speeds = np.hypot(motion.right, motion.down)
            speeds *= np.float32(1.0 / self._longest if self._longest > _SLOWEST else 0.0)
            np.minimum(speeds, np.float32(1.0), out=speeds)
            shares = _power_mask(speeds, self._exponent)
            shares[~motion.defined] = 0.0
            if not self._masked and shares.min() == 1:
                shares = shares[:0]
            self._shares, self._speeds, self._known = shares, speeds, motion
        frame = np.empty((*blended.shape, self._behind.shape[2]), dtype=np.float32)
        run(_show, len(blended), blended, self._gain, self._opacities, self._shares, self._speeds,
            self._colors, self._behind, frame, chunk=ROWS)  # fmt: skip
        return frame if self._colored else frame[..., 0]


def checked_background(background: npt.ArrayLike | None, size: tuple[int, int]) -> _Singles | None:
    """Return the background of the noise; raises `InvalidSignal` unless it fits the frames."""
    if background is None:
        return None
    given = as_array(background, "background")
    if given.shape not in (size, (*size, 3)):
        raise InvalidSignal(
            f"The background has the shape {given.shape}; give {size} or {(*size, 3)}."
        )
    return _checked_values(given, "background")


def checked_colors(colors: npt.ArrayLike | None) -> _Singles | None:
    """Return a color map; raises `InvalidSignal` if it is not valid."""
    if colors is None:
        return None
    given = as_array(colors, "color map")
    if given.ndim != 2 or given.shape[1] != 3 or len(given) == 0:
        raise InvalidSignal(f"The color map has the shape {given.shape}; give (n, 3).")
    return _checked_values(given, "color map")


def _checked_values(given: npt.NDArray, what: str) -> _Singles:
    if given.dtype.kind != "f" or not np.isfinite(given).all():
        raise InvalidSignal(f"The {what} holds NaN, infinity or no floats; give values in [0, 1].")
    return np.clip(given, 0.0, 1.0).astype(np.float32)


def _power_mask(values: npt.NDArray, exponent: float) -> _Singles:
    """Return 1 - (1 - x)^exponent; 1 for an exponent of 0."""
    if exponent == 0:
        return np.ones(values.shape, dtype=np.float32)
    return (1.0 - (1.0 - values) ** exponent).astype(np.float32)


@kernel
def _show(start, stop, blended, gain, opacities, shares, speeds, colors, behind, frame):
    last = np.float32(len(opacities) - 1)
    half = np.float32(0.5)
    columns = blended.shape[1]
    values = np.empty(columns, dtype=np.float32)
    entries = np.empty(columns, dtype=np.uint32)
    for i in range(start, stop):
        for j in range(columns):
            value = half + gain * (blended[i, j] - half)
            values[j] = min(max(value, np.float32(0)), np.float32(1))
        if len(shares) == 0:
            for c in range(frame.shape[2]):
                for j in range(columns):
                    frame[i, j, c] = values[j]
            continue
        opaque = np.empty(columns, dtype=np.float32)
        for j in range(columns):
            entries[j] = np.uint32(np.int32(values[j] * last + half))
        for j in range(columns):
            opaque[j] = opacities[entries[j]]
        for j in range(columns):
            opaque[j] *= shares[i, j]
        if len(colors) > 0:
            _color(i, speeds, colors, opaque, frame)
        else:
            for c in range(frame.shape[2]):
                for j in range(columns):
                    frame[i, j, c] = opaque[j] * values[j]
        if behind.shape[0] > 0:
            for c in range(frame.shape[2]):
                for j in range(columns):
                    frame[i, j, c] += (np.float32(1) - opaque[j]) * behind[i, j, c]


@kernel
def _color(i, speeds, colors, opaque, frame):
    for j in range(len(opaque)):
        place = speeds[i, j] * np.float32(len(colors) - 1)
        first = int(place)
        second = min(first + 1, len(colors) - 1)
        share = place - np.float32(first)
        for c in range(3):
            color = colors[first, c] + share * (colors[second, c] - colors[first, c])
            frame[i, j, c] = opaque[j] * color
