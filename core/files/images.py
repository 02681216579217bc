# SPDX-License-Identifier: GPL-3.0-or-later
"""Images on disk, outside Blender.

Values keep their type: 16 bits stay 16 bits, and a format that cannot hold them is refused.
Arrays (.npy) are mapped from disk and never loaded as a whole.
"""

from __future__ import annotations

import inspect
import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..base.progress import reporting
from ..errors import ShockError
from ..repair.picture import repeated
from .formats.array.zarr import ENDING as ZARR
from .formats.image.image_file import ImageFile
from .formats.image.second_look import check_brightness
from .formats.image.tiff import claimed_size
from .formats.image.upright import fit_opacity
from .image_formats import (
    ARRAY,
    FORMATS,
    Pixels,
    channels,
    check_format,
    count_changed,
    read_back,
    read_beside,
    read_image,
    read_pixels,
    without_plain_opacity,
)
from .output import DEFAULTS, Options, Outcome, check_free, staged
from .reading import check_source, check_target, reading, writing

TIFFS = (".tif", ".tiff")

_HALF = np.finfo(np.float16).max

BIG = 1 << 28
"""Bytes of pixels above which TIFF files are filtered chunk by chunk."""


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
        `registry.Filter.function`. A parameter ``out`` receives the array for the result. It is
        called with float32 in place of float16.
    source, target : path
        PNG, JPEG, TIFF, EXR, BMP, WebP or NumPy (.npy) files. `target` appears when it is
        complete; its format must hold the values, as none is converted. Zarr arrays and tiled
        TIFF files may be larger than memory.
    options : Options
        Masks, and whether to replace files.
    times : int
        How many times higher and wider the function's result is.
    upright : bool
        Rotate pictures by their orientation tags. Texture coordinates refer to pixels as they are
        stored.

    Returns
    -------
    Outcome
        Counts of pixels, and notes on what was lost.

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
    check_source(source, FORMATS)
    check_target(target, FORMATS)

    def fill(pixels: Pixels, result: Pixels) -> None:
        with reporting(options.progress):
            if pixels.dtype == np.float16:
                found = function(pixels.astype(np.float32), **words)
                result[...] = found.clip(-_HALF, _HALF)  # beyond lies infinity
            elif fills:
                function(pixels, **words, out=result)
            else:
                result[...] = function(pixels, **words)

    with staged(target, options.overwrite) as path:
        # Arrays mapped from files must be closed before these can be replaced.
        return _filter(source, path, fill, options.any_size, times, upright)


def filter_tile_file(
    function: Callable[..., Pixels],
    source: str | Path,
    target: str | Path,
    options: Options,
    picture: Path,
    axes: str,
) -> Outcome:
    """Filter an image file as `filter_image_file` does, and draw how the result tiles.

    Parameters
    ----------
    function, source, target, options
        As in `filter_image_file`.
    picture : path
        Another image, of the result three times along each joined axis.
    axes : {"both", "x", "y"}
        As `TileSettings.axes`.
    """
    check_target(picture, FORMATS)
    check_free(picture, options.overwrite)
    outcome = filter_image_file(function, source, target, options)
    try:
        pixels = read_pixels(target, options.any_size)
        write_image_file(picture, repeated(pixels, axes), options.overwrite)
    except (ShockError, OSError) as error:
        note = f"the picture was not written: {error}"
        return replace(outcome, notes=(*outcome.notes, note))
    return outcome


def is_big(source: Path, target: Path) -> bool:
    """Whether an image is filtered chunk by chunk because it may not fit into memory."""
    endings = source.suffix.lower(), target.suffix.lower()
    if ZARR in endings:
        return True
    if not set(endings) <= set(TIFFS):
        return False
    check_source(source, FORMATS)
    with reading(source):
        return claimed_size(source) > BIG


def write_image_file(target: Path, pixels: Pixels, overwrite: bool) -> None:
    """Write pixels without a source file, in the format of the target's ending."""
    write_image_files({target: pixels}, overwrite)


def write_image_files(images: Mapping[Path, Pixels], overwrite: bool) -> None:
    """Write pixels into files of one folder and of one format; all appear, or none.

    Parameters
    ----------
    images : mapping of path to array
        Pixels by path. All files go to the folder of the first path.
    overwrite : bool
    """
    first = next(iter(images))
    ready = {}
    for target, pixels in images.items():
        check_target(target, FORMATS)
        ending = target.suffix.lower()
        if ending != ARRAY:
            check_format(target, ending, pixels)
        ready[target.name] = without_plain_opacity(ending, pixels)
    with staged(first, overwrite, own=ready) as stage:
        for name, pixels in ready.items():
            path = stage if name == first.name else stage.with_name(name)
            if path.suffix.lower() == ARRAY:
                np.save(path, pixels)
            else:
                FORMATS[path.suffix.lower()].write(path, ImageFile(pixels, ""), pixels)
            read_back(path, pixels)


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
    new = _new_array if ending == ARRAY else _empty
    result = new(path, shape, pixels.dtype)
    function(pixels, result)
    total = result.shape[0] * result.shape[1]
    changed = count_changed(pixels, result) if times == 1 else total
    notes: list[str] = []
    if not changed and ending == source.suffix.lower() != ARRAY:
        shutil.copyfile(source, path)
    else:
        flat = result[..., 0] if channels(result) == 1 and result.ndim == 3 else result
        flat = without_plain_opacity(ending, flat)
        with writing(path):
            notes = [*image_file.notes, *FORMATS[ending].write(path, image_file, flat)]
        read_back(path, result if ending == ARRAY else flat)
        check_brightness(path, image_file, flat)
    return Outcome(total, changed, tuple(notes), "changed {changed} of {total} pixels")


def _empty(_path: Path, shape: tuple[int, ...], kind: np.dtype) -> Pixels:
    return np.empty(shape, kind)


def _new_array(path: Path, shape: tuple[int, ...], kind: np.dtype) -> Pixels:
    """Map an array to a new file whose disk space is certainly allocated.

    The system kills a process that writes to mapped pages for which the disk has no space.
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
