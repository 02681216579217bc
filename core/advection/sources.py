# SPDX-License-Identifier: GPL-3.0-or-later
"""Sources of dye: their places, times and colors (paper D, section 5.1)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..base.checks import as_array, by_keyword, checked_count
from ..errors import InvalidSettings, InvalidSignal

_Singles = npt.NDArray[np.float32]


class DyeSource:
    """A spot, a strip or a curve that releases dye.

    Parameters
    ----------
    points : (n, 2) array of float
        One point is a spot, two are the ends of a strip, more are a curve. Coordinates are
        fractions of the width of the image, from the left, and of its height, from below.
    width : float
        Width of the spot or strip, in pixels.
    colors : sequence of (red, green, blue)
        In [0, 1]. Releases use them in turn.
    every : int
        Number of frames between the starts of releases: 0 releases once, 1 always.
    lasting : int
        Number of frames that a release lasts.

    Raises
    ------
    InvalidSignal, InvalidSettings
        If the points or numbers cannot be used.

    Examples
    --------
    Red and blue in turn, for 10 of 20 frames each, from ten spots along the left side:

    >>> import numpy as np
    >>> from shock_filter import core
    >>> spots = [
    ...     core.DyeSource([(0.05, y)], colors=[(1, 0, 0), (0, 0, 1)], every=20, lasting=10)
    ...     for y in np.linspace(0.05, 0.95, 10)
    ... ]
    >>> spots[0].period
    40
    """

    @by_keyword
    def __init__(
        self,
        points: npt.ArrayLike,
        *,
        width: float = 16.0,
        colors: Sequence[Sequence[float]] = ((1.0, 1.0, 1.0),),
        every: int = 1,
        lasting: int = 1,
    ) -> None:
        places = as_array(points, "points")
        if places.ndim != 2 or places.shape[1] != 2 or len(places) == 0:
            raise InvalidSignal(f"The points have the shape {places.shape}; give (n, 2).")
        if places.dtype.kind not in "fiu" or not (np.abs(places) <= 1e6).all():
            raise InvalidSignal("The points hold NaN, infinity or no numbers; give shares.")
        self.points = places.astype(np.float64)
        if not (isinstance(width, (int, float, np.number)) and 0 < width <= 1e6):
            raise InvalidSettings(f"width is {width!r}; give a positive number of pixels.")
        self.width = float(width)
        table = as_array(colors, "colors")
        if table.ndim != 2 or table.shape[1] != 3 or len(table) == 0:
            raise InvalidSignal(f"The colors have the shape {table.shape}; give (n, 3).")
        if table.dtype.kind not in "fiu" or not ((table >= 0) & (table <= 1)).all():
            raise InvalidSignal("The colors leave the range 0 to 1; scale them.")
        self.colors = tuple(tuple(map(float, color)) for color in table)
        self.every = checked_count(every, "every")
        self.lasting = checked_count(lasting, "lasting", 1)

    @property
    def period(self) -> int:
        """Number of frames after which the source repeats; 0 if it does not."""
        return self.every * len(self.colors)

    def pulse(self, number: int, repeats: bool) -> int | None:
        """Return the number of the release in a frame; None if there is none.

        If `repeats` is true, frames before the first also have releases.
        """
        if number < 0 and not (repeats and self.every):
            return None
        release, passed = divmod(number, self.every) if self.every else (0, number)
        return release if passed < self.lasting else None


def coverage(source: DyeSource, size: tuple[int, int], joined: tuple[bool, bool]) -> _Singles:
    """Return the share of each pixel in a source: (h, w), between 0 and 1 along its border."""
    rows, columns = size
    y, x = np.mgrid[:rows, :columns].astype(np.float64)
    places = np.stack(
        [source.points[:, 0] * columns - 0.5, (1.0 - source.points[:, 1]) * rows - 0.5], axis=1
    )
    distance = np.full(size, np.inf)
    for across in (-columns, 0, columns) if joined[0] else (0,):
        for down in (-rows, 0, rows) if joined[1] else (0,):
            moved = places + (across, down)
            for a, b in zip(moved, moved[1:] if len(moved) > 1 else moved, strict=False):
                np.minimum(distance, _distance(x, y, a, b), out=distance)
    return np.clip(0.5 * source.width + 0.5 - distance, 0.0, 1.0).astype(np.float32)


def _distance(x: npt.NDArray, y: npt.NDArray, a: npt.NDArray, b: npt.NDArray) -> npt.NDArray:
    # To the line from a to b.
    along = b - a
    square = float(along @ along)
    share = ((x - a[0]) * along[0] + (y - a[1]) * along[1]) / square if square > 0 else 0.0
    share = np.clip(share, 0.0, 1.0)
    return np.hypot(x - a[0] - share * along[0], y - a[1] - share * along[1])
