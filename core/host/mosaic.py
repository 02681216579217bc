# SPDX-License-Identifier: GPL-3.0-or-later
"""Several UDIM tiles as one image, so that they are filtered together."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

_FIRST, _PER_ROW = 1001, 10
_TOLERANCE = 1e-3  # of a tile


@dataclass(frozen=True)
class Mosaic:
    """The layout of UDIM tiles in one image.

    Attributes
    ----------
    places : dict
        By number of the tile: row and column of its first texel, its height and width.
    height, width : int
        Size of the whole.
    margin : int
        Width of the margin around each tile, which repeats the texels on its rim.
    """

    places: dict[int, tuple[int, int, int, int]]
    height: int
    width: int
    margin: int

    @classmethod
    def of(cls, sizes: dict[int, tuple[int, int]], margin: int) -> Mosaic:
        """Lay out tiles of these heights and widths, roughly in a square."""
        columns = math.ceil(math.sqrt(len(sizes)))
        height = max(h for h, _ in sizes.values()) + 2 * margin
        width = max(w for _, w in sizes.values()) + 2 * margin
        places = {
            number: (
                height * (k // columns) + margin,
                width * (k % columns) + margin,
                *sizes[number],
            )
            for k, number in enumerate(sorted(sizes))
        }
        return cls(places, height * math.ceil(len(sizes) / columns), width * columns, margin)

    def compose(self, tiles: dict[int, npt.NDArray]) -> npt.NDArray:
        """Copy the pixels of the tiles into one image."""
        channels = next(iter(tiles.values())).shape[2:]
        whole = np.zeros((self.height, self.width, *channels), dtype=np.float32)
        around = ((self.margin, self.margin), (self.margin, self.margin), (0, 0))
        for number, (row, column, height, width) in self.places.items():
            rows = slice(row - self.margin, row + height + self.margin)
            columns = slice(column - self.margin, column + width + self.margin)
            whole[rows, columns] = np.pad(tiles[number], around, mode="edge")
        return whole

    def cut(self, whole: npt.NDArray) -> dict[int, npt.NDArray]:
        """Copy the pixels of the tiles out of one image."""
        return {
            number: whole[row : row + height, column : column + width]
            for number, (row, column, height, width) in self.places.items()
        }

    def enlarged(self, times: int) -> Mosaic:
        """Return the layout of tiles that are higher and wider by a factor."""
        places = {
            number: (times * row, times * column, times * height, times * width)
            for number, (row, column, height, width) in self.places.items()
        }
        return Mosaic(places, times * self.height, times * self.width, times * self.margin)

    def place(self, uv: npt.NDArray[np.float64]) -> tuple[npt.NDArray, npt.NDArray[np.bool_]]:
        """Convert texture coordinates in tiles to those in the whole image.

        Parameters
        ----------
        uv : (m, 3, 2) float64

        Returns
        -------
        uv : (m, 3, 2) float64
        inside : (m,) bool
            False for triangles that are not within one tile.
        """
        corner = np.floor(uv.mean(axis=1))
        in_range = (corner >= 0).all(axis=1) & (corner[:, 0] < _PER_ROW)
        number = np.where(in_range, _FIRST + corner[:, 0] + _PER_ROW * corner[:, 1], 0)
        local = uv - corner[:, None]
        inside = ((local > -_TOLERANCE) & (local < 1 + _TOLERANCE)).all(axis=(1, 2))
        known = np.zeros(len(uv), dtype=bool)
        placed = np.zeros_like(uv)
        for tile, (row, column, height, width) in self.places.items():
            here = number == tile
            known |= here
            placed[here, :, 0] = (column + width * local[here, :, 0]) / self.width
            placed[here, :, 1] = (row + height * local[here, :, 1]) / self.height
        return placed, inside & known
