# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpening of images by the width of their borders; see `dials`.

Contrasts and the unsharp part are computed in bands of rows, on threads, with as many rows around
them as windows reach.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.checks import BAND, SCALES
from ..base.findings import is_gathered
from ..base.parallel import blocks, run
from ..base.progress import aside, phase
from ..grid.advect import advect_pixels
from ..grid.borders import Borders, guide_planes, is_drawing, measure_borders
from ..grid.channels import Channels
from ..grid.part import Part
from ..grid.potential import flow_reach, image_potential
from ..grid.windows import Plane, gaussian, least_and_greatest, smooth
from ..settings import ImageSettings
from .dials import (
    Plan,
    blended,
    contrast,
    counted_width,
    flow_times,
    limited_unsharp,
    plan_of,
    tell_widths,
)

_FEWEST_ROWS = 64


class Measured(NamedTuple):
    """What is done to an image, as far as its pixels say it.

    Attributes
    ----------
    what : str
        "drawing" or "photo".
    width : float
        Of the borders that are closed; 0: nothing is done.
    borders : Borders
    """

    what: str
    width: float
    borders: Borders


def measured(pixels: npt.NDArray, channels: Channels, settings: ImageSettings) -> Measured:
    """Find out What and Width where they are not given.

    Parameters
    ----------
    pixels : (h, w, c) array
    channels : Channels
    settings : ImageSettings
    """
    scale = SCALES[pixels.dtype.name]
    borders = measure_borders(pixels, scale, channels)
    what = settings.what
    if what == "auto":
        what = "drawing" if is_drawing(pixels, scale, channels, borders) else "photo"
    width = counted_width(settings.width, borders.width, what, settings.enlarge)
    return Measured(what, width, borders)


def sharpen_by_width(
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
        Of the channels, in all of the image.
    part : Part, optional
        What is wanted, if the image is a part of another one.
    """
    width, borders = found.width, found.borders
    if width > 0:
        _follow(_plan(found, settings), pixels, channels, settings, target, part=part)
    if settings.width == 0 and channels.start == 0 and part is None and is_gathered():
        result = None
        if width > 0:
            with aside("Measuring borders"):
                scale = SCALES[pixels.dtype.name]
                result = measure_borders(target, scale, channels, roughly=True).width
        tell_widths("pixels", borders.width, borders.number, result)


def follow_by_width(
    lead: npt.NDArray,
    guides: Channels,
    pixels: npt.NDArray,
    channels: Channels,
    settings: ImageSettings,
    target: npt.NDArray,
    found: Sequence[Measured],
    part: Part | None = None,
) -> None:
    """Do to an image what is done to another one, whose flow it follows.

    Parameters
    ----------
    lead : (h, w, c) array
        Says how wide borders are, and how values flow.
    guides : Channels
        Those of it that guide.
    pixels, target : (h, w, c) array
    channels : Channels
        Of the image.
    settings : ImageSettings
    found : sequence of Measured
        Of the lead, and of the image, where only the noise counts.
    part : Part, optional
        What is wanted, if both are parts of larger ones.
    """
    if found[0].width == 0:
        return
    plan, own = (_plan(each, settings) for each in found)
    with phase(0.0, 0.2, "Sharpening"):
        leading = _drawn_apart(lead, guides, plan) if plan.unsharp_first else lead
    with phase(0.2, 1.0, "Sharpening"):
        own = plan._replace(unsharp=own.unsharp, grain=own.grain)
        guide = _Guide(leading, SCALES[lead.dtype.name], guides)
        _follow(own, pixels, channels, settings, target, guide, part)


def _plan(found: Measured, settings: ImageSettings) -> Plan:
    what, width, borders = found
    return plan_of(what, width, borders.noise, settings.smoothing_passes, settings.enlarge)


def reach_by_width(found: Measured, settings: ImageSettings) -> tuple[int, int]:
    """How far around a pixel an image counts: for the flow there, and for all else.

    Parameters
    ----------
    found : Measured
    settings : ImageSettings
    """
    if found.width == 0:
        return 0, 0
    plan = _plan(found, settings)
    unsharp, times = _unsharp_reach(plan), _times_reach(plan)
    if plan.unsharp_first:
        return unsharp + flow_reach(plan.passes), unsharp + times
    return flow_reach(plan.passes), max(unsharp, times)


class _Guide(NamedTuple):
    # What values flow by: pixels, what brings them to [0, 1], and the channels that count.
    pixels: npt.NDArray
    scale: float
    channels: Channels


def _follow(
    plan: Plan,
    pixels: npt.NDArray,
    channels: Channels,
    settings: ImageSettings,
    target: npt.NDArray,
    guide: _Guide | None = None,
    part: Part | None = None,
) -> None:
    nearest = settings.sampling == "nearest"
    scale = SCALES[pixels.dtype.name]
    if plan.unsharp_first:
        with phase(0.0, 0.2, "Sharpening"):
            sharp = _drawn_apart(pixels, channels, plan)
        with phase(0.2, 1.0, "Sharpening"):
            guide = guide or _Guide(sharp, scale, channels)
            _flow(sharp, channels, guide, plan, nearest, target, part)
        return
    flowed = _floats(pixels)
    with phase(0.0, 0.8, "Sharpening"):
        if plan.square > 0:
            guide = guide or _Guide(pixels, scale, channels)
            _flow(pixels, channels, guide, plan, nearest, flowed, part)

    def mix(rows: slice, c: int, values: Plane) -> None:
        mixed = blended(plan, values, flowed[rows, :, c])
        _put(target, rows, c, mixed)

    with phase(0.8, 1.0, "Sharpening"):
        _unsharp(pixels, channels, plan, mix)


def _drawn_apart(pixels: npt.NDArray, channels: Channels, plan: Plan) -> npt.NDArray:
    sharp = _floats(pixels)
    _unsharp(pixels, channels, plan, lambda rows, c, values: _put(sharp, rows, c, values))
    return sharp


def _floats(pixels: npt.NDArray) -> npt.NDArray:
    copy = np.empty(pixels.shape, np.float64 if pixels.dtype == np.float64 else np.float32)
    with aside("Sharpening"):
        for band in blocks(len(pixels), BAND):
            copy[band] = pixels[band]
    return copy


def _put(target: npt.NDArray, rows: slice, channel: int, values: npt.NDArray) -> None:
    target[rows, :, channel] = np.rint(values) if target.dtype.kind == "u" else values


def _flow(
    pixels: npt.NDArray,
    channels: Channels,
    guide: _Guide,
    plan: Plan,
    nearest: bool,
    target: npt.NDArray,
    part: Part | None,
) -> None:
    with phase(0.0, 0.2, "Computing the flow"):
        times = _times(*guide, plan)
    with phase(0.2, 0.3, "Computing the flow"):
        potential = image_potential(*guide, plan.passes)
    with phase(0.3, 1.0, "Tracing flow-lines"):
        advect_pixels(pixels, channels, potential, times, target, nearest=nearest, part=part)


def _times_reach(plan: Plan) -> int:
    return len(gaussian(plan.presmooth)) + round(plan.reach) + len(gaussian(plan.reach / 2.0))


def _unsharp_reach(plan: Plan) -> int:
    return max(len(gaussian(plan.blur)), int(np.ceil(plan.limit)))


def _times(
    pixels: npt.NDArray, scale: float, channels: Channels, plan: Plan
) -> npt.NDArray[np.float32]:
    before, after = gaussian(plan.presmooth), gaussian(plan.reach / 2.0)
    reach, halo = round(plan.reach), _times_reach(plan)
    times = np.empty(pixels.shape[:2], np.float32)

    def fill(start: int, stop: int) -> None:
        first = max(start - halo, 0)
        planes = guide_planes(pixels, scale, channels, slice(first, stop + halo))
        low = np.stack([smooth(plane, before) for plane in planes])
        high = low.copy()
        for least, greatest in zip(low, high, strict=True):
            least_and_greatest(least, greatest, reach)
        around = smooth(contrast(np.moveaxis(low, 0, -1), np.moveaxis(high, 0, -1)), after)
        times[start:stop] = flow_times(plan, around[start - first : stop - first])

    run(fill, len(pixels), chunk=max(_FEWEST_ROWS, halo))
    return times


def _unsharp(
    pixels: npt.NDArray,
    channels: Channels,
    plan: Plan,
    put: Callable[[slice, int, Plane], None],
) -> None:
    # Hands the result to ``put(rows, channel, values)``, in the image's range.
    weights = gaussian(plan.blur)
    ranged = plan._replace(grain=plan.grain / SCALES[pixels.dtype.name])
    reach, halo = int(np.ceil(plan.limit)), _unsharp_reach(plan)

    def fill(start: int, stop: int) -> None:
        first = max(start - halo, 0)
        part = pixels[first : stop + halo]
        inner = slice(start - first, stop - first)
        opacity = None
        if channels.alpha >= 0:
            opacity = np.ascontiguousarray(part[..., channels.alpha], dtype=np.float32)
            spread = smooth(opacity, weights)
        for c in range(channels.start, channels.stop):
            values = np.ascontiguousarray(part[..., c], dtype=np.float32)
            low, high = values.copy(), values.copy()
            if opacity is None:
                smoothed = smooth(values, weights)
            else:
                smoothed = smooth(values * opacity, weights)
                np.divide(smoothed, spread, out=smoothed, where=spread > 0)
                low[opacity == 0], high[opacity == 0] = np.inf, -np.inf
            least_and_greatest(low, high, reach)
            sharp = limited_unsharp(ranged, values, smoothed, low, high)
            if opacity is not None:
                np.copyto(sharp, values, where=opacity == 0)
            put(slice(start, stop), c, sharp[inner])

    run(fill, len(pixels), chunk=max(_FEWEST_ROWS, halo))
