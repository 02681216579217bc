# SPDX-License-Identifier: GPL-3.0-or-later
"""Noise advection exactly as in paper D, in plain numpy, for comparison.

Coordinates have a random place in each cell (4.2). Their fractions are carried on in the cell
(4.8), or are what they were at first in each frame. All sides are joined.
"""

from __future__ import annotations

import numpy as np


class LiteralNoise:
    """Cells of any values that move with a steady flow.

    Parameters
    ----------
    cells : (h, w) array
    right, down : (h, w) array of float
        Steps in cells.
    carries : bool
        Whether fractions are carried on.
    injection : float
        Share of the cells whose value, 0 or 1, is inverted in each frame.
    """

    def __init__(
        self,
        cells: np.ndarray,
        right: np.ndarray,
        down: np.ndarray,
        carries: bool = True,
        injection: float = 0.0,
    ) -> None:
        self.cells, self._step = cells.copy(), np.stack([down, right])
        self._random = np.random.default_rng(0)
        self._first = self._random.random((2, *cells.shape))
        self._places, self._carries, self._injection = self._first, carries, injection
        self._grid = np.indices(cells.shape)

    def step(self) -> np.ndarray:
        """Go on by a frame; return the linear copy, which is shown."""
        rows, columns = self.cells.shape
        at = self._places - self._step
        whole = np.floor(at)
        fraction = at - whole
        y, x = (self._grid + whole).astype(int)
        y, x, below, after = y % rows, x % columns, (y + 1) % rows, (x + 1) % columns
        old, (t, s) = self.cells, fraction
        upper = (1 - s) * old[y, x] + s * old[y, after]
        shown = (1 - t) * upper + t * ((1 - s) * old[below, x] + s * old[below, after])
        self.cells = old[y, x]
        if self._injection:
            self.cells = self.cells ^ (self._random.random(old.shape) < self._injection)
        self._places = fraction if self._carries else self._first
        return shown
