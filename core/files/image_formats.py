# SPDX-License-Identifier: GPL-3.0-or-later
"""The image formats: the values that each holds, and how it is read."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import blocks
from ..errors import ShockError
from ..texture.painted_gain import gains_of
from .formats.image.exr import read_exr, write_exr
from .formats.image.image_file import ImageFile, lost
from .formats.image.pillow import read_pillow, write_bmp, write_jpeg, write_png, write_webp
from .formats.image.second_look import check_brightness, is_read_by_pillow
from .formats.image.tiff import read_tiff, write_tiff
from .formats.image.upright import make_upright
from .output import Options
from .reading import check_source, reading, reading_back

Pixels = npt.NDArray[Any]
ARRAY = ".npy"


class _Format(NamedTuple):
    """How an image format is read and written, and which values it holds."""

    read: Callable[[Path], ImageFile]
    write: Callable[[Path, ImageFile, Pixels], list[str]]
    types: Collection[str]
    channels: Collection[int]

    def holds(self, pixels: Pixels) -> bool:
        """Whether the format holds the pixels without conversion."""
        return pixels.dtype.name in self.types and channels(pixels) in self.channels


def channels(pixels: Pixels) -> int:
    """Count the channels of an image."""
    return pixels.shape[2] if pixels.ndim == 3 else 1


def _map_array(path: Path) -> ImageFile:
    pixels = np.load(path, mmap_mode="c")  # never written; kernels take writable arrays as any
    if not isinstance(pixels, np.ndarray):
        raise ShockError(f"{path} is an archive of arrays; save one of them as .npy.")
    return ImageFile(pixels, "NumPy")


def _flush_array(path: Path, image_file: ImageFile, pixels: Pixels) -> list[str]:
    return lost(image_file, path, set())  # the pixels are mapped to the file


_TYPES = ("uint8", "uint16", "float16", "float32", "float64")
_ANY = range(1, 1 << 16)
_JPEG = _Format(read_pillow, write_jpeg, ("uint8",), (1, 3))
_TIFF = _Format(read_tiff, write_tiff, ("uint8", "uint16", "float32", "float64"), _ANY)
FORMATS = {
    ".png": _Format(read_pillow, write_png, ("uint8", "uint16"), (1, 2, 3, 4)),
    ".jpg": _JPEG,
    ".jpeg": _JPEG,
    ".tif": _TIFF,
    ".tiff": _TIFF,
    ".exr": _Format(read_exr, write_exr, ("float16", "float32"), (1, 3, 4)),
    ".bmp": _Format(read_pillow, write_bmp, ("uint8",), (1, 3, 4)),
    ".webp": _Format(read_pillow, write_webp, ("uint8",), (3, 4)),
    ARRAY: _Format(_map_array, _flush_array, _TYPES, range(1, sys.maxsize)),
}
_LOSSY = (".jpg", ".jpeg")
_LONGEST = {**dict.fromkeys(_LOSSY, 65500), ".webp": 16383}  # longest sides in pixels

_ROWS = 256


def image_size(path: str | Path, any_size: bool = False, upright: bool = True) -> tuple[int, int]:
    """Return height and width of an image file."""
    height, width = read_image(Path(path), any_size, upright).pixels.shape[:2]
    return height, width


def read_image(path: Path, any_size: bool, upright: bool = True) -> ImageFile:
    """Read an image file; its pixels keep their type. `upright` rotates them for display."""
    check_source(path, FORMATS)
    with reading(path, any_size):
        image_file = FORMATS[path.suffix.lower()].read(path)
        check_kind(path, image_file.pixels)
        if not is_read_by_pillow(path, image_file.pixels):  # Pillow would be asked
            check_brightness(path, image_file, image_file.pixels)
    if upright:
        make_upright(image_file)
    pixels = image_file.pixels
    image_file.pixels = np.ascontiguousarray(pixels, dtype=pixels.dtype.newbyteorder("="))
    return image_file


def check_kind(path: Path, pixels: Any) -> None:
    """Refuse an array that is not an image, or has a type that no image has."""
    if pixels.dtype.name not in _TYPES:
        raise ShockError(
            f"{path} holds values of type {pixels.dtype}; save it with 8 or 16 bits, or as floats."
        )
    if pixels.ndim not in (2, 3) or 0 in pixels.shape:
        raise ShockError(f"{path} has the shape {pixels.shape}; give (h, w) or (h, w, channels).")


def without_plain_opacity(ending: str, pixels: Pixels) -> Pixels:
    """Drop opacity that is full everywhere, if the format's encoder drops it, too."""
    is_plain = ending == ".webp" and channels(pixels) == 4 and (pixels[..., 3] == 255).all()
    return np.ascontiguousarray(pixels[..., :3]) if is_plain else pixels


def read_back(path: Path, pixels: Pixels) -> None:
    """Check that a file that was just written holds these pixels."""
    with reading_back(path):
        found = FORMATS[path.suffix.lower()].read(path).pixels
        if (found.shape, found.dtype) != (pixels.shape, pixels.dtype):
            raise ValueError(f"{found.shape} {found.dtype} in place of what was written")
        if path.suffix.lower() not in _LOSSY and count_changed(pixels, found):
            raise ValueError("other pixels")


def check_format(source: Path, ending: str, pixels: Any, times: int = 1) -> None:
    """Refuse a format that cannot hold the pixels of `source` without conversion.

    They will be written `times` as high and wide.
    """
    side = times * max(pixels.shape[:2])
    if side > _LONGEST.get(ending, side):
        raise ShockError(
            f"{source}: {ending} cannot hold {side} pixels side by side; write .png or .tif."
        )
    if FORMATS[ending].holds(pixels):
        return
    fitting = [name for name, other in FORMATS.items() if other.holds(pixels)]
    raise ShockError(
        f"{source}: {ending} cannot hold {channels(pixels)} channels of {pixels.dtype}; write"
        f" one of {', '.join(fitting)}."
    )


def count_changed(old: Pixels, new: Pixels) -> int:
    """Count the pixels that differ."""
    # In bands of rows, so that no array as large as the image is made.
    changed = 0
    for band in blocks(len(old), _ROWS):
        differs = old[band] != new[band]
        changed += int(np.count_nonzero(differs.any(axis=2) if differs.ndim == 3 else differs))
    return changed


def read_beside(options: Options, upright: bool = True) -> dict[str, Pixels]:
    """Read a filter's further images, if named: mask, guide and gains."""
    words = {}
    if options.mask is not None:
        weights = read_grays(Path(options.mask), "mask", options.any_size, upright)
        words["mask"] = 1.0 - weights if options.invert_mask else weights
    if options.guide is not None:
        words["guide"] = read_pixels(options.guide, options.any_size, upright)
    if options.gain_map is not None:
        grays = read_grays(Path(options.gain_map), "gain map", options.any_size, upright)
        words["gain"] = gains_of(grays, options.gain)
    return words


def read_pixels(path: str | Path, any_size: bool, upright: bool = True) -> Pixels:
    """Read an image file; float32 in place of float16."""
    pixels = read_image(Path(path), any_size, upright).pixels
    return pixels.astype(np.float32) if pixels.dtype == np.float16 else pixels


def read_grays(path: Path, what: str, any_size: bool, upright: bool = True) -> Pixels:
    """Read a gray image file, from 0 to 1; `what` names its contents for people."""
    grays = read_image(path, any_size, upright).pixels
    if grays.ndim == 3 and grays.shape[2] == 1:
        grays = grays[..., 0]
    if grays.ndim != 2:
        raise ShockError(f"{path}: the {what} has colors or opacity; save it as a gray image.")
    return grays / np.float64(np.iinfo(grays.dtype).max) if grays.dtype.kind == "u" else grays
