# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether another reader sees a TIFF file as we do: as bright, before and after a filter.

TIFF leaves to the reader what its values mean: which one is white, whether they are luminance and
chroma, whether white is 0. A mistake about that makes a picture dark or colored, and reading it
back by the same means shows nothing.
"""

from __future__ import annotations

import struct
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import ShockError

_MOST = 1 << 26  # values: a second or two
_SLACK, _SHARE = 0.02, 0.1
"""Differences that decoders may have, of white and of the brightness itself."""

_BITS = 258
_UNREADABLE = (
    OSError, ValueError, SyntaxError, TypeError, KeyError, IndexError, AttributeError, struct.error,
)  # fmt: skip
"""What Pillow raises at TIFF files that it does not know."""


def check_brightness(path: Path, pixels: npt.NDArray[Any], about: dict[str, Any]) -> None:
    """Refuse to go on if Pillow sees a TIFF file much brighter or darker than we do.

    Parameters
    ----------
    path : Path
        A TIFF file that was just read or written; what Pillow cannot read passes.
    pixels : (h, w) or (h, w, c) array
        What was read or written.
    about : dict
        Its `photometric` and `extrasamples`, as tifffile is told of them.

    Raises
    ------
    ShockError
        If both differ by more than decoders may.
    """
    # Pillow divides colors by opacity that was multiplied into them.
    is_plain = pixels.dtype.kind == "u" and 1 not in map(int, about.get("extrasamples") or ())
    if not is_plain or not 0 < pixels.size <= _MOST:
        return
    ours = _means(pixels) / np.iinfo(pixels.dtype).max
    if about.get("photometric") == "miniswhite":
        ours = 1.0 - ours
    theirs = _seen_by_pillow(path)
    if theirs is None:
        return
    if (abs(ours - theirs) > _SLACK + _SHARE * np.maximum(ours, theirs)).any():
        raise ShockError(
            f"{path.name}: its mean brightness is {_told(ours)} here and {_told(theirs)} in Pillow"
            " (1 is white). Nothing was written; save the picture as PNG, and report this, since"
            " Shock Filter should know this kind of TIFF."
        )


def _means(values: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """Return the mean of each color, without opacity."""
    colors = values.reshape(*values.shape[:2], -1)
    colors = colors[..., : 3 if colors.shape[2] >= 3 else 1]
    return np.array([colors[..., c].mean(dtype=np.float64) for c in range(colors.shape[2])])


def _told(means: npt.NDArray[np.float64]) -> str:
    return ", ".join(f"{mean:.3f}" for mean in means)


def _seen_by_pillow(path: Path) -> npt.NDArray[np.float64] | None:
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(path, formats=("TIFF",)) as image:
                if image.mode.startswith("I;16"):
                    tags: Any = getattr(image, "tag_v2", {})
                    bits = tags.get(_BITS, (16,))[0]
                    return _means(np.asarray(image)) / (2.0**bits - 1)
                if image.mode in ("I", "F"):
                    return None
                mode = "RGB" if image.mode in ("P", "RGB", "RGBA", "RGBX", "YCbCr") else "L"
                return _means(np.asarray(image.convert(mode))) / 255.0
    except _UNREADABLE:
        return None
