# SPDX-License-Identifier: GPL-3.0-or-later
"""A check whether other programs see a picture as we do: equally bright, before and after a filter.

Formats leave the meaning of values to the reader: which one is white, whether they are luminance
and chroma or indices of a palette, whether opacity is multiplied into colors. A mistake there makes
a picture dark or colored, and reading it back with the same code does not show it. So libtiff reads
TIFF files, and Pillow others, and both results are compared.
"""

from __future__ import annotations

import io
import math
import struct
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ....errors import ShockError
from ...reading import needed
from .image_file import ImageFile
from .pillow import opened
from .tiff import is_unstated
from .tiff_sample import sample_tiff

_MOST = 1 << 28  # values to compare
_BITS, _COMPRESSION = 258, 259
_PLAIN = 1  # for other values Pillow asks libtiff, too, which prints what it does not know
_COMPARED = 1 << 22
_SLACK, _SHARE = 0.02, 0.1
"""Differences that decoders may have, relative to white and to the brightness itself."""

_LOSSY_SLACK = 0.1
_TIFFS, _LOSSY = (".tif", ".tiff"), (".jpg", ".jpeg")
_OTHERS = (".png", ".bmp", ".webp", *_LOSSY)
_KNOWN = (1, 5, 7, 8, 32773, 32946, 34925, 50000, 50001)
"""Compressions of TIFF that libtiff decodes; for others it returns black."""

_UNREADABLE = (
    OSError, ValueError, SyntaxError, TypeError, KeyError, IndexError, AttributeError, struct.error,
)  # fmt: skip
"""What Pillow raises for files that it does not know."""

Means = npt.NDArray[np.float64]


def check_brightness(path: Path, image_file: ImageFile, pixels: Any) -> None:
    """Raise an error if another reader sees a file much brighter or darker than we do.

    Files that it cannot read pass, and so do floats.

    Parameters
    ----------
    path : Path
        A file that was just read or written.
    image_file : ImageFile
        The result of reading it.
    pixels : (h, w) or (h, w, c) array, or an object that reads windows of one
        The pixels that were read or written, as stored: not rotated.

    Raises
    ------
    ShockError
        If the readers differ by more than decoders may.
    """
    ending = path.suffix.lower()
    if pixels.dtype.kind != "u" or 0 in pixels.shape:
        return
    if ending in _TIFFS:
        found = _seen_by_libtiff(path, image_file, pixels)
    elif ending in _OTHERS and math.prod(pixels.shape) <= _MOST:
        found = _seen_by_pillow(path, pixels)
    else:
        return
    if found is None:
        return
    possible, theirs = found
    slack = (_LOSSY_SLACK if ending in _LOSSY else _SLACK) + _SHARE * theirs
    if all((abs(ours - theirs) > slack).any() for ours in possible):
        raise ShockError(
            f"{path.name}: its mean brightness is {_told(possible[0])} here and {_told(theirs)} in"
            " other programs (1 is white). Nothing was written; save the picture in another"
            " format. If the file is not damaged, report this, since Shock Filter should know this"
            " kind of file."
        )


def is_read_by_pillow(path: Path, pixels: Any) -> bool:
    """Whether the pixels of a file came from the reader that would check it."""
    return path.suffix.lower() in _OTHERS and pixels.dtype == np.uint8


def _told(means: Means) -> str:
    return ", ".join(f"{mean:.3f}" for mean in means)


def _seen_by_libtiff(
    path: Path, image_file: ImageFile, pixels: Any
) -> tuple[list[Means], Means] | None:
    """Return possible means of some parts of a file, and those that libtiff finds."""
    sample = sample_tiff(path, _KNOWN)
    if sample is None:
        return None
    data, windows = sample
    try:
        shown = needed("imagecodecs", path).tiff_decode(data, asrgb=True)
    except (RuntimeError, ValueError, IndexError):  # unknown to libtiff
        shown = _odd_depth(data)
    if shown is None:
        return None
    high = len(shown) // len(windows)
    step = max(shown.shape[0] * shown.shape[1] // _COMPARED, 1)  # rows
    ours = np.concatenate([_listed(pixels[window][::step]) for window in windows])
    seen = [
        _listed(
            shown[high * number :][: rows.stop - rows.start : step, : columns.stop - columns.start]
        )
        for number, (rows, columns) in enumerate(windows)
    ]
    is_own = image_file.format == "TIFF"
    is_gray = ours.shape[1] < 3 or (is_own and image_file.own["photometric"] is not None)
    colors = 1 if is_gray else 3
    possible = _possible(ours, colors)
    values = np.concatenate(seen)
    if ours.shape[1] == 4 and not is_gray:  # libtiff may leave out opacity of gray
        is_stated = not (is_own and is_unstated(image_file))
        possible = possible[1:] if is_stated else possible[:1]
        if is_stated:  # premultiplied colors may exceed their opacity
            values[:, :3] = np.minimum(values[:, :3], values[:, 3:])
    return possible, _flat(values, colors)


def _odd_depth(data: bytes) -> npt.NDArray[np.uint16] | None:
    """Return gray values of 9 to 15 bits as Pillow reads them, scaled to 16 bits."""
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(data), formats=("TIFF",)) as image:
                tags: Any = getattr(image, "tag_v2", {})
                bits = tags.get(_BITS, (16,))[0]
                if image.mode != "I;16" or not 8 < bits < 16 or tags.get(_COMPRESSION) != _PLAIN:
                    return None
                white = (1 << bits) - 1
                return (np.asarray(image) * (65535.0 / white)).astype(np.uint16)
    except _UNREADABLE:
        return None


def _seen_by_pillow(path: Path, pixels: npt.NDArray[Any]) -> tuple[list[Means], Means] | None:
    """Return possible means of a file, and those of its largest picture in Pillow."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with opened(path) as image:
                # Pillow takes a transparent color of fewer than 8 bits for one of 8 bits.
                is_gray = image.mode in ("1", "L") and "transparency" in image.info
                is_plain = image.mode in ("L", "RGB", "RGBA", "I;16")
                plain = image if is_plain else image.convert("L" if is_gray else "RGBA")
                shown = np.asarray(plain)
    except _UNREADABLE:
        return None
    step = max(math.isqrt(pixels.shape[0] * pixels.shape[1] // _COMPARED), 1)
    ours, theirs = (_listed(each[::step, ::step]) for each in (pixels, shown))
    colors = 1 if ours.shape[1] < 3 else 3
    if theirs.shape[1] == 1:  # Pillow does not know about opacity, if there is any
        return [_flat(ours, colors)], _flat(theirs, 1)
    return _possible(ours, colors)[-1:], _possible(theirs, 3)[-1][:colors]


def _listed(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return an array of pixels by channels."""
    channels = values.shape[2] if values.ndim == 3 else 1
    return values.reshape(-1, channels)


def _possible(values: npt.NDArray[Any], colors: int) -> list[Means]:
    """Return the mean of each color, and that over black if there is opacity."""
    flat = _flat(values, colors)
    if values.shape[1] == colors:
        return [flat]
    white = np.iinfo(values.dtype).max
    opacity = values[:, colors].astype(np.float32) / white
    on_black = [(values[:, each] * opacity).mean(dtype=np.float64) for each in range(colors)]
    return [flat, np.array(on_black) / white]


def _flat(values: npt.NDArray[Any], colors: int) -> Means:
    means = [values[:, each].mean(dtype=np.float64) for each in range(colors)]
    return np.array(means) / np.iinfo(values.dtype).max
