# SPDX-License-Identifier: GPL-3.0-or-later
"""A patch of a large image, for previews."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy.typing as npt

from ..host.inputs import HostImage
from ..settings import value_of

_MARGIN = 64
"""Largest margin of filtered but invisible pixels, some of whose neighbors are missing."""

_SQUARE = 16
"""Large patches begin at multiples of this, because means are taken over squares of this side."""

_REACHED = 6_000_000
"""Number of pixels that kernels reach in about a quarter of a second."""

_MADE = 300_000
"""Number of pixels that are enlarged and sharpened in that time."""


@dataclass(frozen=True)
class Crop:
    """A part of an image, or all of it.

    Attributes
    ----------
    image : HostImage
        The pixels to filter.
    rows, columns : slice
        The visible part of it.
    corner : tuple of int
        Column and row of the part's first pixel in the whole image.
    whole : tuple of int
        Width and height of the whole image.
    """

    image: HostImage
    rows: slice
    columns: slice
    corner: tuple[int, int]
    whole: tuple[int, int]

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, bottom, right and top of the visible part, as fractions of the whole image."""
        (left, bottom), (width, height) = self.corner, self.whole
        return (
            (left + self.columns.start) / width,
            (bottom + self.rows.start) / height,
            (left + self.columns.stop) / width,
            (bottom + self.rows.stop) / height,
        )

    @property
    def is_all(self) -> bool:
        """Whether nothing was cut off."""
        return self.box == (0.0, 0.0, 1.0, 1.0)

    def shown(self, pixels: npt.NDArray) -> npt.NDArray:
        """Return the visible part of the filtered pixels, which may be enlarged."""
        times = len(pixels) // len(self.image.pixels)
        rows, columns = (
            slice(times * each.start, times * each.stop) for each in (self.rows, self.columns)
        )
        return pixels[rows, columns]

    def shrunk(self, place: tuple[float, float], size: float) -> Crop:
        """Return a smaller crop around the same place of the whole image, if `size` is less."""
        if self.image.size <= size:
            return self
        height, width = self.image.pixels.shape[:2]
        inside = (
            (place[0] * self.whole[0] - self.corner[0]) / width,
            (place[1] * self.whole[1] - self.corner[1]) / height,
        )
        part = crop_around(self.image, inside, int(size))
        corner = self.corner[0] + part.corner[0], self.corner[1] + part.corner[1]
        return replace(part, corner=corner, whole=self.whole)


def crop_around(image: HostImage, place: tuple[float, float], size: int) -> Crop:
    """Cut out the part of an image around a place.

    Parameters
    ----------
    image : HostImage
        Not cut if it has no more pixels than `size`.
    place : tuple of float
        Distances from the left and from the bottom, as fractions of the image.
    size : int
        About the number of pixels to filter, including a margin around the visible ones.
    """
    height, width = image.pixels.shape[:2]
    side = max(height, width) if image.size <= size else math.isqrt(size)
    margin = 0 if image.size <= size else min(side // 4, _MARGIN)
    left, right = _range(place[0], width, side - 2 * margin)
    bottom, top = _range(place[1], height, side - 2 * margin)
    first_row, first_column = max(bottom - margin, 0), max(left - margin, 0)
    if margin == _MARGIN:
        first_row, first_column = (n // _SQUARE * _SQUARE for n in (first_row, first_column))
    pixels = image.pixels[first_row : top + margin, first_column : right + margin]
    return Crop(
        replace(image, pixels=pixels.copy()),
        slice(bottom - first_row, top - first_row),
        slice(left - first_column, right - first_column),
        (first_column, first_row),
        (width, height),
    )


def filtered_at_once(settings: Any) -> float:
    """Return how many pixels are filtered in about a quarter of a second, as an estimate.

    Parameters
    ----------
    settings : object
        Settings of the filter; `reach`, repeats and enlargement are used.
    """
    kernel = settings.kernel
    times = value_of(kernel, "enlargement", 1)
    if times > 1:
        return _MADE // times**2
    if not kernel.reach:
        return math.inf
    work = _REACHED / value_of(kernel, "repeats", 1)
    return max(int(work / kernel.reach), math.isqrt(int(work)))  # none reaches beyond the patch


def _range(place: float, length: int, side: int) -> tuple[int, int]:
    side = min(side, length)
    first = min(max(round(place * length - side / 2), 0), length - side)
    return first, first + side
