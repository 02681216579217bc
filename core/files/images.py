# SPDX-License-Identifier: GPL-3.0-or-later
"""Images on disk, outside Blender.

Values keep their type: 16 bits stay 16 bits, and a format that cannot hold them is refused.
Arrays (.npy) are mapped from disk and never loaded as a whole.
"""

from __future__ import annotations

import inspect
import os
import shutil
import sys
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import blocks
from ..base.progress import reporting
from ..errors import ShockError
from ..filters.painted_gain import gains_of
from .formats.exr import read_exr, write_exr
from .formats.pillow import read_pillow, write_bmp, write_jpeg, write_png, write_webp
from .formats.tiff import claimed_size, read_tiff, write_tiff
from .formats.zarr import ENDING as ZARR
from .image_file import ImageFile, lost
from .output import DEFAULTS, Options, Outcome, staged
from .reading import check_source, check_target, reading, reading_back, writing
from .second_look import check_brightness, is_read_by_pillow
from .upright import fit_opacity, make_upright

Pixels = npt.NDArray[Any]
_ARRAY = ".npy"


class _Format(NamedTuple):
    """How an image format is read and written, and which values it holds."""

    read: Callable[[Path], ImageFile]
    write: Callable[[Path, ImageFile, Pixels], list[str]]
    types: Collection[str]
    channels: Collection[int]

    def holds(self, pixels: Pixels) -> bool:
        """Whether the pixels fit as they are."""
        return pixels.dtype.name in self.types and _channels(pixels) in self.channels


def _channels(pixels: Pixels) -> int:
    return pixels.shape[2] if pixels.ndim == 3 else 1


def _map_array(path: Path) -> ImageFile:
    pixels = np.load(path, mmap_mode="r")
    if not isinstance(pixels, np.ndarray):
        raise ShockError(f"{path} is an archive of arrays; save one of them as .npy.")
    return ImageFile(pixels, "NumPy")


def _flush_array(path: Path, image_file: ImageFile, pixels: Pixels) -> list[str]:
    return lost(image_file, path, set())  # the pixels are mapped to the file


_TYPES = ("uint8", "uint16", "float16", "float32", "float64")
_ANY = range(1, 1 << 16)
_JPEG = _Format(read_pillow, write_jpeg, ("uint8",), (1, 3))
_TIFF = _Format(read_tiff, write_tiff, ("uint8", "uint16", "float32", "float64"), _ANY)
_FORMATS = {
    ".png": _Format(read_pillow, write_png, ("uint8", "uint16"), (1, 2, 3, 4)),
    ".jpg": _JPEG,
    ".jpeg": _JPEG,
    ".tif": _TIFF,
    ".tiff": _TIFF,
    ".exr": _Format(read_exr, write_exr, ("float16", "float32"), (1, 3, 4)),
    ".bmp": _Format(read_pillow, write_bmp, ("uint8",), (1, 3, 4)),
    ".webp": _Format(read_pillow, write_webp, ("uint8",), (3, 4)),
    _ARRAY: _Format(_map_array, _flush_array, _TYPES, range(1, sys.maxsize)),
}
_LOSSY = (".jpg", ".jpeg")
_LONGEST = {**dict.fromkeys(_LOSSY, 65500), ".webp": 16383}  # sides in pixels
_TIFFS = (".tif", ".tiff")
BIG = 1 << 28
"""Bytes of pixels from which on TIFF files are filtered chunk by chunk."""

_ROWS = 256


def filter_image_file(
    function: Callable[..., Pixels],
    source: str | Path,
    target: str | Path,
    options: Options = DEFAULTS,
    *,
    times: int = 1,
    upright: bool = True,
) -> Outcome:
    """Filter an image file and write it to another.

    Parameters
    ----------
    function : callable
        ``function(pixels, mask=None, guide=None)`` returns an array like the pixels; see
        `registry.Filter.function`. If it has a parameter ``out``, it is given the array for the
        result. It gets float32 in place of float16.
    source, target : path
        PNG, JPEG, TIFF, EXR, BMP, WebP or NumPy (.npy) files. `target` appears when it is
        complete; its format must hold the values as they are, none is converted. Zarr arrays and
        tiled TIFF files may be larger than memory.
    options : Options
        Masks, and whether to replace files.
    times : int
        How many times higher and wider the function's result is.
    upright : bool
        Turn pictures as their orientation tags say. Texture coordinates count on pixels as they
        are stored.

    Returns
    -------
    Outcome
        Counts of pixels, and notes on what did not survive.

    Raises
    ------
    ShockError
        If a file cannot be read or written, or as `function` does.
    """
    if is_big(Path(source), Path(target)):
        from .big_images import filter_big_image

        return filter_big_image(
            function, Path(source), Path(target), options, times=times, upright=upright
        )
    words = read_beside(options, upright)
    fills = "out" in inspect.signature(function).parameters
    source, target = Path(source), Path(target)
    check_source(source, _FORMATS)
    check_target(target, _FORMATS)

    def fill(pixels: Pixels, result: Pixels) -> None:
        with reporting(options.progress):
            if pixels.dtype == np.float16:
                result[...] = function(pixels.astype(np.float32), **words)
            elif fills:
                function(pixels, **words, out=result)
            else:
                result[...] = function(pixels, **words)

    with staged(target, options.overwrite) as path:
        # Arrays that are mapped from files must be gone before these can be replaced.
        return _filter(source, path, fill, options.any_size, times, upright)


def is_big(source: Path, target: Path) -> bool:
    """Whether an image is filtered chunk by chunk, as it may not fit into memory."""
    endings = source.suffix.lower(), target.suffix.lower()
    if ZARR in endings:
        return True
    if not set(endings) <= set(_TIFFS):
        return False
    check_source(source, _FORMATS)
    with reading(source):
        return claimed_size(source) > BIG


def write_image_file(target: Path, pixels: Pixels, overwrite: bool) -> None:
    """Write pixels that come from no file, in the format of the target's ending."""
    check_target(target, _FORMATS)
    ending = target.suffix.lower()
    if ending != _ARRAY:
        check_format(target, ending, pixels)
    pixels = _without_plain_opacity(ending, pixels)
    with staged(target, overwrite) as path:
        if ending == _ARRAY:
            np.save(path, pixels)
        else:
            _FORMATS[ending].write(path, ImageFile(pixels, ""), pixels)
        _read_back(path, pixels)


def image_size(path: str | Path, any_size: bool = False, upright: bool = True) -> tuple[int, int]:
    """Return height and width of an image file."""
    height, width = read_image(Path(path), any_size, upright).pixels.shape[:2]
    return height, width


def read_image(path: Path, any_size: bool, upright: bool = True) -> ImageFile:
    """Read an image file; its pixels keep their type. By default they are turned to be shown."""
    check_source(path, _FORMATS)
    with reading(path, any_size):
        image_file = _FORMATS[path.suffix.lower()].read(path)
        check_kind(path, image_file.pixels)
        if not is_read_by_pillow(path, image_file.pixels):  # which is who would be asked
            check_brightness(path, image_file, image_file.pixels)
    if upright:
        make_upright(image_file)
    pixels = image_file.pixels
    image_file.pixels = np.ascontiguousarray(pixels, dtype=pixels.dtype.newbyteorder("="))
    return image_file


def check_kind(path: Path, pixels: Any) -> None:
    """Refuse an array that is no image, or of a type that none has."""
    if pixels.dtype.name not in _TYPES:
        raise ShockError(
            f"{path} holds values of type {pixels.dtype}; save it with 8 or 16 bits, or as floats."
        )
    if pixels.ndim not in (2, 3) or 0 in pixels.shape:
        raise ShockError(f"{path} has the shape {pixels.shape}; give (h, w) or (h, w, channels).")


def _filter(
    source: Path,
    path: Path,
    function: Callable[[Pixels, Pixels], None],
    any_size: bool,
    times: int,
    upright: bool,
) -> Outcome:
    image_file = read_image(source, any_size, upright)
    ending = path.suffix.lower()
    check_format(source, ending, image_file.pixels, times)
    fit_opacity(image_file, ending)
    pixels = image_file.pixels
    shape = (times * pixels.shape[0], times * pixels.shape[1], *pixels.shape[2:])
    new = _new_array if ending == _ARRAY else _empty
    result = new(path, shape, pixels.dtype)
    function(pixels, result)
    total = result.shape[0] * result.shape[1]
    changed = _count_changed(pixels, result) if times == 1 else total
    notes: list[str] = []
    if not changed and ending == source.suffix.lower() != _ARRAY:
        shutil.copyfile(source, path)
    else:
        flat = result[..., 0] if _channels(result) == 1 and result.ndim == 3 else result
        flat = _without_plain_opacity(ending, flat)
        with writing(path):
            notes = [*image_file.notes, *_FORMATS[ending].write(path, image_file, flat)]
        _read_back(path, result if ending == _ARRAY else flat)
        check_brightness(path, image_file, flat)
    return Outcome(total, changed, tuple(notes), "changed {changed} of {total} pixels")


def _without_plain_opacity(ending: str, pixels: Pixels) -> Pixels:
    """Leave out opacity that is full everywhere, where a format's encoder does so, too."""
    is_plain = ending == ".webp" and _channels(pixels) == 4 and (pixels[..., 3] == 255).all()
    return np.ascontiguousarray(pixels[..., :3]) if is_plain else pixels


def _read_back(path: Path, pixels: Pixels) -> None:
    """Make sure that a file that was just written holds these pixels."""
    with reading_back(path):
        found = _FORMATS[path.suffix.lower()].read(path).pixels
        if (found.shape, found.dtype) != (pixels.shape, pixels.dtype):
            raise ValueError(f"{found.shape} {found.dtype} in place of what was written")
        if path.suffix.lower() not in _LOSSY and _count_changed(pixels, found):
            raise ValueError("other pixels")


def _empty(_path: Path, shape: tuple[int, ...], kind: np.dtype) -> Pixels:
    return np.empty(shape, kind)


def _new_array(path: Path, shape: tuple[int, ...], kind: np.dtype) -> Pixels:
    """Map an array to a new file, whose room on the disk is taken for certain.

    A process that writes to a mapped place for which the disk has no room is ended by the system.
    """
    result = np.lib.format.open_memmap(path, "w+", kind, shape)
    with path.open("r+b") as stream:
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(stream.fileno(), 0, path.stat().st_size)
        else:
            stream.seek(result.offset)
            for row in result:
                stream.write(bytes(row.nbytes))
    return result


def check_format(source: Path, ending: str, pixels: Any, times: int = 1) -> None:
    """Refuse a format that cannot hold pixels as they are; `source` is where they come from.

    They are to be written so many times higher and wider.
    """
    side = times * max(pixels.shape[:2])
    if side > _LONGEST.get(ending, side):
        raise ShockError(
            f"{source}: {ending} cannot hold {side} pixels side by side; write .png or .tif."
        )
    if _FORMATS[ending].holds(pixels):
        return
    fitting = [name for name, other in _FORMATS.items() if other.holds(pixels)]
    raise ShockError(
        f"{source}: {ending} cannot hold {_channels(pixels)} channels of {pixels.dtype}; write"
        f" one of {', '.join(fitting)}."
    )


def _count_changed(old: Pixels, new: Pixels) -> int:
    # In bands of rows, so that nothing as large as the image is made.
    changed = 0
    for band in blocks(len(old), _ROWS):
        differs = old[band] != new[band]
        changed += int(np.count_nonzero(differs.any(axis=2) if differs.ndim == 3 else differs))
    return changed


def read_beside(options: Options, upright: bool = True) -> dict[str, Pixels]:
    """Read what a filter is given by name beside the image: mask, guide and gains, if named."""
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
    """Read a gray image file, from 0 to 1; `what` is what it holds, for people."""
    grays = read_image(path, any_size, upright).pixels
    if grays.ndim == 3 and grays.shape[2] == 1:
        grays = grays[..., 0]
    if grays.ndim != 2:
        raise ShockError(f"{path}: the {what} has colors or opacity; save it as a gray image.")
    return grays / np.float64(np.iinfo(grays.dtype).max) if grays.dtype.kind == "u" else grays
