# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpening of textures by the width of their borders; see `core.color.by_width.recipe`.

Widths are measured within charts.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..base.findings import is_gathered
from ..base.progress import aside
from ..color.by_width.dials import flow_only, plan_of
from ..color.by_width.measuring import Measured, measured, tell_closed
from ..color.by_width.recipe import Lead, sharpen_by_width
from ..grid.borders import measure_borders
from ..grid.channels import Channels
from ..settings import TextureSettings
from .sheet_domain import SheetDomain

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
    found = _measured(atlas, values, channels, settings)
    if found.width > 0:
        plan = plan_of(found.what, found.width, found.borders.noise, settings.smoothing_passes)
        plan = flow_only(plan, found.width) if normals else plan
        domain = SheetDomain(atlas, channels, settings.sampling == "nearest", normals)
        sharpen_by_width(domain, plan, values, result)
    if settings.width == 0 and channels.start == 0 and is_gathered():
        tell_closed("texels", found, result, channels, inside=nodes_inside(atlas))


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
    """Advect a texture by the flow of another one.

    Parameters
    ----------
    atlas : TextureAtlas
    leading : (rows, columns, c) float32
        Nodes and ghosts of the guide, which defines the width of borders and the flow.
    guides : Channels
        The guiding channels of `leading`.
    values, channels, settings, result, normals
        As in `sharpen_texels_by_width`.
    """
    found = _measured(atlas, leading, guides, settings)
    what, width = found.what, found.width
    if width == 0:
        return
    passes = settings.smoothing_passes
    plan = plan_of(what, width, found.borders.noise, passes)
    if normals:
        own = flow_only(plan, width, what)._replace(share=plan.share)
    else:
        with aside("Measuring borders"):
            noise = measure_borders(values, 1.0, channels, inside=nodes_inside(atlas)).noise
        own = plan_of(what, width, noise, passes)
        own = plan._replace(unsharp=own.unsharp, grain=own.grain)
    domain = SheetDomain(atlas, channels, settings.sampling == "nearest", normals)
    lead = Lead(SheetDomain(atlas, guides), leading, plan)
    sharpen_by_width(domain, own, values, result, lead)


def _measured(
    atlas: TextureAtlas, values: Texels, channels: Channels, settings: TextureSettings
) -> Measured:
    with aside("Measuring borders"):
        return measured(values, channels, settings, inside=nodes_inside(atlas))


def nodes_inside(atlas: TextureAtlas) -> npt.NDArray[np.bool_]:
    """Return which nodes lie inside charts: (rows, columns)."""
    return atlas.sheet.nodes >= 0
