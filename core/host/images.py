# SPDX-License-Identifier: GPL-3.0-or-later
"""Filter an image, as a host program stores it: opacity, multiplied floats, bytes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base.memo import kept
from ..base.parallel import blocks
from ..base.progress import ProgressCallback, aside, reporting
from ..color.by_width.measuring import NOT_MEASURED, Measured
from ..color.image_sharpening import measure_image
from ..color.image_smoothing import with_beta
from ..color.learned.enlarged_images import is_enlarged_as_learned
from ..color.pixel_art import pixel_art
from ..grid.channels import opacity_channel
from ..grid.enlarge import enlarged
from ..registry import find
from ..settings import BY_WIDTH, named, value_of
from .inputs import HostImage, Pixels
from .recolored import Recolored, recolored

_ROWS = 256
"""Rows of an image that are divided or multiplied by opacity at once."""


def filter_image(
    image: HostImage, name: str, settings: Any, progress: ProgressCallback | None = None
) -> Recolored:
    """Filter an image, with colors that are not multiplied by opacity.

    Parameters
    ----------
    image : HostImage
    name, settings
        As in `geometry.filter_shape`. If the settings say that there is no opacity, all four
        channels are filtered alike.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.

    Returns
    -------
    Recolored
        Pixels that do not change stay bit for bit.

    Raises
    ------
    ShockError
        As the filter does.
    """
    words = {} if image.known is None else {"known": image.known}
    with reporting(progress):
        return filter_pixels(image, name, settings, **words)


def with_measures(part: HostImage, whole: HostImage, settings: Any) -> HostImage:
    """Return a part of an image with the measurements of the whole."""
    if not settings.kernel.by_width:
        return part

    def measure() -> Measured:
        pixels, alpha = whole.pixels, settings.alpha
        if alpha == "none" or whole.opacity == "CHANNEL_PACKED":
            alpha = "none"
        elif whole.opacity == "NONE" or whole.premultiplied:  # colors count as opacity says
            pixels, alpha = pixels[..., :3], "none"
        if is_enlarged_as_learned(settings.kernel, False):  # this needs nothing else
            share = pixel_art(pixels, opacity_channel(pixels.shape[2], alpha))
            return NOT_MEASURED._replace(pixel_art=share)
        return measure_image(pixels, replace(settings, alpha=alpha))

    key = tuple(replace(settings, time=BY_WIDTH, amount=1.0).__dict__.values())
    return replace(part, known=kept(whole, "measured", key, measure))


def with_beta_of(whole: HostImage, settings: Any) -> Any:
    """Return settings for a part of an image whose noise is that of the whole."""
    if not settings.kernel.by_noise:
        return settings

    def measure() -> float:
        found: list[float] = []

        def look(pixels: Pixels, alpha: str) -> Pixels:
            found.append(with_beta(with_opacity(settings.kernel, alpha), pixels).beta)
            return pixels

        filter_channels(whole, look, settings.kernel.alpha)
        return found[0]

    return settings.changed(beta=kept(whole, "noise", settings.kernel.alpha, measure))


def filter_pixels(
    image: HostImage,
    name: str,
    settings: Any,
    *before: Any,
    shown: npt.NDArray[np.bool_] | None = None,
    **words: Any,
) -> Recolored:
    """Filter an image, with further arguments of its filter before the pixels and by keyword.

    `shown` says which pixels are counted, see `recolored`.
    """
    kernel, run = settings.kernel, find(name).function(settings.sharpen_time)

    def function(pixels: Pixels, alpha: str) -> Pixels:
        return run(*before, pixels, settings=with_opacity(kernel, alpha), **words)

    times = value_of(kernel, "enlargement", 1)
    new = filter_channels(image, function, value_of(kernel, "opacity", "auto"), times)
    if times == 1:
        return recolored(image.pixels, new, image.levels, shown)
    return recolored_larger(image.pixels, new, image.levels, times)


def recolored_larger(old: Pixels, new: Pixels, levels: int, times: int) -> Recolored:
    """Return `recolored` of an image that is enlarged by a factor; all of its pixels are new."""
    large = enlarged(old, times)
    if levels:
        large = np.rint(large * levels) / np.float32(levels)
    return replace(recolored(large, new, levels), changed=new[..., 0].size)


def with_opacity(settings: Any, alpha: str) -> Any:
    """Return settings with this channel of opacity, if they have such a setting."""
    name = named(type(settings), "opacity")
    return settings.changed(**{name: alpha}) if name else settings


def filter_channels(
    image: HostImage, function: Callable[[Pixels, str], Pixels], alpha: str, times: int = 1
) -> Pixels:
    """Filter the channels of colors, not multiplied by opacity, without rounding.

    Parameters
    ----------
    image : HostImage
    function : callable
        ``function(pixels, alpha)`` filters pixels; `alpha` replaces that of the settings.
    alpha : str
        `alpha` of the settings.
    times : int
        Factor by which the result is higher and wider.
    """
    old = image.pixels
    if alpha == "none" or image.opacity == "CHANNEL_PACKED":
        new = function(old, "none")
    elif image.opacity == "NONE":
        new = np.ones((times * len(old), times * old.shape[1], 4), dtype=np.float32)
        if times == 1:
            new[..., 3] = old[..., 3]
        new[..., :3] = function(old[..., :3], "none")
    elif image.premultiplied:
        new = _filter_multiplied(old, function, times)
    else:
        new = function(old, "auto")
    return new


def divided(pixels: Pixels) -> Pixels:
    """Return pixels with colors divided by opacity."""
    straight = np.empty_like(pixels)
    with aside("Preparing"):
        for band in blocks(len(pixels), _ROWS):
            straight[band] = pixels[band]
            straight[band, :, :3] /= _factor(pixels[band])
    return straight


def _filter_multiplied(
    pixels: Pixels, function: Callable[[Pixels, str], Pixels], times: int
) -> Pixels:
    straight = divided(pixels)
    new = function(straight, "auto")
    with aside("Comparing colors"):
        for band in blocks(len(new), _ROWS):
            if times > 1:
                new[band, :, :3] *= _factor(new[band])
                continue
            same = (new[band] == straight[band]).all(axis=-1, keepdims=True)
            new[band, :, :3] *= _factor(new[band])
            np.copyto(new[band], pixels[band], where=same)
    return new


def _factor(pixels: Pixels) -> Pixels:
    opacity = pixels[..., 3:]
    return np.where(opacity > 0, opacity, np.float32(1.0))
