# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether Blender's data still is as it was read."""

from __future__ import annotations

import numpy.typing as npt

from .skipped import Skipped


def check_same(
    now: npt.NDArray,
    then: npt.NDArray,
    reason: str = "it was changed meanwhile; run again",
) -> None:
    """Compare two arrays bit for bit, as NaN differs from itself.

    Raises
    ------
    Skipped
        With the reason, if they differ.
    """
    from ...core.base.memo import equal

    if not equal((now,), (then,)):
        raise Skipped(reason)
