# SPDX-License-Identifier: GPL-3.0-or-later
"""What all image formats share: the picture that a file becomes, and what it says beside pixels."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy.typing as npt

ICC, RESOLUTION, EXIF, XMP = "ICC profile", "resolution", "EXIF", "XMP"


@dataclass
class ImageFile:
    """An image file in memory.

    Attributes
    ----------
    pixels : (h, w) or (h, w, c) array
        Two or four channels end with opacity.
    format : str
        Name of the format it was read from.
    about : dict
        What most formats know: ICC profile, EXIF and XMP as bytes, resolution as pixels an inch.
    notes : list of str
        What could not be taken from the file as it is.
    own : Any
        What only its own format understands.
    """

    pixels: npt.NDArray[Any]
    format: str
    about: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    own: Any = None


def lost(image_file: ImageFile, target: Path, kept: set[str]) -> list[str]:
    """A note on what a format cannot hold."""
    missing = sorted(set(image_file.about) - kept)
    return [f"{target.suffix} does not keep {', '.join(missing)}: left behind"] if missing else []
