# SPDX-License-Identifier: GPL-3.0-or-later
"""Images on disk that may be larger than memory: Zarr arrays and tiled TIFF files.

They are read, filtered and written chunk by chunk by dask, on whatever scheduler is current:
threads of this process, or the cluster of a client that was made before.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base.progress import ask, phase, reporting
from ..errors import ShockError
from ..filters.chunked import Dask, counting_reruns
from .formats.tiff import TILE, open_tiff_tiles, read_tiff, write_tiff_tiles
from .formats.zarr import ENDING, create_zarr, is_zarr, open_zarr
from .image_file import ImageFile
from .images import check_kind
from .output import Options, Outcome, staged, staged_folder, temporary_folder
from .reading import check_ending, check_source, needed, reading

_TIFFS = (".tif", ".tiff")
_ENDINGS = (ENDING, *_TIFFS)
_SIDE = 2048
"""About how many pixels the sides of chunks have that are filtered at once."""

_PAUSE = 0.1  # seconds between questions to a cluster


def filter_big_image(
    function: Callable[..., Dask],
    source: Path,
    target: Path,
    options: Options,
    *,
    times: int = 1,
) -> Outcome:
    """Do what `filter_image_file` does to Zarr arrays and tiled TIFF files of any size."""
    for path in (source, target):
        check_ending(path, _ENDINGS, "pictures of any size are not kept in such files")
    needed("dask.array", source, "cluster")
    if target.is_dir() and not is_zarr(target):
        raise ShockError(f"{target} is a folder of other files; choose another output.")
    image_file = _open(source, options.any_size)
    pixels = _chunks(image_file)
    words = _beside(options)
    with contextlib.ExitStack() as stack:
        stack.enter_context(reporting(options.progress))
        counts = stack.enter_context(counting_reruns())
        floats = pixels.astype(np.float32) if pixels.dtype == np.float16 else pixels
        result = function(floats, **words).astype(pixels.dtype)
        if target.suffix.lower() == ENDING:
            stage = stack.enter_context(staged_folder(target, options.overwrite))
            changed, reruns = _store(source, pixels, result, counts, stage, image_file)
            notes = list(image_file.notes)
            if image_file.about:
                notes.append(f"{ENDING} does not keep {', '.join(image_file.about)}: left behind")
        else:
            stage = stack.enter_context(staged(target, options.overwrite))
            spool = temporary_folder(target.absolute().parent, stack) / "spool.zarr"
            with phase(0.0, 0.9, "Filtering"):
                changed, reruns = _store(source, pixels, result, counts, spool, image_file)
            with phase(0.9, 1.0, "Writing"):
                tiles = _tiles(open_zarr(spool).pixels)
                notes = list(image_file.notes)
                notes += write_tiff_tiles(stage, image_file, result.shape, result.dtype, tiles)
    total = int(np.prod(result.shape[:2], dtype=np.int64))
    chunks = result.numblocks[0] * result.numblocks[1]
    notes.append(
        f"filtered in {chunks} chunks; ran again, as flow-lines led farther than expected: {reruns}"
    )
    done = "changed {changed} of {total} pixels"
    return Outcome(total, changed if times == 1 else total, tuple(notes), done)


def _open(path: Path, any_size: bool) -> ImageFile:
    # With pixels that are read when they are asked for; TIFF files without tiles are read now.
    if path.suffix.lower() == ENDING:
        image_file = open_zarr(path)
    else:
        check_source(path, _ENDINGS)
        with reading(path, any_size):
            image_file = open_tiff_tiles(path) or read_tiff(path)
    check_kind(path, image_file.pixels)
    return image_file


def _chunks(image_file: ImageFile) -> Dask:
    # Chunks are whole numbers of those in the file.
    import dask.array

    pixels = image_file.pixels
    stored: Any = getattr(pixels, "shards", None) or getattr(pixels, "chunks", (_SIDE, _SIDE))
    sides = [n * max(round(_SIDE / n), 1) for n in stored[:2]]
    array = dask.array.from_array(pixels, chunks=(*sides, *[-1] * (pixels.ndim - 2)))
    return array.astype(array.dtype.newbyteorder("="))


def _stored_chunks(result: Dask, image_file: ImageFile) -> tuple[int, ...]:
    # Those of a Zarr source, or else a quarter of what is filtered at once, along the sides.
    if image_file.format == "Zarr":
        return image_file.pixels.shards or image_file.pixels.chunks
    sides = (n // 4 if n % 4 == 0 else n for n in result.chunksize[:2])
    return (*sides, *result.shape[2:])


def _beside(options: Options) -> dict[str, Dask]:
    # Mask and guide, if named.
    words = {}
    if options.mask is not None:
        weights = _grays(Path(options.mask), options.any_size)
        words["mask"] = 1.0 - weights if options.invert_mask else weights
    if options.guide is not None:
        guide = _chunks(_open(Path(options.guide), options.any_size))
        words["guide"] = guide.astype(np.float32) if guide.dtype == np.float16 else guide
    return words


def _grays(path: Path, any_size: bool) -> Dask:
    grays = _chunks(_open(path, any_size))
    if grays.ndim == 3 and grays.shape[2] == 1:
        grays = grays[..., 0]
    if grays.ndim != 2:
        raise ShockError(f"{path}: the mask has colors or opacity; save it as a gray image.")
    return grays / np.float64(np.iinfo(grays.dtype).max) if grays.dtype.kind == "u" else grays


def _store(
    source: Path,
    pixels: Dask,
    result: Dask,
    counts: Sequence[Dask],
    path: Path,
    image_file: ImageFile,
) -> tuple[int, int]:
    # Writes the result to a Zarr array; returns how many pixels changed, and the reruns.
    import dask.array

    chunks = _stored_chunks(result, image_file)
    target = create_zarr(path, image_file, result.shape, result.dtype, chunks)
    stored = dask.array.store(result, target, lock=False, compute=False)
    wanted = [stored, *(each.sum() for each in counts)]
    if result.shape == pixels.shape:
        differs = result != pixels
        wanted.append((differs.any(axis=2) if differs.ndim == 3 else differs).sum())
    with reading(source, any_size=True):
        _, *numbers = _computed(wanted)
    reruns = sum(map(int, numbers[: len(counts)]))
    return sum(map(int, numbers[len(counts) :])), reruns


def _computed(wanted: Sequence[Any]) -> Sequence[Any]:
    # Computes together, and asks meanwhile whether to go on.
    import dask
    from dask.callbacks import Callback

    client = _cluster()
    if client is None:

        def count(_key: Any, _value: Any, _graph: Any, state: Any, _worker: Any) -> None:
            left = sum(len(state[name]) for name in ("waiting", "ready", "running"))
            ask(len(state["finished"]) / (len(state["finished"]) + left))

        with Callback(posttask=count):
            return dask.compute(*wanted)
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
    # A row of tiles is in memory at a time.
    height, width = pixels.shape[:2]
    for top in range(0, height, TILE):
        ask(top / height)
        band = np.asarray(pixels[top : top + TILE])
        for left in range(0, width, TILE):
            tile = np.zeros((TILE, TILE, *band.shape[2:]), band.dtype)
            part = band[:, left : left + TILE]
            tile[: part.shape[0], : part.shape[1]] = part
            yield tile
