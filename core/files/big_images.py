# SPDX-License-Identifier: GPL-3.0-or-later
"""Images on disk that may be larger than memory: Zarr arrays and tiled TIFF files.

dask reads, filters and writes them chunk by chunk, on threads of this process, or on the cluster
of a client that was made before.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base.parallel import thread_count
from ..base.progress import ask, phase, reporting
from ..color.chunked import Dask, counting_reruns
from ..errors import ShockError
from .formats.array.zarr import ENDING, create_zarr, create_zarr_like, open_zarr
from .formats.array.zarr_metadata import is_zarr
from .formats.image.image_file import ImageFile
from .formats.image.second_look import check_brightness
from .formats.image.tiff import TILE, open_tiff_tiles, write_tiff_tiles
from .formats.image.upright import make_upright
from .image_formats import check_format, check_kind, read_image
from .output import Options, Outcome, staged, staged_folder
from .reading import check_ending, check_source, needed, reading, reading_back
from .staging import temporary_folder, tidy

_TIFFS = (".tif", ".tiff")
_ENDINGS = (ENDING, *_TIFFS)
_SIDE = 2048
"""Side of the chunks that are filtered at once, in pixels, roughly; wide chunks are lower."""

_PAUSE = 0.1  # seconds between queries of a cluster


def filter_big_image(
    function: Callable[..., Dask],
    source: Path,
    target: Path,
    options: Options,
    *,
    times: int = 1,
    upright: bool = True,
) -> Outcome:
    """Like `filter_image_file`, for Zarr arrays and TIFF files of any size."""
    check_ending(target, _ENDINGS, "pictures of any size are not written to such files")
    dask_array = needed("dask.array", source, "cluster")
    if target.is_dir() and not is_zarr(target):
        raise ShockError(f"{target} is a folder of other files; choose another output.")
    image_file = _open(source, options.any_size)
    if target.suffix.lower() in _TIFFS:
        check_format(source, target.suffix.lower(), image_file.pixels)
    with reporting(options.progress), counting_reruns() as counts:
        pixels = _chunks(source, image_file, upright)
        words = _beside(options, upright)
        floats = pixels.astype(np.float32) if pixels.dtype == np.float16 else pixels
        result = dask_array.asarray(function(floats, **words)).astype(pixels.dtype)
        wanted = [dask_array.asarray(sum(each.sum() for each in counts))]
        if times == 1:
            differs = result != pixels
            wanted.append((differs.any(axis=2) if differs.ndim == 3 else differs).sum())
        write = _write_zarr if target.suffix.lower() == ENDING else _write_tiff
        (reruns, *changed), notes = write(target, options.overwrite, image_file, result, wanted)
    notes.append(
        f"filtered in {math.prod(result.numblocks)} chunks; ran again, as flow-lines led farther"
        f" than expected: {reruns}"
    )
    total = math.prod(result.shape[:2])
    done = "changed {changed} of {total} pixels"
    return Outcome(total, int(changed[0]) if changed else total, tuple(notes), done)


def _write_zarr(
    target: Path, overwrite: bool, image_file: ImageFile, result: Dask, wanted: Sequence[Dask]
) -> tuple[Sequence[Any], list[str]]:
    # Writes the result; returns the other wanted values, and notes.
    with staged_folder(target, overwrite) as stage:
        notes = list(image_file.notes)
        if image_file.format == "Zarr":
            array, left = create_zarr_like(stage, image_file, result.shape)
            notes += left
        else:
            array = _create(stage, result)
        found = _store(array, result, wanted)
    if image_file.about:
        notes.append(f"{ENDING} does not keep {', '.join(image_file.about)}: left behind")
    return found, notes


def _write_tiff(
    target: Path, overwrite: bool, image_file: ImageFile, result: Dask, wanted: Sequence[Dask]
) -> tuple[Sequence[Any], list[str]]:
    # Via a Zarr array, as tiles of the file are in order, while they are computed in any order.
    result = result[..., 0] if result.shape[2:] == (1,) else result
    with contextlib.ExitStack() as stack:
        stage = stack.enter_context(staged(target, overwrite))
        spool = temporary_folder(target.absolute().parent, stack) / f"spool{ENDING}"
        with phase(0.0, 0.9, "Filtering"):
            pixels = _create(spool, result)
            found = _store(pixels, result, wanted)
        with phase(0.9, 1.0, "Writing"):
            tiles = _tiles(pixels)
            notes = write_tiff_tiles(stage, image_file, result.shape, result.dtype, tiles)
            _read_back(stage, pixels)
            check_brightness(stage, image_file, pixels)
    return found, [*image_file.notes, *notes]


def _read_back(path: Path, expected: Any) -> None:
    # Checks that a TIFF file that was just written holds the computed pixels.
    with reading_back(path):
        written = open_tiff_tiles(path)
        if written is None or written.pixels.shape != expected.shape:
            raise ValueError("another shape")
        for top in range(0, expected.shape[0], TILE):
            rows = slice(top, min(top + TILE, expected.shape[0])), slice(0, expected.shape[1])
            if not np.array_equal(written.pixels[rows], expected[rows]):
                raise ValueError("other pixels")


def _open(path: Path, any_size: bool) -> ImageFile:
    # With pixels that are read on demand, if the format allows it.
    ending = path.suffix.lower()
    tidy(path.parent)  # a killed run may have moved a folder away
    if ending == ENDING:
        image_file = open_zarr(path, any_size)
        check_kind(path, image_file.pixels)
        return image_file
    if ending in _TIFFS:
        check_source(path, _TIFFS)
        with reading(path, any_size):
            tiled = open_tiff_tiles(path)
            if tiled is not None:
                check_kind(path, tiled.pixels)
                check_brightness(path, tiled, tiled.pixels)
                return tiled
    return read_image(path, any_size, upright=False)


class _Stored:
    """Pixels on disk, read by windows, here or in another process."""

    def __init__(self, path: Path, pixels: Any) -> None:
        self.path, self.pixels = path, pixels
        self.shape, self.ndim = pixels.shape, pixels.ndim
        self.dtype = pixels.dtype.newbyteorder("=")

    def __getitem__(self, window: tuple[slice, ...]) -> npt.NDArray[Any]:
        with reading(self.path):
            return np.asarray(self.pixels[window], dtype=self.dtype)


def _chunks(path: Path, image_file: ImageFile, upright: bool) -> Dask:
    # Chunks are multiples of those in the file, and rotated with the picture.
    import dask.array

    pixels = image_file.pixels
    high, wide, *_ = _chunks_on_disk(pixels) or (_SIDE, _SIDE)
    wide *= max(round(_SIDE / wide), 1)
    high *= max(round(_SIDE * _SIDE / wide / high), 1)
    chunks = (high, wide, *[-1] * (pixels.ndim - 2))
    image_file.pixels = dask.array.from_array(_Stored(path, pixels), chunks=chunks)
    if upright:
        make_upright(image_file)
    return image_file.pixels


def _chunks_on_disk(pixels: Any) -> tuple[int, ...] | None:
    return getattr(pixels, "shards", None) or getattr(pixels, "chunks", None)


def _beside(options: Options, upright: bool) -> dict[str, Dask]:
    # The mask and the guide, if named.
    words = {}
    if options.mask is not None:
        weights = _grays(Path(options.mask), options.any_size, upright)
        words["mask"] = 1.0 - weights if options.invert_mask else weights
    if options.guide is not None:
        guide = _lazy(Path(options.guide), options.any_size, upright)
        words["guide"] = guide.astype(np.float32) if guide.dtype == np.float16 else guide
    return words


def _lazy(path: Path, any_size: bool, upright: bool) -> Dask:
    return _chunks(path, _open(path, any_size), upright)


def _grays(path: Path, any_size: bool, upright: bool) -> Dask:
    grays = _lazy(path, any_size, upright)
    if grays.ndim == 3 and grays.shape[2] == 1:
        grays = grays[..., 0]
    if grays.ndim != 2:
        raise ShockError(f"{path}: the mask has colors or opacity; save it as a gray image.")
    return grays / np.float64(np.iinfo(grays.dtype).max) if grays.dtype.kind == "u" else grays


def _create(path: Path, result: Dask) -> Any:
    # An array whose chunks have a quarter of the sides of those that are filtered at once.
    sides = (n // 4 if n % 4 == 0 else n for n in result.chunksize[:2])
    chunks = (*sides, *result.shape[2:])[: result.ndim]
    return create_zarr(path, result.shape, result.dtype, chunks)


def _store(array: Any, result: Dask, wanted: Sequence[Dask]) -> Sequence[Any]:
    # Writes the result to a Zarr array and computes the other wanted values at the same time.
    import dask.array

    stored = dask.array.store(result, array, lock=False, compute=False)
    return _computed([stored, *wanted])[1:]


def _computed(wanted: Sequence[Any]) -> Sequence[Any]:
    # Computes all together; can be cancelled.
    import dask
    from dask.callbacks import Callback

    client = _cluster()
    if client is None:

        def count(_key: Any, _value: Any, _graph: Any, state: Any, _worker: Any) -> None:
            left = sum(len(state[name]) for name in ("waiting", "ready", "running"))
            ask(len(state["finished"]) / (len(state["finished"]) + left))

        # We wait for a pool of our own: no thread writes any more once this function ends.
        threads = dask.config.get("num_workers", None) or thread_count()
        with ThreadPoolExecutor(threads) as pool, Callback(posttask=count):
            return dask.compute(*wanted, scheduler="threads", pool=pool)
    futures = client.compute(list(wanted))
    try:
        while not all(future.done() for future in futures):
            ask()
            time.sleep(_PAUSE)
        return client.gather(futures)
    finally:
        client.cancel(futures)


def _cluster() -> Any:
    # The client of a cluster, if there is a current one.
    try:
        from distributed import get_client

        return get_client()
    except (ImportError, ValueError):
        return None


def _tiles(pixels: Any) -> Iterator[npt.NDArray[Any]]:
    # Holds one row of tiles in memory at a time.
    height, width = pixels.shape[:2]
    for top in range(0, height, TILE):
        ask(top / height)
        band = np.asarray(pixels[top : top + TILE])
        for left in range(0, width, TILE):
            tile = np.zeros((TILE, TILE, *band.shape[2:]), band.dtype)
            part = band[:, left : left + TILE]
            tile[: part.shape[0], : part.shape[1]] = part
            yield tile
