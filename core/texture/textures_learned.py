# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpening of textures by the learned recipe for images; see `core.color.learned`.

The networks are those for images. Only the neighbours of texels differ: see `texel_planes`.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.findings import is_gathered
from ..base.progress import aside, ask, phase
from ..color.learned.first import SIGMAS
from ..color.learned.images import detail_of, ends_of, span_of, typical_detail
from ..color.learned.recipe import FAINT, Wishes, sharpened
from ..color.learned.report import tell_learned
from ..color.learned.surroundings import WIDEST
from ..grid.borders import Borders, measure_borders
from ..grid.channels import Channels
from ..settings import WIDTH_OF_SIGMA, TextureSettings
from .texel_planes import Surface, TexelPlanes

Texels = npt.NDArray[np.float32]

_ROUNDING = 16 * float(np.finfo(np.float32).eps)
"""Relative differences up to this are rounding of the interpolation across seams."""

_SQUARE = 128
"""Side, in texels, of the squares in which detail is measured."""


def are_learned(settings: TextureSettings, normals: bool) -> bool:
    """Return whether texels are sharpened by the learned recipe.

    This is not done for normals, nor if a time or What is given.
    """
    return settings.by_width and settings.what == "auto" and not normals


def sharpen_texels_learned(
    surface: Surface,
    values: Texels,
    channels: Channels,
    settings: TextureSettings,
    result: Texels,
) -> None:
    """Sharpen some channels of nodes and ghosts into `result`, which holds a copy.

    Parameters
    ----------
    surface : Surface
    values, result : (rows, columns, c) float32
    channels : Channels
    settings : TextureSettings
    """
    inside = surface.inside
    told = settings.width == 0 and channels.start == 0 and is_gathered()
    borders = Borders()
    if told:
        with aside("Measuring borders"):
            borders = measure_borders(values, 1.0, channels, inside=inside)
    with phase(0.0, 0.1, "Sharpening"):
        planes = TexelPlanes.of_texels(surface, values, channels)
    with phase(0.1, 0.2, "Sharpening"):
        detail = _detail(planes)
        smooth = planes.smoothed(SIGMAS, 0, len(inside))[-1]
        span = span_of(*ends_of(smooth, _weights(planes) > 0))
    square = min(settings.width / WIDTH_OF_SIGMA, WIDEST) ** 2
    nearest = settings.sampling == "nearest"
    wishes = Wishes(FAINT * detail, square, settings.smoothing_passes, nearest, span)
    with phase(0.2, 1.0, "Sharpening"):
        sharp = sharpened(planes, channels.brightness, wishes)
    for k in range(len(sharp)):
        target, old = result[..., channels.start + k], planes.values[k]
        changed = np.abs(sharp[k] - old) > _ROUNDING * np.abs(old)
        np.copyto(target, sharp[k], where=inside & changed)
    copies = surface.atlas.copies
    flat, chosen = result.reshape(inside.size, -1), slice(channels.start, channels.stop)
    flat[copies[:, 0], chosen] = flat[copies[:, 1], chosen]
    if told:
        with aside("Sharpening"):
            after = None
            if not np.array_equal(result, values):
                after = measure_borders(result, 1.0, channels, inside=inside, roughly=True)
                sharp_planes = TexelPlanes.of_texels(surface, result, channels)
                after = after._replace(detail=_detail(sharp_planes))
        tell_learned("texels", borders._replace(detail=detail), after)


def _weights(planes: TexelPlanes) -> Texels:
    # The opacity of texels inside charts, 0 elsewhere.
    weights = np.asarray(planes.surface.inside, np.float32)
    return weights * planes.opacity if planes.opacity.size else weights


def _detail(planes: TexelPlanes) -> float:
    # The mean squared difference to a smoothing, in squares all over the sheet.
    weights = _weights(planes)
    away = np.zeros_like(weights)
    for value, smooth in zip(
        planes.values, planes.smoothed(SIGMAS, 0, len(weights))[-1], strict=True
    ):
        ask()
        away += detail_of(value, smooth)
    away /= len(planes.values)
    held, sums = (
        np.add.reduceat(np.add.reduceat(each, np.arange(0, each.shape[0], _SQUARE)),
                        np.arange(0, each.shape[1], _SQUARE), axis=1).ravel()
        for each in (weights, away * weights)
    )  # fmt: skip
    seen = held > 0
    return typical_detail(sums[seen] / held[seen], held[seen]) if seen.any() else 0.0
