# SPDX-License-Identifier: GPL-3.0-or-later
"""Images of any size, as dask arrays, chunk by chunk.

The result has the same bits as that of the whole image in memory, for any chunks. Each chunk is
filtered together with its halo, the pixels around it that influence it. The length of a flow-line
is not known in advance: if one leaves the halo, the chunk runs again with a halo twice as wide, at
last with the whole image; `counting_reruns` counts this.

What, Width, the noise and the detail depend on the whole image. They are measured when the function
is called, in windows all over the image. If networks enlarge it, they need none of these, but small
images are tested for pixel art. Everything else is computed with the result, so that no chunk stays
in memory in between.

Only the functions here import dask.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.checks import LARGEST as LARGEST_MEASURED
from ..base.checks import (
    check_kind_of_image,
    check_shape_of_mask,
    checked_image,
    checked_weights,
    is_dask,
)
from ..base.findings import is_gathered
from ..beltrami.grid_smoothing import reach_of
from ..errors import InvalidSignal
from ..grid.channels import channel_groups, opacity_channel
from ..grid.part import LeftPart, Part
from ..grid.potential import flow_reach
from ..settings import BeltramiSettings, ImageSettings
from .by_width.dials import tell_widths
from .by_width.images import reach_by_width
from .by_width.measuring import NOT_MEASURED, Measured
from .guides import check_guide, checked_guide
from .image_smoothing import smoothed_image, with_beta
from .image_steps import (
    LARGEST,
    large_pixels,
    measured_each,
    measured_whole,
    opacity_in_range,
    sharpen_checked,
)
from .learned.enlarged_images import is_enlarged_as_learned, reach_of_steps
from .learned.images import is_learned
from .learned.recipe import reach
from .learned.surroundings import CELL
from .pde import check_kind, evolved
from .pixel_art import LARGEST_PIXEL_ART, is_for_pixel_art, told_pixel_art

log = logging.getLogger(__name__)

Dask = Any
"""A dask array; dask is imported where one is at hand."""

_ENLARGED = 2  # radius in pixels of the interpolation that enlarges an image
_WALK = 8  # least length of flow-lines, in pixels, before a chunk runs again
_LEARNED_WALK = 24
_LONG_WALK = 64

_counted: ContextVar[list[Dask] | None] = ContextVar("shock_filter_reruns", default=None)


@contextmanager
def counting_reruns() -> Iterator[list[Dask]]:
    """Count how often chunks run again.

    Yields
    ------
    list of dask arrays
        One for each sharpening of a dask array in the block, with a number for each chunk. Compute
        them together with the result, so that no chunk is computed for this alone.

    Examples
    --------
    >>> import dask
    >>> import dask.array
    >>> import numpy as np
    >>> from shock_filter import core
    >>> from shock_filter.core.color.chunked import counting_reruns
    >>> image = np.tile(1 / (1 + np.exp(-np.linspace(-4, 4, 32))), (8, 1))
    >>> settings = core.ImageSettings(time=1000.0)
    >>> with counting_reruns() as reruns:
    ...     result = core.sharpen_image(dask.array.from_array(image, chunks=16), settings)
    >>> sharp, counts = dask.compute(result, sum(reruns))
    >>> bool((sharp == core.sharpen_image(image, settings)).all()), int(counts.sum())
    (True, 0)
    """
    counts: list[Dask] = []
    token = _counted.set(counts)
    try:
        yield counts
    finally:
        _counted.reset(token)


def sharpen_chunks(
    image: Dask,
    settings: ImageSettings,
    mask: npt.ArrayLike | None = None,
    known: Measured | None = None,
    guide: npt.ArrayLike | None = None,
) -> Dask:
    """Sharpen a dask array as `sharpen_image` does; mask and guide may be dask arrays too."""
    pixels = _checked_picture(image)
    weights = _checked_mask(mask, pixels)
    lead = _checked_lead(guide, pixels, settings)
    found: Sequence[Measured] = ()
    times = settings.enlarge
    if min(pixels.shape[:2]) * times < 2:  # a line of pixels is filtered at once
        margin, halo = 0, max(pixels.shape[:2])
    else:
        alone = is_enlarged_as_learned(settings, lead is not None)
        if settings.by_width and not settings.is_neutral and not alone:
            found = _measured(pixels, lead, settings, known)
        if known is None and is_for_pixel_art(settings, lead is not None):
            share = _pixel_art(pixels, settings)
            found = [each._replace(pixel_art=share) for each in found or [NOT_MEASURED]]
        margin, halo = _reach_of_sharpening(settings, found, lead is not None)
    function = partial(
        _sharpen_part,
        settings=settings,
        found=found or known,
        margin=margin,
        has_mask=weights is not None,
    )
    sources = [each for each in (pixels, weights, lead) if each is not None]
    return _over_chunks(image, sources, function, -(-halo // times), times)


def measure_chunks(image: Dask, settings: ImageSettings) -> Measured:
    """Measure a dask array as `measure_image` does."""
    view: Any = _View(_checked_picture(image), settings)
    channels = channel_groups(view.shape[2], settings)[0]
    return measured_whole(view, channels, settings)


def smooth_chunks(image: Dask, settings: BeltramiSettings, mask: npt.ArrayLike | None) -> Dask:
    """Denoise a dask array as `beltrami_image` does; the mask may be a dask array too."""
    pixels = _checked_picture(image)
    weights = _checked_mask(mask, pixels)
    sources = [pixels] if weights is None else [pixels, weights]
    largest = LARGEST_MEASURED if settings.by_noise else None
    settings = with_beta(settings, _Windows(pixels, largest))
    halo = settings.iterations * reach_of(settings) if settings.time > 0 else 0
    function = partial(_smooth_part, settings=settings, largest=largest)
    return _over_chunks(image, sources, function, halo)


def evolve_chunks(image: Dask, steps: int, time_step: float, detector: int) -> Dask:
    """Evolve a dask array as `osher_rudin_image` does."""
    pixels = _checked_picture(image)
    check_kind(pixels)
    function = partial(_evolve_part, steps=steps, time_step=time_step, detector=detector)
    return _over_chunks(image, [pixels], function, max(steps, 1))


# ------------------------------------------------------------------------------------- arguments


def _checked_picture(image: Dask) -> Dask:
    # As an array (h, w, c) with all channels in one chunk.
    if any(math.isnan(n) for n in image.shape):
        raise InvalidSignal(
            "The dask array does not know its shape; call its compute_chunk_sizes() first."
        )
    check_kind_of_image(image)
    return (image if image.ndim == 3 else image[..., None]).rechunk({2: -1})


def _checked_mask(mask: npt.ArrayLike | None, pixels: Dask) -> Dask | None:
    # As an array (h, w, 1). The values of dask arrays are checked when they are computed.
    if mask is None:
        return None
    if is_dask(mask):
        check_shape_of_mask(mask, pixels)
        return mask[..., None]
    import dask.array

    weights = checked_weights(mask, pixels)
    return dask.array.from_array(weights, chunks=pixels.chunks[:2])[..., None]


def _checked_lead(
    guide: npt.ArrayLike | None, pixels: Dask, settings: ImageSettings
) -> Dask | None:
    if guide is None:
        return None
    import dask.array

    if not is_dask(guide):
        guide = dask.array.from_array(checked_image(guide), chunks=-1)
    lead = _checked_picture(guide)
    check_guide(lead, pixels, settings)
    return lead


# ------------------------------------------------------------------------------------- measuring


class _Windows:
    """An image that is read window by window."""

    def __init__(self, pixels: Dask, largest: float | None) -> None:
        self._pixels, self.shape, self.dtype = pixels, pixels.shape, pixels.dtype
        self._largest = largest

    def __getitem__(self, window: tuple[slice, slice]) -> npt.NDArray:
        return checked_image(_computed([self._pixels[window]])[0], self._largest)


class _View:
    """An image for the measurement of borders, read by windows: enlarged, opacity in [0, 1]."""

    def __init__(self, pixels: Dask, settings: ImageSettings) -> None:
        self._pixels, self._settings = pixels, settings
        self._alpha = opacity_channel(pixels.shape[2], settings.alpha)
        height, width, channels = pixels.shape
        self.shape = settings.enlarge * height, settings.enlarge * width, channels
        self.dtype = pixels.dtype
        if settings.enlarge > 1:
            self.dtype = np.dtype("f8" if pixels.dtype == np.float64 else "f4")

    def __getitem__(self, window: tuple[slice, slice]) -> npt.NDArray:
        times = self._settings.enlarge
        around = _ENLARGED if times > 1 else 0
        cut = tuple(
            slice(max(part.start // times - around, 0), -(-part.stop // times) + around)
            for part in window
        )
        given = checked_image(_computed([self._pixels[cut]])[0], LARGEST)
        if times > 1:
            given = large_pixels(given, self._settings)
        rows, columns = (
            slice(part.start - times * outer.start, part.stop - times * outer.start)
            for part, outer in zip(window, cut, strict=True)
        )
        return opacity_in_range(given[rows, columns], self._alpha)


def _pixel_art(pixels: Dask, settings: ImageSettings) -> float:
    if pixels.shape[0] * pixels.shape[1] >= LARGEST_PIXEL_ART:
        return 0.0
    (whole,) = _computed([pixels])
    return told_pixel_art(checked_image(whole, LARGEST), settings)


def _measured(
    pixels: Dask, lead: Dask | None, settings: ImageSettings, known: Measured | None
) -> tuple[Measured, ...]:
    image: Any = _View(pixels, settings)
    leading: Any = None if lead is None else _View(lead, replace(settings, alpha="auto"))
    found = measured_each(image, leading, settings, known)
    if settings.width == 0 and is_gathered():
        width, count = found[0].borders.width, found[0].borders.number
        tell_widths("pixels", width, count, 0.0 if found[0].width > 0 else None)
    return found


# ------------------------------------------------------------------------------------- parts


def _reach_of_sharpening(
    settings: ImageSettings, found: Sequence[Measured], has_guide: bool
) -> tuple[int, int]:
    # The margin in which the flow is not known, and the halo, in pixels of the result.
    if settings.is_neutral:
        margin = around = walk = 0
    elif is_enlarged_as_learned(settings, has_guide):
        margin, around, walk = 0, settings.enlarge * reach_of_steps(settings.enlarge), 0
    elif is_learned(settings, has_guide):
        margin, moved = reach(settings.smoothing_passes)
        around, walk = 0, moved + _LEARNED_WALK + CELL  # a part begins at a multiple of CELL
    elif settings.by_width:
        margin, around = np.max([reach_by_width(each, settings) for each in found], axis=0)
        walk = _WALK + math.ceil(2.0 * max(each.width for each in found))
    else:
        margin = around = flow_reach(settings.smoothing_passes)
        walk = math.ceil(min(_WALK + 4.0 * settings.time**0.25, _LONG_WALK))
    read = _ENLARGED * settings.enlarge if settings.enlarge > 1 else 0
    return int(margin) + read, int(max(around, margin + walk)) + read


def _sharpen_part(
    crops: Sequence[npt.NDArray],
    part: Part,
    *,
    settings: ImageSettings,
    found: Measured | Sequence[Measured] | None,
    margin: int,
    has_mask: bool,
) -> npt.NDArray:
    image, *beside = crops
    given = checked_image(image, LARGEST if settings.by_width else None)
    weights = checked_weights(beside.pop(0)[..., 0], given) if has_mask else None
    lead = checked_guide(beside[0], given, settings) if beside else None
    large = part.enlarged(settings.enlarge)._replace(margin=margin)
    result = np.empty((*large.shape, given.shape[2]), given.dtype)
    sharpen_checked(given, result, settings, weights, lead, found, large)
    return result[large.rows, large.columns].copy()


def _smooth_part(
    crops: Sequence[npt.NDArray],
    part: Part,
    *,
    settings: BeltramiSettings,
    largest: float | None,
) -> npt.NDArray:
    image = checked_image(crops[0], largest)
    mask = checked_weights(crops[1][..., 0] if len(crops) > 1 else None, image)
    return smoothed_image(image, settings, mask)[part.rows, part.columns].copy()


def _evolve_part(crops: Sequence[npt.NDArray], part: Part, **words: Any) -> npt.NDArray:
    return evolved(checked_image(crops[0]), **words)[part.rows, part.columns].copy()


# ------------------------------------------------------------------------------------- chunks


class _Wanted(NamedTuple):
    """First and last rows and columns of a chunk."""

    top: int
    bottom: int
    left: int
    right: int

    def with_halo(self, halo: int, shape: tuple[int, int]) -> tuple[slice, slice]:
        """Return the rows and columns of the chunk with its halo."""
        return (
            slice(max(self.top - halo, 0), min(self.bottom + halo, shape[0])),
            slice(max(self.left - halo, 0), min(self.right + halo, shape[1])),
        )

    def part(self, halo: int, shape: tuple[int, int]) -> Part:
        """Return the position of the chunk within itself and its halo."""
        rows, columns = self.with_halo(halo, shape)
        return Part(
            (rows.stop - rows.start, columns.stop - columns.start),
            slice(self.top - rows.start, self.bottom - rows.start),
            slice(self.left - columns.start, self.right - columns.start),
            (rows.start > 0, rows.stop < shape[0], columns.start > 0, columns.stop < shape[1]),
            origin=(rows.start, columns.start),
        )


class _Sources:
    """Dask arrays that tasks cut larger halos from; opaque to dask."""

    def __init__(self, arrays: Sequence[Dask]) -> None:
        self.arrays = tuple(arrays)
        self.shape: tuple[int, int] = arrays[0].shape[:2]


def _over_chunks(
    image: Dask,
    sources: Sequence[Dask],
    function: Callable[[Sequence[npt.NDArray], Part], npt.NDArray],
    halo: int,
    times: int = 1,
) -> Dask:
    # Each chunk is one task; chunks smaller than the halo are joined first.
    import dask
    import dask.array

    chunks = tuple(_joined(image.chunks[axis], halo) for axis in (0, 1))
    depth = {axis: halo if len(chunks[axis]) > 1 else 0 for axis in (0, 1)}
    crops = [
        dask.array.overlap.overlap(
            source.rechunk({0: chunks[0], 1: chunks[1]}), depth, "none", allow_rechunk=False
        )
        for source in sources
    ]
    wanted = np.empty((len(chunks[0]), len(chunks[1])), dtype=object)
    (tops, bottoms), (lefts, rights) = map(_edges, chunks)
    for i, j in np.ndindex(wanted.shape):
        wanted[i, j] = _Wanted(tops[i], bottoms[i], lefts[j], rights[j])
    # The blocks of this array are pairs of a result and a number of reruns, opaque to dask.
    both = dask.array.blockwise(
        _filter_chunk,
        "yx",
        dask.array.from_array(wanted, chunks=1),
        "yx",
        *(word for k, crop in enumerate(crops) for word in (crop, f"yx{k}")),
        concatenate=True,
        align_arrays=False,
        dtype=object,
        meta=np.empty((0, 0), dtype=object),
        function=function,
        halo=halo,
        sources=dask.delayed(_Sources(sources), traverse=False),
    )
    counts = _counted.get()
    if counts is not None:
        counts.append(both.map_blocks(_reruns, dtype=np.int64, meta=np.empty((0, 0), np.int64)))
    result = dask.array.blockwise(
        _pixels,
        "yxc",
        both,
        "yx",
        new_axes={"c": sources[0].shape[2]},
        adjust_chunks={
            "y": tuple(times * n for n in chunks[0]),
            "x": tuple(times * n for n in chunks[1]),
        },
        dtype=image.dtype,
        meta=np.empty((0, 0, 0), image.dtype),
    )
    result = result if image.ndim == 3 else result[..., 0]
    return result.rechunk({axis: tuple(times * n for n in image.chunks[axis]) for axis in (0, 1)})


def _joined(chunks: Sequence[int], least: int) -> tuple[int, ...]:
    # Chunks joined with neighbors, so that none is smaller than the halo.
    joined: list[int] = []
    for n in chunks:
        if joined and joined[-1] < least:
            joined[-1] += n
        elif n:
            joined.append(n)
    if len(joined) > 1 and joined[-1] < least:
        joined[-2:] = [joined[-2] + joined[-1]]
    return tuple(joined)


def _edges(chunks: Sequence[int]) -> tuple[list[int], list[int]]:
    ends = np.cumsum(chunks).tolist()
    return [0, *ends[:-1]], ends


def _filter_chunk(
    wanted: npt.NDArray, *crops: npt.NDArray, function: Any, halo: int, sources: _Sources
) -> tuple[npt.NDArray, int]:
    # Returns the result of a chunk, and how often it ran again.
    window: _Wanted = wanted[0, 0]
    reruns = 0
    parts: Sequence[npt.NDArray] = crops
    while True:
        try:
            result = function(parts, window.part(halo, sources.shape))
        except LeftPart:
            reruns += 1
            halo *= 2
            cut = window.with_halo(halo, sources.shape)
            parts = _computed([array[cut] for array in sources.arrays])
        else:
            break
    if reruns:
        log.info("A chunk ran again %d times: flow-lines led farther than expected.", reruns)
    return result, reruns


def _pixels(both: tuple[npt.NDArray, int]) -> npt.NDArray:
    return both[0]


def _reruns(both: tuple[npt.NDArray, int]) -> npt.NDArray[np.int64]:
    return np.full((1, 1), both[1], np.int64)


def _computed(arrays: Sequence[Dask]) -> Sequence[npt.NDArray]:
    # This also works inside a task; on a cluster, other tasks then compute the arrays.
    import dask

    try:
        from distributed import get_worker, worker_client

        get_worker()
    except (ImportError, ValueError):  # no cluster, or not in it
        return dask.compute(*arrays)
    with worker_client() as client:
        return client.gather(client.compute(list(arrays)))
