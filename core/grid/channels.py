# SPDX-License-Identifier: GPL-3.0-or-later
"""The channels of an image: which are filtered, which is opacity, which guide the flow."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..settings import ImageSettings, TextureSettings

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Weights of linear red, green and blue in the brightness (ITU-R BT.709)."""


class Channels(NamedTuple):
    """Which channels of an image are filtered, and how they guide the flow.

    Attributes
    ----------
    start, stop : int
        The channels ``start <= c < stop``.
    alpha : int
        The channel that is opacity, or -1.
    brightness : (k,) float32
        Weights of the channels in one guiding brightness; if empty, each channel guides.
    """

    start: int
    stop: int
    alpha: int
    brightness: npt.NDArray[np.float32]


def opacity_channel(channels: int, alpha: str) -> int:
    """Find the channel that is opacity, or -1; `alpha` is as in `ImageSettings`."""
    return channels - 1 if alpha == "auto" and channels in (2, 4) else -1


def brightness_weights(count: int) -> npt.NDArray[np.float64]:
    """Weights of `count` colors in the brightness, equal if they are not RGB: (k,)."""
    return LUMINANCE if count >= 3 else np.full(count, 1.0 / count)


def channel_groups(count: int, settings: ImageSettings | TextureSettings) -> list[Channels]:
    """Group `count` channels by the flow that they follow."""
    alpha = opacity_channel(count, settings.alpha)
    colors = count - (alpha >= 0)
    none = np.empty(0, dtype=np.float32)
    if settings.channels == "independent":
        return [Channels(c, c + 1, alpha, none) for c in range(colors)]
    if settings.channels == "luminance":
        return [Channels(0, colors, alpha, brightness_weights(colors).astype(np.float32))]
    return [Channels(0, colors, alpha, none)]


def with_opacity(groups: list[Channels]) -> list[Channels]:
    """Add opacity, where there is one, as a group of its own."""
    alpha = groups[0].alpha
    none = np.empty(0, dtype=np.float32)
    return groups if alpha < 0 else [*groups, Channels(alpha, alpha + 1, -1, none)]
