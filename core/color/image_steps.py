# SPDX-License-Identifier: GPL-3.0-or-later
"""Steps of sharpening an image, or a part of one, from checked arguments (paper A, section 3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from ..base.checks import (
    BAND,
    SCALES,
)
from ..base.parallel import blocks
from ..base.progress import aside, phase
from ..grid.borders import measure_borders
from ..grid.channels import Channels, channel_groups, opacity_channel, with_opacity
from ..grid.enlarge import enlarged
from ..grid.part import Part
from ..grid.pixels import mix
from ..settings import ImageSettings
from .by_width.domain import flow_for_time
from .by_width.grid_domain import GridDomain
from .by_width.images import follow_pixels_by_width, sharpen_pixels_by_width
from .by_width.measuring import Measured, measured
from .learned.enlarged_images import enlarge_pixels, is_enlarged_as_learned
from .learned.images import (
    is_learned,
    measured_for_learned,
    sharpen_pixels_learned,
    with_detail,
)
from .learned.report import tell_opacity
from .pixel_art import is_for_pixel_art, put_pixels, told_pixel_art

LARGEST = 1e15
"""Largest absolute value: with larger ones, the measurement of borders would overflow float32."""


def sharpen_checked(
    given: npt.NDArray,
    result: npt.NDArray,
    settings: ImageSettings,
    weights: npt.NDArray | None,
    lead: npt.NDArray | None,
    known: Measured | Sequence[Measured] | None,
    part: Part | None = None,
) -> None:
    """Sharpen an image as `sharpen_image` does, from checked arguments.

    Parameters
    ----------
    given, result : (h, w) or (h, w, c) array
    settings : ImageSettings
    weights : (h, w) float64, optional
    lead : (h, w, c) array, optional
        The guide.
    known : Measured or sequence of them, optional
        Measurements of all channels, or the result of `measured_each`.
    part : Part, optional
        The wanted pixels, if the image is a part of another one; in pixels of the result.

    Raises
    ------
    LeftPart
        If the part is too small for the wanted pixels.
    """
    pixels = given.reshape(*given.shape[:2], -1)
    target = result.reshape(*result.shape[:2], -1)
    squares = 0.0
    if is_for_pixel_art(settings, lead is not None):
        squares = _known_pixel_art(known, pixels, settings)
    if settings.enlarge == 1:
        settings = settings.changed(amount=(1.0 - squares) * settings.amount)
        _filter_into(target, pixels, settings, weights, lead, known, part)
        _tell_opacity(pixels, target, settings, lead, part)
        return
    with phase(0.0, 0.1, "Enlarging"):
        large = large_pixels(pixels, settings)
        lead = None if lead is None else large_pixels(lead, replace(settings, alpha="auto"))
    if weights is not None:
        with aside("Enlarging"):
            weights = enlarged(weights[..., None], settings.enlarge)[..., 0]
    floats = np.empty_like(large)
    learned = is_enlarged_as_learned(settings, lead is not None) and not settings.is_neutral
    if not (learned or squares > 0):
        with phase(0.1, 1.0, "Sharpening"):
            _filter_into(floats, large, settings, weights, lead, known, part)
    else:
        with phase(0.1, 0.9, "Enlarging"):
            if squares < 1 and learned:
                _enlarge_into(floats, pixels, settings)
            elif squares < 1:
                _filter_into(floats, large, settings.changed(amount=1.0), None, lead, known, part)
            if squares > 0:
                alpha = opacity_channel(pixels.shape[2], settings.alpha)
                put_pixels(pixels, squares, settings.enlarge, alpha, floats)
        _mix_into(floats, large, settings, weights)
    if not learned and squares < 1:
        _tell_opacity(large, floats, settings, lead, part)
    with aside("Sharpening"):
        scale = SCALES[given.dtype.name]
        for band in blocks(len(floats), BAND):
            target[band] = np.rint(floats[band] / scale) if scale != 1.0 else floats[band]


def _known_pixel_art(
    known: Measured | Sequence[Measured] | None, pixels: npt.NDArray, settings: ImageSettings
) -> float:
    if known is None:
        return told_pixel_art(pixels, settings)
    return (known if isinstance(known, Measured) else known[0]).pixel_art


def large_pixels(pixels: npt.NDArray, settings: ImageSettings) -> npt.NDArray:
    """Enlarge to floats in the range of colors, so that soft slopes do not become stairs."""
    alpha = opacity_channel(pixels.shape[2], settings.alpha)
    weighing = opacity_in_range(pixels, alpha)
    scale = SCALES[pixels.dtype.name]
    large = enlarged(weighing, settings.enlarge, scale, alpha)
    if weighing is not pixels:  # opacity itself is not clipped
        own = np.ascontiguousarray(pixels[..., alpha, None])
        large[..., alpha] = enlarged(own, settings.enlarge, scale, 0)[..., 0]
    return large


def _enlarge_into(target: npt.NDArray, pixels: npt.NDArray, settings: ImageSettings) -> None:
    colors, *opacity = with_opacity(
        channel_groups(pixels.shape[2], replace(settings, channels="coupled"))
    )
    share = 1.0 - 0.25 * len(opacity)
    with phase(0.0, share, "Enlarging"):
        enlarge_pixels(opacity_in_range(pixels, colors.alpha), colors, settings.enlarge, target)
    for channels in opacity:
        with phase(share, 1.0, "Enlarging"):
            enlarge_pixels(pixels, channels, settings.enlarge, target)


def _filter_into(
    target: npt.NDArray,
    pixels: npt.NDArray,
    settings: ImageSettings,
    weights: npt.NDArray | None,
    lead: npt.NDArray | None,
    known: Measured | Sequence[Measured] | None,
    part: Part | None,
) -> None:
    with aside("Sharpening"):
        for band in blocks(len(pixels), BAND):
            target[band] = pixels[band]
    if settings.is_neutral:
        return
    _sharpen_into(target, pixels, settings, lead, known, part)
    _mix_into(target, pixels, settings, weights)


def _mix_into(
    target: npt.NDArray,
    pixels: npt.NDArray,
    settings: ImageSettings,
    weights: npt.NDArray | None,
) -> None:
    if weights is not None or settings.amount < 1.0:
        with phase(1.0, 1.0, "Sharpening"):
            mix(pixels, _times_amount(weights, settings.amount, pixels), target)


def _tell_opacity(
    old: npt.NDArray,
    new: npt.NDArray,
    settings: ImageSettings,
    lead: npt.NDArray | None,
    part: Part | None,
) -> None:
    # Reports if opacity differs in the final result.
    if part is not None:
        old, new = old[part.rows, part.columns], new[part.rows, part.columns]
    alpha = opacity_channel(old.shape[2], settings.alpha)
    is_sharpened = settings.by_width and lead is None and alpha >= 0
    if is_sharpened and not np.array_equal(old[..., alpha], new[..., alpha]):
        tell_opacity()


def _times_amount(weights: npt.NDArray | None, amount: float, pixels: npt.NDArray) -> npt.NDArray:
    if weights is None:
        return np.broadcast_to(np.float64(amount), pixels.shape[:2])
    return weights if amount == 1.0 else weights * amount


def measured_whole(pixels: npt.NDArray, channels: Channels, settings: ImageSettings) -> Measured:
    """Measure all that the sharpening of some channels of an image may need."""
    found = measured(pixels, channels, settings, enlarge=settings.enlarge)
    if is_learned(settings, False):
        return with_detail(found, pixels, channels)
    return found


def measured_each(
    pixels: npt.NDArray,
    lead: npt.NDArray | None,
    settings: ImageSettings,
    known: Measured | None = None,
) -> tuple[Measured, ...]:
    """Measure each group of channels; with a guide, the guide and the borders of the image.

    If `known` is given, only the borders of an image with a guide are measured.
    """
    scale = SCALES[pixels.dtype.name]
    if lead is None:
        groups = with_opacity(channel_groups(pixels.shape[2], settings))
        if is_learned(settings, False):
            if known and known.borders.detail == 0.0:  # measured for another way
                return tuple(with_detail(known, pixels, each) for each in groups)
            return tuple(known or measured_for_learned(pixels, each, settings) for each in groups)
        return tuple(
            known or measured(pixels, channels, settings, enlarge=settings.enlarge)
            for channels in groups
        )
    channels, guides = _leading(pixels, lead, settings)
    found = known or measured(lead, guides, settings, enlarge=settings.enlarge)
    return found, found._replace(borders=measure_borders(pixels, scale, channels))


def _leading(
    pixels: npt.NDArray, lead: npt.NDArray, settings: ImageSettings
) -> tuple[Channels, Channels]:
    # The filtered channels, and the guiding channels.
    (channels,) = channel_groups(pixels.shape[2], replace(settings, channels="coupled"))
    (guides,) = channel_groups(lead.shape[2], replace(settings, alpha="auto"))
    return channels, guides


def _sharpen_into(
    target: npt.NDArray,
    pixels: npt.NDArray,
    settings: ImageSettings,
    lead: npt.NDArray | None,
    known: Measured | Sequence[Measured] | None,
    part: Part | None,
) -> None:
    # `target` holds a copy of the pixels.
    thin = min(pixels.shape[:2]) < 2
    if thin:  # a line of pixels is widened to have cells
        pixels = _widened(pixels)
        lead = None if lead is None else _widened(lead)
        part = None  # lines are filtered as a whole
    widened = pixels.copy() if thin else target
    groups = channel_groups(pixels.shape[2], settings)
    pixels = opacity_in_range(pixels, groups[0].alpha)
    if lead is not None:
        lead = opacity_in_range(lead, opacity_channel(lead.shape[2], "auto"))
    found: Sequence[Measured] = ()
    if settings.by_width:
        with aside("Measuring borders"):
            if known is None or isinstance(known, Measured):
                found = measured_each(pixels, lead, settings, known)
            else:
                found = known
    learned = is_learned(settings, lead is not None)
    alpha = groups[0].alpha
    if settings.by_width and alpha >= 0 and np.ptp(pixels[..., alpha]) > 0:
        groups = with_opacity(groups)
    if lead is not None:
        _follow_into(widened, pixels, lead, settings, found, part)
        groups = []
    for number, channels in enumerate(groups):
        with phase(number / len(groups), (number + 1) / len(groups), "Sharpening"):
            if learned:
                sharpen_pixels_learned(pixels, channels, settings, widened, found[number], part)
            elif settings.by_width:
                sharpen_pixels_by_width(pixels, channels, settings, widened, found[number], part)
            else:
                _flow_into(widened, pixels, channels, pixels, channels, settings, part)
    if settings.by_width and lead is None and alpha >= 0:
        _hide(pixels[..., alpha], widened[..., alpha])
    if thin:
        target[...] = widened[: target.shape[0], : target.shape[1]]


def _hide(old: npt.NDArray, new: npt.NDArray) -> None:
    # Hidden pixels stay hidden, because they have no color.
    with aside("Sharpening"):
        for band in blocks(len(old), BAND):
            np.copyto(new[band], old[band], where=old[band] == 0)


def _widened(pixels: npt.NDArray) -> npt.NDArray:
    twice = [max(2 // n, 1) for n in pixels.shape[:2]]
    return np.repeat(np.repeat(pixels, twice[0], axis=0), twice[1], axis=1)


def _follow_into(
    target: npt.NDArray,
    pixels: npt.NDArray,
    lead: npt.NDArray,
    settings: ImageSettings,
    found: Sequence[Measured],
    part: Part | None,
) -> None:
    channels, guides = _leading(pixels, lead, settings)
    if settings.by_width:
        follow_pixels_by_width(lead, guides, pixels, channels, settings, target, found, part)
        return
    _flow_into(target, pixels, channels, lead, guides, settings, part)


def _flow_into(
    target: npt.NDArray,
    pixels: npt.NDArray,
    channels: Channels,
    lead: npt.NDArray,
    guides: Channels,
    settings: ImageSettings,
    part: Part | None,
) -> None:
    # The channels of the pixels follow the flow of the guide.
    domain = GridDomain.of(pixels, channels, settings, part)
    leading = GridDomain.of(lead, guides, settings, part)
    passes = settings.smoothing_passes
    flow_for_time(domain, pixels, leading, lead, passes, settings.time, target)


def opacity_in_range(pixels: npt.NDArray, alpha: int) -> npt.NDArray:
    """Clip opacity, channel `alpha`: floats may leave [0, 1], but a weight must not."""
    if alpha < 0 or pixels.dtype.kind == "u":
        return pixels
    opacity = pixels[..., alpha]
    if opacity.min() >= 0 and opacity.max() <= 1:
        return pixels
    pixels = pixels.copy()
    np.clip(opacity, 0.0, 1.0, out=pixels[..., alpha])
    return pixels
