# SPDX-License-Identifier: GPL-3.0-or-later
"""Walks that are cut off, so that none goes on for ever: counted, and told in the log."""

from __future__ import annotations

import logging

import numpy as np
import numpy.typing as npt

MOST_STEPS = 1_000_000
"""Cells that a walk may cross; handed to the kernels, as compiled code does not look it up."""


def warn_of_unfinished(counts: npt.NDArray) -> None:
    """Log how many walks were cut off, if any.

    Parameters
    ----------
    counts : (any,) array of int or bool
        Counted apart by those who run at the same time.
    """
    count = np.count_nonzero(counts) if counts.dtype == np.bool_ else int(counts.sum())
    if count:
        logging.getLogger(__name__).warning(
            "%d walks along flow-lines were cut off, as they did not end; this is a bug.", count
        )
