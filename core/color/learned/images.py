# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpening of the pixels of an image, or of a part of one, by the learned recipe."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...base.findings import is_gathered
from ...base.parallel import kernel, run
from ...base.progress import aside, phase
from ...grid.borders import Borders, measure_borders, windows_to_measure
from ...grid.channels import Channels
from ...grid.part import Part
from ...settings import WIDTH_OF_SIGMA, ImageSettings
from ..by_width.measuring import Measured, scale_of
from .first import SIGMAS
from .planes import Planes
from .recipe import FAINT, Wishes, sharpened
from .report import tell_learned
from .surroundings import CELL, STRIP, WIDEST, Singles

_ROUNDING = 16 * float(np.finfo(np.float32).eps)

_MOST = 100.0
"""The detail of a window counts at most as this factor times the median. In photos and drawings it
differs far less, but the sun in an HDR photo would outweigh all else."""


def is_learned(settings: ImageSettings, has_guide: bool) -> bool:
    """Return whether an image is sharpened by the learned recipe.

    It is not if a time, What or a guide is given, or if it is enlarged; see `enlarged_images`.
    """
    by_itself = settings.by_width and settings.what == "auto" and settings.enlarge == 1
    return by_itself and not has_guide


def typical_detail(details: npt.NDArray, weights: npt.NDArray) -> float:
    """Average the details of windows, limited so that none outweighs the others."""
    seen = details > 0
    if not seen.any():
        return 0.0
    return float(np.average(np.minimum(details, _MOST * np.median(details[seen])), weights=weights))


def detail_of(values: Singles, smooth: Singles) -> Singles:
    """Square the difference to a smoothing; 0 where it is only rounding."""
    away = values - smooth
    away[np.abs(away) < _ROUNDING * np.abs(values)] = 0
    return np.square(away)


def ends_of(smooth: Singles, seen: npt.NDArray[np.bool_]) -> npt.NDArray[np.float32]:
    """Find the least and the greatest value of each channel among visible pixels: (2, c)."""
    c = len(smooth)
    values = smooth.reshape(c, -1)
    low = values.min(axis=1, initial=np.inf, where=seen.reshape(-1))
    high = values.max(axis=1, initial=-np.inf, where=seen.reshape(-1))
    return np.stack([low, high])


def span_of(low: npt.NDArray, high: npt.NDArray) -> float:
    """Return the largest range of a channel; 0 if no pixel is visible."""
    return max(float((high - low).max()), 0.0)


def measured_detail(pixels: npt.NDArray, channels: Channels) -> float:
    """Measure the mean squared difference to a smoothing, in windows all over an image."""
    return _detail_and_span(pixels, channels)[0]


def _detail_and_span(pixels: npt.NDArray, channels: Channels) -> tuple[float, float]:
    windows = windows_to_measure(pixels.shape[:2])
    found = np.zeros(len(windows))
    ends = np.empty((len(windows), 2, channels.stop - channels.start), np.float32)

    def measure(start: int, stop: int) -> None:
        for i in range(start, stop):
            planes = Planes.of(pixels[windows[i]], channels)
            smooth = planes.smoothed(SIGMAS[-1:], 0, planes.values.shape[1])[0]
            seen = planes.opacity > 0 if planes.opacity.size else np.ones(smooth.shape[1:], bool)
            ends[i] = ends_of(smooth, seen)
            squares = np.float64(detail_of(planes.values, smooth))
            if planes.opacity.size:
                squares *= planes.opacity / max(planes.opacity.mean(dtype=np.float64), 1e-6)
            found[i] = squares.mean()

    run(measure, len(windows), chunk=1)
    span = span_of(ends[:, 0].min(axis=0), ends[:, 1].max(axis=0))
    return typical_detail(found, np.ones(len(found))), span


def measured_for_learned(
    pixels: npt.NDArray, channels: Channels, settings: ImageSettings
) -> Measured:
    """Measure detail and span of the whole image, and its borders if they are reported."""
    borders = Borders()
    if settings.width == 0 and channels.start == 0 and is_gathered():
        borders = measure_borders(pixels, scale_of(pixels), channels)
    return with_detail(Measured("auto", borders.width, borders), pixels, channels)


def with_detail(found: Measured, pixels: npt.NDArray, channels: Channels) -> Measured:
    """Add the detail and the span to measurements of an image."""
    detail, span = _detail_and_span(pixels, channels)
    return found._replace(borders=found.borders._replace(detail=detail, span=span))


def sharpen_pixels_learned(
    pixels: npt.NDArray,
    channels: Channels,
    settings: ImageSettings,
    target: npt.NDArray,
    found: Measured,
    part: Part | None = None,
) -> None:
    """Sharpen some channels of an image into `target`, which holds a copy of the image.

    Parameters
    ----------
    pixels, target : (h, w, c) array
    channels : Channels
    settings : ImageSettings
    found : Measured
        Measurements of the channels in the whole image.
    part : Part, optional
        The wanted pixels, if the image is a part of another one.
    """
    given, out = pixels, target
    if part is not None:
        begun = part.begun_at(CELL)
        top, left = (old - new for old, new in zip(part.shape, begun.shape, strict=True))
        given, out, part = pixels[top:, left:], target[top:, left:], begun
    with phase(0.0, 0.02, "Sharpening"):
        planes = Planes.of(given, channels)
    square = min(settings.width / WIDTH_OF_SIGMA, WIDEST) ** 2
    nearest = settings.sampling == "nearest"
    borders = found.borders
    wishes = Wishes(
        FAINT * borders.detail, square, settings.smoothing_passes, nearest, borders.span
    )
    with phase(0.02, 0.98, "Sharpening"):
        values = sharpened(planes, channels.brightness, wishes, part)
    with phase(0.98, 1.0, "Sharpening"):
        run(_put, len(given), planes.values, values, channels.start, out.dtype.kind == "u", out,
            chunk=STRIP)  # fmt: skip
    if settings.width == 0 and channels.start == 0 and part is None and is_gathered():
        with aside("Sharpening"):
            after = None
            if not np.array_equal(target, pixels):
                after = measure_borders(target, scale_of(target), channels, roughly=True)
                after = after._replace(detail=measured_detail(target, channels))
        tell_learned("pixels", borders, after)


@kernel
def _put(start, stop, old, new, first, rounded, out):
    # Unchanged values keep their bits, and so do hidden pixels, which are 0 in both.
    for y in range(start, stop):
        for c in range(len(old)):
            for x in range(old.shape[2]):
                if new[c, y, x] != old[c, y, x]:
                    value = np.float64(new[c, y, x])
                    out[y, x, first + c] = np.floor(value + 0.5) if rounded else value
