# SPDX-License-Identifier: GPL-3.0-or-later
"""New colors with statistics of the changes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..base.progress import aside, ask

Colors = npt.NDArray[np.float32]

_BAND = 1 << 20
"""Number of values compared at once, which fit into the processor's caches."""


@dataclass(frozen=True)
class Recolored:
    """New colors, how many of those that count changed, and the largest change of a channel."""

    colors: Colors
    changed: int
    largest_change: float
    counted: int


def recolored(
    old: Colors, new: Colors, levels: int, shown: npt.NDArray[np.bool_] | None = None
) -> Recolored:
    """Round new colors to the stored type, and compare them with the old ones.

    Parameters
    ----------
    old, new : (..., channels) float32
    levels : int
        255 for bytes, 0 for floats.
    shown : (...,) bool, optional
        The colors to count. Default: all. The gutter of a texture is not visible.

    Returns
    -------
    Recolored
        Colors that do not change are the old ones bit for bit.
    """
    colors = np.empty_like(old)
    changed, largest = 0, 0.0
    band = max(_BAND * len(old) // old.size, 1)
    with aside("Comparing colors"):
        for start in range(0, len(old), band):
            ask()
            rows = slice(start, start + band)
            other = ~_choose(old[rows], new[rows], levels, colors[rows]).all(axis=-1)
            if shown is not None:
                other &= shown[rows]
            changed += int(np.count_nonzero(other))
            apart = np.abs(colors[rows] - old[rows]).max(axis=-1)
            largest = max(largest, float(apart.max(initial=0.0, where=other)))
    counted = old[..., 0].size if shown is None else int(np.count_nonzero(shown))
    return Recolored(colors, changed, largest, counted)


def _choose(old: Colors, new: Colors, levels: int, colors: Colors) -> npt.NDArray[np.bool_]:
    """Write rounded new colors, or the old ones where both are stored alike."""
    same = new == old
    if levels:  # Blender's fractions of bytes may differ from ours in the last bit
        steps = _steps(new, levels)
        same = steps == _steps(old, levels)
        new = steps / np.float32(levels)
    colors[...] = np.where(same, old, new)  # 0.0 and -0.0 are the same, but not bit for bit
    return same


def _steps(colors: Colors, levels: int) -> Colors:
    steps = colors * np.float32(levels)
    np.rint(steps, out=steps)
    return np.clip(steps, 0, levels, out=steps)
