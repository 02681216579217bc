# SPDX-License-Identifier: GPL-3.0-or-later
"""Noise of ray tracing, smoothed along the surface as far as what was traced allows."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..atlas.ghosts import fill_ghosts
from ..base.progress import phase
from ..elements.matrices import TextureSpace
from ..elements.multigrid import SheetSolver
from ..elements.surface_values import corner_values, surface_values

_Single = npt.NDArray[np.float32]

_STEPS = 4
"""Lengths of smoothing, each half of the one before."""

_TOLERANCE = 1e-2

_AROUND = 3.0
"""Texels over which errors are compared."""

_SHARPNESS = 12.0
"""How clearly a length must be better to be chosen alone."""


def without_noise(
    atlas: TextureAtlas, halves: _Single, length: float
) -> tuple[TextureSpace, _Single]:
    """Smooth two independent estimates of a map on the sheet, and return their mean.

    Each half is diffused over `length` texels, a half, a quarter and so on of that. How far a
    result is from the other half, on average around a place, tells its error there up to the noise
    of the other half, which is the same for all lengths (Rousselle et al. 2012, "Adaptive rendering
    with non-local means filtering", choose bandwidths so). Lengths are mixed by weights that fall
    with that error.

    Parameters
    ----------
    atlas : TextureAtlas
    halves : (rows, columns, 2 c) float32
        Both estimates of c channels, one after the other. Ghosts are overwritten.
    length : float
        In texels.

    Returns
    -------
    TextureSpace
    (n, c) float32
        Values of that space.
    """
    with phase(0.0, 0.2, "Smoothing"):
        space = TextureSpace(atlas)
        known = fill_ghosts(atlas.sheet, atlas.sources, halves)
        raw = surface_values(space, halves, corner_values(space, halves, known))
    count = raw.shape[1] // 2
    swapped = np.concatenate([raw[:, count:], raw[:, :count]], axis=1)
    around = _Smoother(space, _AROUND)
    tried, errors = [raw], []
    for step in range(_STEPS):
        with phase(0.2 + 0.1 * step, 0.3 + 0.1 * step, "Smoothing"):
            tried.append(_Smoother(space, length * 0.5**step).smoothed(raw))
    for step, each in enumerate(tried):
        with phase(0.6 + 0.08 * step, 0.68 + 0.08 * step, "Smoothing"):
            square = ((each - swapped) ** 2).mean(axis=1, keepdims=True)
            errors.append(np.maximum(around.smoothed(square), 0.0))
    stacked = np.stack(errors)
    least = stacked.min(axis=0)
    # Relative to the noise: what the raw halves differ by.
    scale = np.maximum(stacked[0], np.float32(1e-9))
    weights = np.exp(-_SHARPNESS * (stacked - least) / scale)
    weights /= weights.sum(axis=0)
    result = np.zeros((len(raw), count), dtype=np.float32)
    for weight, each in zip(weights, tried, strict=True):
        result += weight * 0.5 * (each[:, :count] + each[:, count:])
    return space, result


class _Smoother:
    # Implicit diffusion over a length in texels.

    def __init__(self, space: TextureSpace, length: float) -> None:
        matrix = space.matrix(max(length, 1e-3) ** -2.0, lumped=True)
        self._masses = matrix.screen[:, None]
        self._solver = SheetSolver(matrix)

    def smoothed(self, values: _Single) -> _Single:
        found = values.astype(np.float32).copy()
        found[self._masses[:, 0] <= 0] = 0.0
        self._solver.solve(self._masses * values, found, _TOLERANCE, message="Smoothing")
        return found
