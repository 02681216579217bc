# SPDX-License-Identifier: GPL-3.0-or-later
"""Fills texels without a hit on a detailed mesh from those around them on the surface."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..base.progress import aside, phase
from ..elements.matrices import TextureSpace
from ..elements.surface_values import sheet_values
from ..repair.membrane import Holes

_Single = npt.NDArray[np.float32]

_FILLING = "Filling"


class Unmet:
    """Fills maps smoothly, also across seams, where some texels have no values.

    Parameters
    ----------
    atlas : TextureAtlas
    numbers : (k,) int
        Flat indices of the nodes of the sheet without values.

    Attributes
    ----------
    is_needed : bool
        Whether there are such nodes, and others.
    """

    def __init__(self, atlas: TextureAtlas, numbers: npt.NDArray[np.integer]) -> None:
        self._atlas = atlas
        self._missing = np.zeros(atlas.sheet.nodes.shape, dtype=np.bool_)
        self._missing.reshape(-1)[numbers] = True
        inside = atlas.sheet.nodes >= 0
        self.is_needed = bool(len(numbers)) and bool((inside & ~self._missing).any())
        self._found: tuple[TextureSpace, Holes] | None = None

    def filled(self, sheet: _Single) -> _Single:
        """Return a sheet (rows, columns, c) in which the missing nodes are filled."""
        if not self.is_needed:
            return sheet
        with phase(0.0, 0.3, _FILLING):
            space, holes = self._holes()
            unknowns = np.zeros((space.size, sheet.shape[2]), dtype=np.float32)
            unknowns[: self._missing.size] = sheet.reshape(-1, sheet.shape[2])
            holes.start(unknowns, None)
        with phase(0.3, 1.0, _FILLING):
            holes.membrane(unknowns, _FILLING)
        result = sheet.copy()
        sheet_values(space, unknowns, result)
        np.copyto(result, sheet, where=~self._missing[..., None])
        return result

    def _holes(self) -> tuple[TextureSpace, Holes]:
        if self._found is None:
            with aside("Measuring texels"):
                space = TextureSpace(self._atlas)
                self._found = space, Holes(space, self._missing)
        return self._found
