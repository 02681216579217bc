# SPDX-License-Identifier: GPL-3.0-or-later
"""Guide images: the values of an image follow the flow of its guide."""

from __future__ import annotations

from typing import Any

import numpy.typing as npt

from ..base.checks import LARGEST, checked_image
from ..errors import InvalidSettings, InvalidSignal
from ..settings import ImageSettings, TextureSettings


def checked_guide(
    guide: npt.ArrayLike | None, image: npt.NDArray, settings: ImageSettings | TextureSettings
) -> npt.NDArray | None:
    """Return a guide as (h, w, c) pixels; None if there is none.

    Raises
    ------
    InvalidSignal
        If it is not an image, or has another size than the image.
    InvalidSettings
        If the settings do not allow a guide.
    """
    if guide is None:
        return None
    found = checked_image(guide, LARGEST)
    check_guide(found, image, settings)
    return found.reshape(*found.shape[:2], -1)


def check_guide(guide: Any, image: Any, settings: ImageSettings | TextureSettings) -> None:
    """Raise the errors of `checked_guide` for the size of a guide, or for the settings."""
    if guide.shape[:2] != image.shape[:2]:
        raise InvalidSignal(
            f"The guide has {guide.shape[1]} x {guide.shape[0]} pixels, the image"
            f" {image.shape[1]} x {image.shape[0]}; scale it to the same size."
        )
    if settings.channels == "independent":
        raise InvalidSettings(
            "channels is 'independent', and a guide moves all alike; choose 'coupled' or"
            " 'luminance'."
        )
