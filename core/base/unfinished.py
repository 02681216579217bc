# SPDX-License-Identifier: GPL-3.0-or-later
"""Walks that are cut off, so that none runs forever: counted, and logged."""

from __future__ import annotations

import logging

import numpy as np
import numpy.typing as npt

MOST_STEPS = 1_000_000
"""Most cells that a walk crosses; passed to kernels, as compiled code does not read it here."""


def warn_of_unfinished(counts: npt.NDArray) -> None:
    """Log how many walks were cut off, if any.

    Parameters
    ----------
    counts : (any,) array of int or bool
        Counts, or flags of walks; threads that run at the same time count apart.
    """
    count = np.count_nonzero(counts) if counts.dtype == np.bool_ else int(counts.sum())
    if count:
        logging.getLogger(__name__).warning(
            "%d walks along flow-lines were cut off, as they did not end; this is a bug.", count
        )
