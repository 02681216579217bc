# SPDX-License-Identifier: GPL-3.0-or-later
"""Seamless loops of frames: the last frames are blended into those before the first."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import closing

import numpy as np
import numpy.typing as npt

Frames = Generator[npt.NDArray[np.float32], None, None]


def repeating(
    begin: Callable[[int], Frames],
    frames: int,
    fade: int,
    mix: Callable[[npt.NDArray, npt.NDArray, float], npt.NDArray[np.float32]],
) -> Frames:
    """Yield the frames of a seamless loop.

    Frame t of the last `fade` frames is blended with frame t - frames, which precedes the first
    frame; the weight of the latter grows to 1. No frames are stored: they are a function of their
    number, and are computed again.

    Parameters
    ----------
    begin : callable
        ``begin(number)`` yields the frames from that number on, which may be negative.
    frames, fade : int
    mix : callable
        ``mix(old, new, share)`` returns a blend with this share of the new frame.
    """
    with closing(begin(0)) as following:
        for _ in range(frames - fade):
            yield next(following)
        if fade == 0:
            return
        with closing(begin(-fade)) as leading:
            for number in range(1, fade + 1):
                yield mix(next(following), next(leading), number / (fade + 1))
