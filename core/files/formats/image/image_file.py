# SPDX-License-Identifier: GPL-3.0-or-later
"""The common class of image formats: the picture that a file becomes, and its metadata."""

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
    pixels : (h, w) or (h, w, c) array, or an object that reads windows of one
        The last of two or four channels is opacity.
    format : str
        Name of the format it was read from.
    about : dict
        Metadata of most formats: ICC profile, EXIF and XMP as bytes, resolution in pixels an inch.
    notes : list of str
        What could not be read unchanged.
    own : Any
        Data that only the file's own format understands.
    only_own : list of str
        Names of the parts of `own` that other formats leave behind.
    orientation : int
        How the pixels must be rotated for display, as numbered by TIFF and EXIF; 1 is upright.
    premultiplied : bool
        Whether the colors are multiplied by opacity.
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
    """Notes on metadata that a format of this name cannot hold."""
    missing = set(image_file.about) - kept
    if image_file.format != name:
        missing |= set(image_file.only_own)
    if not missing:
        return []
    return [f"{target.suffix} does not keep {', '.join(sorted(missing))}: left behind"]
