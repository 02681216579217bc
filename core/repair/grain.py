# SPDX-License-Identifier: GPL-3.0-or-later
"""Grain for filled texels: noise whose bands are as strong as those of the texture around them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.progress import phase
from ..texture.texel_planes import Surface
from ..texture.texels import Texture

Singles = npt.NDArray[np.float32]

_VARIANCES = 0.5, 2.0, 8.0
"""Variances, in squared texels, of the smoothings whose differences are the bands."""

_FLOOR = np.float32((0.05 / 255) ** 2)
"""Energy that counts as none, for white = 1."""

_OF_LOGARITHMS = np.float32(np.log(0.2807))
"""Mean of the logarithm of a squared standard normal variable. Means of logarithms measure the
grain that is everywhere; means of squares would measure the few borders."""

_WIDER, _ANYWHERE = 1e-2, 1e-5
"""Weights of the means over about 32 texels, and over all, relative to that over 8."""


def grain_of(texture: Texture, values: Singles, missing: npt.NDArray[np.bool_]) -> Singles:
    """Make a field of grain like that of the known texels.

    It consists of three bands of white noise, each as strong as that of the texture within about 8
    texels; deep in a hole, as in wider surroundings. Strengths are measured separately for
    brightness and colors. Not in the papers.

    Parameters
    ----------
    texture : Texture
    values : (rows, columns, c) float32
        Values of the nodes inside charts.
    missing : (rows, columns) bool
        Nodes without a known value.

    Returns
    -------
    (rows, columns, c) float32
        With a mean of about 0; 0 outside charts, and for opacity.
    """
    surface = Surface(texture.atlas)
    channels = [c for c in range(values.shape[2]) if c != texture.alpha]
    basis = _axes(len(channels))
    rng = np.random.default_rng(0)
    known = (surface.inside & ~missing).astype(np.float32)
    given = np.ascontiguousarray(np.moveaxis(values[..., channels] @ basis, 2, 0))
    white = rng.standard_normal(given.shape, dtype=np.float32) * surface.inside
    sums = surface.complete(np.concatenate([given * known, known[None]]))
    noise, found = surface.complete(white), np.zeros_like(white)
    variance = 0.0
    for number, wider in enumerate(_VARIANCES):
        with phase(number / len(_VARIANCES), (number + 1) / len(_VARIANCES), "Filling"):
            sums = surface.smooth(sums, wider - variance)
            smooth = sums[:-1] / np.maximum(sums[-1], np.float32(1e-6))
            smooth_noise = surface.smooth(noise, wider - variance)
            energies = _energies(surface, given - smooth, known)
            band = (noise - smooth_noise) * surface.inside
            own = max(float(np.mean(band**2, where=surface.inside)), 1e-12)  # 0 for single texels
            found += np.sqrt(energies / np.float32(own)) * band
        given, noise, variance = smooth, smooth_noise, wider
    out = np.zeros_like(values)
    out[..., channels] = np.moveaxis(found, 0, 2) @ basis.T
    return out


def _axes(count: int) -> Singles:
    # Brightness and differences of colors, as orthonormal columns.
    columns = np.eye(count)
    columns[:, 0] = 1.0
    return np.linalg.qr(columns)[0].astype(np.float32)


def _energies(surface: Surface, band: Singles, known: Singles) -> Singles:
    # The energy of a band around each node: (c, rows, columns).
    logarithms = np.log(np.maximum(band**2, _FLOOR)) * known
    means = surface.means.means(np.concatenate([logarithms, known[None]]))
    anywhere = means.mean(axis=2, keepdims=True, dtype=np.float64)
    sums = (
        surface.means.smoothed(means)
        + np.float32(_WIDER) * surface.means.of_region(means)
        + np.float32(_ANYWHERE) * anywhere.astype(np.float32)
    )
    each = sums[:-1] / np.maximum(sums[-1], np.float32(1e-30))
    nodes = surface.means.rows(np.ascontiguousarray(each), 0, len(surface.inside))
    energies: Singles = np.exp(nodes - _OF_LOGARITHMS)
    return energies * (energies > 4 * _FLOOR / np.exp(_OF_LOGARITHMS))
