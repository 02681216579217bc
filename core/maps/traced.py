# SPDX-License-Identifier: GPL-3.0-or-later
"""The common steps of ray-traced maps: find texels, trace, smooth the noise, fill the gutter."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..base.checks import checked_size
from ..base.progress import phase
from ..mesh.triangle_mesh import TriangleMesh, check_mesh
from .drawing import atlas_for, with_gutter
from .ray_noise import without_noise
from .tracing import Sites, texel_sites

_Single = npt.NDArray[np.float32]

_TRACING = "Tracing rays"


class _Smoothed(Protocol):
    @property
    def smoothing(self) -> float: ...
    @property
    def gutter(self) -> int: ...


def traced_image(
    mesh: TriangleMesh,
    uv: npt.ArrayLike,
    size: tuple[int, int],
    settings: _Smoothed,
    atlas: TextureAtlas | None,
    trace: Callable[[Sites], _Single],
    finish: Callable[[_Single, Sites], _Single] | None = None,
) -> tuple[_Single, TextureAtlas]:
    """Trace rays at the texels of a mesh, and return the image and its atlas.

    Parameters
    ----------
    mesh, uv, atlas
        As in `sharpen_texture`.
    size : (int, int)
    settings
        With the fields `smoothing` and `gutter`.
    trace : callable
        ``trace(sites)`` returns (k, 2 c) float32: both halves of the rays, one after the other.
    finish : callable, optional
        ``finish(values, sites)`` turns the c smoothed values of each place into others.

    Returns
    -------
    image : (h, w, c) float32
    atlas : TextureAtlas
    """
    check_mesh(mesh)
    shape = checked_size(size)
    with phase(0.0, 0.15, "Finding texels"):
        found = atlas_for(atlas, mesh, uv, shape)
    with phase(0.15, 0.2, _TRACING):
        sites = texel_sites(found)
    with phase(0.2, 0.8, _TRACING):
        halves = trace(sites)
    with phase(0.8, 0.95, "Smoothing"):
        values = without_noise(sites, halves, settings.smoothing)
        sheet = on_sheet(found, sites, values if finish is None else finish(values, sites))
    with phase(0.95, 1.0, "Filling the gutter"):
        return with_gutter(found, sheet, settings.gutter), found


def on_sheet(atlas: TextureAtlas, sites: Sites, values: _Single) -> _Single:
    """Lay values of `texel_sites` (k, c) onto the sheet: (rows, columns, c)."""
    sheet = np.zeros((atlas.sheet.nodes.size, values.shape[1]), dtype=np.float32)
    sheet[sites.numbers] = values
    return sheet.reshape(*atlas.sheet.nodes.shape, -1)
