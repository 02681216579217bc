# SPDX-License-Identifier: GPL-3.0-or-later
"""New colors beside the old ones: what changed, in numbers and words. Needs no bpy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Colors = npt.NDArray[np.float32]

_HARDLY_SEEN = 0.01


@dataclass(frozen=True)
class Recolored:
    """New colors, how many of them changed, and the largest change of a channel."""

    colors: Colors
    changed: int
    largest_change: float


def recolored(old: Colors, new: Colors, levels: int) -> Recolored:
    """Round new colors to what can be stored, and compare them with the old ones.

    Parameters
    ----------
    old, new : (..., channels) float32
    levels : int
        255 for bytes, 0 for floats.

    Returns
    -------
    Recolored
        Colors that do not change are the old ones bit for bit.
    """
    same = new == old
    if levels:  # Blender's fractions of bytes may differ from ours in the last bit
        steps = _steps(new, levels)
        same = steps == _steps(old, levels)
        new = steps / np.float32(levels)
    colors = np.where(same, old, new)  # 0.0 and -0.0 are the same, but not bit for bit
    return Recolored(
        colors=colors,
        changed=int(np.count_nonzero(~same.all(axis=-1))),
        largest_change=float(np.abs(colors - old).max()),
    )


def _steps(colors: Colors, levels: int) -> Colors:
    steps = colors * np.float32(levels)
    np.rint(steps, out=steps)
    return np.clip(steps, 0, levels, out=steps)


def describe(
    results: Sequence[Recolored],
    things: str,
    advice: str = "for wide edges raise Time or Smoothing Passes",
) -> str:
    """Say how many things changed and how much, and what to do if it was little."""
    total = sum(result.colors[..., 0].size for result in results)
    changed = sum(result.changed for result in results)
    largest = max(result.largest_change for result in results)
    text = f"{total:,} {things}, changed {changed:,}, largest change {largest:.2g}"
    if largest < _HARDLY_SEEN:
        text += f" ({advice})"
    return text
