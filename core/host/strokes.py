# SPDX-License-Identifier: GPL-3.0-or-later
"""The flow in colors and strokes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Values = npt.NDArray[np.float32]

MOST_STROKES = 20_000

_SPACING = 1.0 / 60.0
"""Least distance between strokes, in parts of the object's size: shorter ones are not seen."""

_STRONG = 0.98
"""The part of the vertices, or faces, with any flow beyond which all look alike."""

_STOPS = np.array(
    [
        [0.02, 0.10, 0.36],
        [0.24, 0.27, 0.50],
        [0.45, 0.45, 0.47],
        [0.72, 0.66, 0.36],
        [1.00, 0.91, 0.25],
    ]
)
"""From dark blue to yellow: lightness rises evenly, and all can tell these apart."""

_FAINT, _DENSE = 0.35, 0.85
"""Opacity of a weak and a strong potential."""


def potential_colors(potential: Values) -> Values:
    """Choose each vertex's color and opacity by the root of the potential: (n,) -> (n, 4)."""
    strength = np.sqrt(np.maximum(potential, 0.0))
    return ramp(np.minimum(strength / _strong(strength), 1.0))


def ramp(shares: npt.NDArray) -> Values:
    """Colors and opacities from weak (0) to strong (1): (n,) -> (n, 4)."""
    stops = np.linspace(0.0, 1.0, len(_STOPS))
    channels = [np.interp(shares, stops, channel) for channel in _STOPS.T]
    return np.stack([*channels, _FAINT + (_DENSE - _FAINT) * shares], axis=1).astype(np.float32)


def bar(x: float, y: float, width: float, height: float) -> tuple[Values, Values]:
    """Make a legend of `ramp`: the corners (k, 2) and colors (k, 4) of a strip of triangles."""
    shares = np.repeat(np.linspace(0.0, 1.0, 9), 2)
    colors = ramp(shares)
    colors[:, 3] = 1.0
    corners = np.stack([x + width * shares, np.full(len(shares), y)], axis=1)
    corners[1::2, 1] += height
    return corners.astype(np.float32), colors


def strokes(centers: Values, normals: Values, areas: Values, flow: Values) -> tuple[Values, Values]:
    """Make a slim triangle for each face with a flow, at most `MOST_STROKES` in all.

    Its tip shows where values are pulled to; its tail fades away.

    Parameters
    ----------
    centers, normals, areas, flow : (m, 3), (m, 3), (m,), (m, 3) array of float
        Of the faces.

    Returns
    -------
    corners : (3 k, 3) float32
        Tip and both ends of the tail of each triangle.
    colors : (3 k, 4) float32
    """
    speed = np.linalg.norm(flow, axis=1)
    strong = _strong(speed)
    chosen = np.flatnonzero(speed > 0.01 * strong)
    covered = float(areas[chosen].sum())
    least = _SPACING * float(np.ptp(centers, axis=0).max())
    count = min(MOST_STROKES, round(covered / least**2) + 1) if least > 0 else MOST_STROKES
    if len(chosen) > count:
        picked = np.random.default_rng(0).permutation(len(chosen))[:count]
        chosen = chosen[np.sort(picked)]
    along = flow[chosen] / speed[chosen, None]
    spacing = np.sqrt(covered / max(len(chosen), 1))
    share = np.cbrt(np.minimum(speed[chosen] / strong, 1.0))
    half = (0.45 * spacing * (0.4 + 0.6 * share))[:, None] * along
    side = 0.25 * np.cross(normals[chosen], half)
    middle = centers[chosen]
    corners = np.stack([middle + half, middle - half + side, middle - half - side], axis=1)
    colors = np.ones((len(chosen), 3, 4), dtype=np.float32)
    colors[:, 1:, 3] = 0.1
    return corners.reshape(-1, 3).astype(np.float32), colors.reshape(-1, 4)


def _strong(values: npt.NDArray) -> float:
    some = values[values > 0]
    return float(np.quantile(some, _STRONG)) if len(some) else 1.0
