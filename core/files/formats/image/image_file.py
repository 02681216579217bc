# SPDX-License-Identifier: GPL-3.0-or-later
"""What all image formats share: the picture that a file becomes, and what it says beside pixels."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ICC, RESOLUTION, EXIF, XMP = "ICC profile", "resolution", "EXIF", "XMP"


@dataclass
class ImageFile:
    """An image file in memory.

    Attributes
    ----------
    pixels : (h, w) or (h, w, c) array, or what reads windows of one
        Two or four channels end with opacity.
    format : str
        Name of the format it was read from.
    about : dict
        What most formats know: ICC profile, EXIF and XMP as bytes, resolution as pixels an inch.
    notes : list of str
        What could not be taken from the file as it is.
    own : Any
        What only its own format understands.
    only_own : list of str
        Names of that, as far as another format leaves it behind.
    orientation : int
        How the pixels are to be turned to be shown, as TIFF and EXIF number it; 1 is upright.
    premultiplied : bool
        Whether opacity is multiplied into the colors.
    """

    pixels: Any
    format: str
    about: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    own: Any = None
    only_own: list[str] = field(default_factory=list)
    orientation: int = 1
    premultiplied: bool = False


def lost(image_file: ImageFile, target: Path, kept: set[str], name: str = "") -> list[str]:
    """A note on what a format, of this name, cannot hold."""
    missing = set(image_file.about) - kept
    if image_file.format != name:
        missing |= set(image_file.only_own)
    if not missing:
        return []
    return [f"{target.suffix} does not keep {', '.join(sorted(missing))}: left behind"]
