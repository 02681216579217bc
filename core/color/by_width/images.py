# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpening of images by the width of their borders; see `by_width`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy.typing as npt

from ...base.findings import is_gathered
from ...grid.channels import Channels
from ...grid.part import Part
from ...grid.potential import flow_reach
from ...settings import ImageSettings
from .dials import Plan, plan_of
from .grid_domain import GridDomain, contrast_reach, nearby_reach
from .measuring import Measured, tell_closed
from .recipe import Lead, sharpen_by_width


def sharpen_pixels_by_width(
    pixels: npt.NDArray,
    channels: Channels,
    settings: ImageSettings,
    target: npt.NDArray,
    found: Measured,
    part: Part | None = None,
) -> None:
    """Sharpen some channels of an image into `target`, which holds a copy of the image.

    Parameters
    ----------
    pixels, target : (h, w, c) array
    channels : Channels
    settings : ImageSettings
    found : Measured
        Measurements of the channels in the whole image.
    part : Part, optional
        The wanted pixels, if the image is a part of another one.
    """
    if found.width > 0:
        domain = GridDomain.of(pixels, channels, settings, part)
        sharpen_by_width(domain, _plan(found, settings, domain.scale), pixels, target)
    if settings.width == 0 and channels.start == 0 and part is None and is_gathered():
        tell_closed("pixels", found, target, channels)


def follow_pixels_by_width(
    lead: npt.NDArray,
    guides: Channels,
    pixels: npt.NDArray,
    channels: Channels,
    settings: ImageSettings,
    target: npt.NDArray,
    found: Sequence[Measured],
    part: Part | None = None,
) -> None:
    """Advect an image by the flow of another one.

    Parameters
    ----------
    lead : (h, w, c) array
        The guide, which defines the width of borders and the flow.
    guides : Channels
        The guiding channels of `lead`.
    pixels, target : (h, w, c) array
    channels : Channels
        The filtered channels of the image.
    settings : ImageSettings
    found : sequence of Measured
        Measurements of the guide and of the image; of the latter only the noise is used.
    part : Part, optional
        The wanted pixels, if both are parts of larger images.
    """
    if found[0].width == 0:
        return
    domain = GridDomain.of(pixels, channels, settings, part)
    leading = GridDomain.of(lead, guides, settings, part)
    plan = _plan(found[0], settings, leading.scale)
    own = _plan(found[1], settings, domain.scale)
    own = plan._replace(unsharp=own.unsharp, grain=own.grain)
    sharpen_by_width(domain, own, pixels, target, Lead(leading, lead, plan))


def _plan(found: Measured, settings: ImageSettings, scale: float) -> Plan:
    noise, passes = found.borders.noise, settings.smoothing_passes
    plan = plan_of(found.what, found.width, noise, passes, settings.enlarge)
    return plan._replace(grain=plan.grain / scale)


def reach_by_width(found: Measured, settings: ImageSettings) -> tuple[int, int]:
    """Return the radii in pixels within which an image affects the flow, and all else.

    Parameters
    ----------
    found : Measured
    settings : ImageSettings
    """
    if found.width == 0:
        return 0, 0
    plan = _plan(found, settings, 1.0)
    unsharp = nearby_reach(plan.blur, plan.limit)
    times = contrast_reach(plan.presmooth, plan.reach)
    if plan.unsharp_first:
        return unsharp + flow_reach(plan.passes), unsharp + times
    return flow_reach(plan.passes), max(unsharp, times)
