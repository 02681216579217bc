# SPDX-License-Identifier: GPL-3.0-or-later
"""Gains painted as gray values."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

_HALF = 0.5 / 255.0
"""Largest distance from 0.5 of middle gray; bytes have 127 and 128 there."""

_ROUNDING = 1e-6


def gains_of(grays: npt.ArrayLike, gain: float) -> npt.NDArray[np.float32]:
    """Convert grays to gains: black smooths, middle gray keeps, white gives the gain.

    Parameters
    ----------
    grays : array of float
        As stored, not decoded: 0 is a gain of 0, 0.5 a gain of 1, 1 is `gain`, linear in between.
        Values are clipped to [0, 1].
    gain : float
        The gain of white.

    Returns
    -------
    array of float32
        Exactly 1 for middle gray.

    Examples
    --------
    >>> gains_of([0.0, 127 / 255, 128 / 255, 1.0], 3.0).tolist()
    [0.0, 1.0, 1.0, 3.0]
    """
    signed = np.clip(np.asarray(grays, dtype=np.float32), 0.0, 1.0)
    signed -= np.float32(0.5)
    gains = np.abs(signed)
    gains -= np.float32(_HALF)
    gains /= np.float32(0.5 - _HALF)
    gains[gains < _ROUNDING] = 0.0
    gains *= np.where(signed < 0, np.float32(-1.0), np.float32(gain - 1.0))
    gains += np.float32(1.0)
    return gains
