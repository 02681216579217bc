# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpening of textures by the width of their borders; see `dials`.

Windows reach across seams, so that both sides of one agree on contrasts and limits. Widths are
measured within charts.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..atlas.advect import advect_texels
from ..atlas.ghosts import fill_ghosts
from ..atlas.potential import texel_potential
from ..atlas.walk import shock_flow
from ..atlas.windows import smooth_as_far, texel_ranges
from ..base.findings import is_gathered
from ..base.progress import aside, phase
from ..color.dials import (
    Plan,
    blended,
    contrast,
    counted_width,
    flow_only,
    flow_times,
    limited_unsharp,
    plan_of,
    tell_widths,
)
from ..grid.borders import Borders, is_drawing, measure_borders
from ..grid.channels import Channels
from ..grid.pixels import copied
from ..settings import TextureSettings

Texels = npt.NDArray[np.float32]


def sharpen_texels_by_width(
    atlas: TextureAtlas,
    values: Texels,
    channels: Channels,
    settings: TextureSettings,
    result: Texels,
    *,
    normals: bool = False,
) -> None:
    """Sharpen some channels of nodes and ghosts into `result`, which holds a copy.

    Parameters
    ----------
    atlas : TextureAtlas
    values, result : (rows, columns, c) float32
    channels : Channels
    settings : TextureSettings
    normals : bool
        The first two channels are tangent-space directions around 1/2, which turn across seams;
        they only flow.
    """
    inside = atlas.sheet.nodes >= 0
    what, width, borders = _measured(atlas, values, channels, settings)
    if width > 0:
        plan = plan_of(what, width, borders.noise, settings.smoothing_passes)
        plan = flow_only(plan, width) if normals else plan
        _follow(atlas, plan, values, channels, settings.sampling == "nearest", normals, result)
    if settings.width == 0 and channels.start == 0 and is_gathered():
        closed = None
        if width > 0:
            with aside("Measuring borders"):
                closed = measure_borders(result, 1.0, channels, inside=inside, roughly=True).width
        tell_widths("texels", borders.width, borders.number, closed)


def follow_texels_by_width(
    atlas: TextureAtlas,
    leading: Texels,
    guides: Channels,
    values: Texels,
    channels: Channels,
    settings: TextureSettings,
    result: Texels,
    *,
    normals: bool = False,
) -> None:
    """Do to a texture what is done to another one, whose flow it follows.

    Parameters
    ----------
    atlas : TextureAtlas
    leading : (rows, columns, c) float32
        Nodes and ghosts of the texture that says how wide borders are, and how values flow.
    guides : Channels
        Those of it that guide.
    values, channels, settings, result, normals
        As in `sharpen_texels_by_width`.
    """
    what, width, borders = _measured(atlas, leading, guides, settings)
    if width == 0:
        return
    passes = settings.smoothing_passes
    plan = plan_of(what, width, borders.noise, passes)
    if normals:
        own = flow_only(plan, width, what)._replace(share=plan.share)
    else:
        with aside("Measuring borders"):
            inside = atlas.sheet.nodes >= 0
            noise = measure_borders(values, 1.0, channels, inside=inside).noise
        own = plan_of(what, width, noise, passes)
        own = plan._replace(unsharp=own.unsharp, grain=own.grain)
        if plan.unsharp_first:
            leading = _drawn_apart(atlas, plan, leading, guides)
    nearest = settings.sampling == "nearest"
    _follow(atlas, own, values, channels, nearest, normals, result, (leading, guides))


def _measured(
    atlas: TextureAtlas, values: Texels, channels: Channels, settings: TextureSettings
) -> tuple[str, float, Borders]:
    inside = atlas.sheet.nodes >= 0
    with aside("Measuring borders"):
        borders = measure_borders(values, 1.0, channels, inside=inside)
        what = settings.what
        if what == "auto":
            drawing = is_drawing(values, 1.0, channels, borders, inside)
            what = "drawing" if drawing else "photo"
    return what, counted_width(settings.width, borders.width, what), borders


def _follow(
    atlas: TextureAtlas,
    plan: Plan,
    values: Texels,
    channels: Channels,
    nearest: bool,
    normals: bool,
    result: Texels,
    guide: tuple[Texels, Channels] | None = None,
) -> None:
    # A guide says how values flow, which holds no normals; else they do so themselves.
    chosen = slice(channels.start, channels.stop)
    sharp = values
    if plan.unsharp > 0:
        with phase(0.0, 0.3, "Sharpening"):
            sharp = _drawn_apart(atlas, plan, values, channels)
    source = sharp if plan.unsharp_first else values
    if plan.square > 0:
        turned = normals and guide is None
        leading, guides = guide or (source, channels)
        with phase(0.3, 0.6, "Computing the flow"):
            times = _times(atlas, plan, leading, guides)
        with phase(0.6, 0.7, "Computing the flow"):
            potential = texel_potential(atlas, leading, guides, plan.passes, normals=turned)
        with phase(0.7, 1.0, "Tracing flow-lines"):
            flow = shock_flow(atlas, potential)
            advect_texels(atlas, source, channels, flow, times, result, nearest=nearest,
                          normals=normals)  # fmt: skip
    if plan.share < 1:
        result[..., chosen] = blended(plan, sharp[..., chosen], result[..., chosen])


def _drawn_apart(atlas: TextureAtlas, plan: Plan, values: Texels, channels: Channels) -> Texels:
    sharp = copied(values)
    sharp[..., channels.start : channels.stop] = _unsharp(atlas, plan, values, channels)
    fill_ghosts(atlas.sheet, atlas.sources, sharp, channels.alpha)
    return sharp


def _unsharp(atlas: TextureAtlas, plan: Plan, values: Texels, channels: Channels) -> Texels:
    own = np.ascontiguousarray(values[..., channels.start : channels.stop])
    reach = int(np.ceil(plan.limit))
    if channels.alpha < 0:
        with phase(0.0, 0.5, "Sharpening"):
            smooth = smooth_as_far(atlas, own.copy(), plan.blur)
        with phase(0.5, 1.0, "Sharpening"):
            low, high = texel_ranges(atlas, own, reach)
        return limited_unsharp(plan, own, smooth, low, high)
    opacity = values[..., channels.alpha, None]
    both = np.concatenate([own * opacity, opacity], axis=2)
    with phase(0.0, 0.5, "Sharpening"):
        both = smooth_as_far(atlas, both, plan.blur)
    smooth, spread = both[..., :-1], both[..., -1:]
    np.divide(smooth, spread, out=smooth, where=spread > 0)
    clear = opacity == 0
    with phase(0.5, 1.0, "Sharpening"):
        low, _ = texel_ranges(atlas, np.where(clear, own.max(), own), reach)
        _, high = texel_ranges(atlas, np.where(clear, own.min(), own), reach)
    return np.where(clear, own, limited_unsharp(plan, own, smooth, low, high))


def _times(atlas: TextureAtlas, plan: Plan, values: Texels, channels: Channels) -> Texels:
    guides = values[..., channels.start : channels.stop]
    if channels.brightness.size:
        guides = guides[..., : channels.brightness.size] @ channels.brightness[:, None]
    guides = np.array(guides, dtype=np.float32, order="C")
    if channels.alpha >= 0:
        guides *= values[..., channels.alpha, None]
    with phase(0.0, 0.2, "Computing the flow"):
        guides = smooth_as_far(atlas, guides, plan.presmooth)
    with phase(0.2, 0.6, "Computing the flow"):
        low, high = texel_ranges(atlas, guides, round(plan.reach))
    with phase(0.6, 1.0, "Computing the flow"):
        around = np.ascontiguousarray(contrast(low, high)[..., None])
        around = smooth_as_far(atlas, around, plan.reach / 2.0)
    return flow_times(plan, around[..., 0])
