# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames that repeat without a jump: the last ones turn into those before the first."""

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
    """Yield frames of a loop: the first one continues the last.

    Frame t of the last `fade` ones is mixed with frame t - frames, which comes before the first,
    so that it is that frame alone where the first frame follows. Nothing is stored for it: frames
    are a function of their number, and are computed once more.

    Parameters
    ----------
    begin : callable
        ``begin(number)`` yields the frames from that number on, which may be negative.
    frames, fade : int
    mix : callable
        ``mix(old, new, share)`` returns the frame that has so much of the new one.
    """
    with closing(begin(0)) as following:
        for _ in range(frames - fade):
            yield next(following)
        if fade == 0:
            return
        with closing(begin(-fade)) as leading:
            for number in range(1, fade + 1):
                yield mix(next(following), next(leading), number / (fade + 1))
