# SPDX-License-Identifier: GPL-3.0-or-later
"""Measurement of the dials What and Width of images and textures."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...base.checks import SCALES
from ...base.progress import aside
from ...grid.borders import Borders, is_drawing, measure_borders
from ...grid.channels import Channels
from ...settings import ImageSettings, TextureSettings
from .dials import counted_width, tell_widths


class Measured(NamedTuple):
    """The measurements of an image that decide how it is sharpened.

    Attributes
    ----------
    what : str
        "drawing" or "photo".
    width : float
        The width of borders to close; 0 if there are none.
    borders : Borders
    pixel_art : float
        The result of `color.pixel_art`, from 0 to 1.
    """

    what: str
    width: float
    borders: Borders
    pixel_art: float = 0.0


NOT_MEASURED = Measured("auto", 0.0, Borders())


def scale_of(pixels: npt.NDArray) -> float:
    """Return the factor that brings an image's values to [0, 1]."""
    return SCALES[pixels.dtype.name]


def measured(
    pixels: npt.NDArray,
    channels: Channels,
    settings: ImageSettings | TextureSettings,
    *,
    enlarge: int = 1,
    inside: npt.NDArray[np.bool_] | None = None,
) -> Measured:
    """Measure What and Width, except where the settings say them.

    Parameters
    ----------
    pixels : (h, w, c) array
    channels : Channels
    settings : ImageSettings or TextureSettings
    enlarge : int
        How many times the image was enlarged.
    inside : (h, w) bool, optional
        Texels to measure.
    """
    scale = scale_of(pixels)
    borders = measure_borders(pixels, scale, channels, inside=inside)
    what = settings.what
    if what == "auto":
        drawing = is_drawing(pixels, scale, channels, borders, inside)
        what = "drawing" if drawing else "photo"
    return Measured(what, counted_width(settings.width, borders.width, what, enlarge), borders)


def tell_closed(
    unit: str,
    found: Measured,
    result: npt.NDArray,
    channels: Channels,
    *,
    inside: npt.NDArray[np.bool_] | None = None,
) -> None:
    """Measure a result, and report the widths of borders before and after; see `tell_widths`."""
    width = None
    if found.width > 0:
        with aside("Measuring borders"):
            scale = scale_of(result)
            width = measure_borders(result, scale, channels, inside=inside, roughly=True).width
    tell_widths(unit, found.borders.width, found.borders.number, width)
