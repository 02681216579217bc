# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts of a picture that are filtered alone, with the same result as in the whole picture.

A part is cut out with a surrounding of further pixels. Near its cut sides results are wrong, as
neighbors are missing; the width of that zone is its margin. A flow-line that leaves the rest shows
that the surrounding was too small.
"""

from __future__ import annotations

from typing import NamedTuple

_FAR = 1 << 40  # no row or column


class LeftPart(Exception):
    """A flow-line leaves the known flow of a part, which must be cut out with a larger halo."""


class Part(NamedTuple):
    """A part of a picture.

    Attributes
    ----------
    shape : (int, int)
        Height and width of the pixels that were cut out.
    rows, columns : slice
        The wanted pixels among them.
    cut : (bool, bool, bool, bool)
        Whether the picture continues above, below, to the left and to the right.
    margin : int
        Width of the zone along these sides where the flow is not known.
    origin : (int, int)
        The picture's row and column that the part begins with.
    """

    shape: tuple[int, int]
    rows: slice
    columns: slice
    cut: tuple[bool, bool, bool, bool] = (False, False, False, False)
    margin: int = 0
    origin: tuple[int, int] = (0, 0)

    @classmethod
    def whole(cls, shape: tuple[int, ...]) -> Part:
        """The part that is the whole picture."""
        height, width = shape[:2]
        return cls((height, width), slice(0, height), slice(0, width))

    def known(self) -> tuple[slice, slice]:
        """Rows and columns in which the flow is known."""
        (height, width), (top, bottom, left, right) = self.shape, self.cut
        return (
            slice(top * self.margin, height - bottom * self.margin),
            slice(left * self.margin, width - right * self.margin),
        )

    def enlarged(self, times: int) -> Part:
        """Return the same part of the picture enlarged by a whole number."""
        rows, columns = (
            slice(times * each.start, times * each.stop) for each in (self.rows, self.columns)
        )
        shape = times * self.shape[0], times * self.shape[1]
        origin = times * self.origin[0], times * self.origin[1]
        return Part(shape, rows, columns, self.cut, times * self.margin, origin)

    def wider(self, distance: int) -> Part:
        """Return the same part with the pixels within a distance as wanted ones too."""
        rows, columns = (
            slice(max(each.start - distance, 0), min(each.stop + distance, length))
            for each, length in zip((self.rows, self.columns), self.shape, strict=True)
        )
        return self._replace(rows=rows, columns=columns)

    def begun_at(self, multiple: int) -> Part:
        """Return the same part, cropped to begin at multiples of rows and columns."""
        top, left = (-n % multiple for n in self.origin)
        return self._replace(
            shape=(self.shape[0] - top, self.shape[1] - left),
            rows=slice(self.rows.start - top, self.rows.stop - top),
            columns=slice(self.columns.start - left, self.columns.stop - left),
            origin=(self.origin[0] + top, self.origin[1] + left),
        )

    def window(self) -> Window:
        """Return the part as kernels need it."""
        (rows, columns), (top, bottom, left, right) = self.known(), self.cut
        return Window(
            self.rows.start,
            self.columns.start,
            self.columns.stop,
            rows.start,
            columns.start,
            0 if top else -_FAR,
            rows.stop - rows.start - 2 if bottom else _FAR,
            0 if left else -_FAR,
            columns.stop - columns.start - 2 if right else _FAR,
        )


class Window(NamedTuple):
    """A part, as kernels need it.

    Attributes
    ----------
    row, column, end : int
        The first wanted row and column, and the end of the wanted columns.
    top, left : int
        The first row and column where the flow is known.
    first_row, last_row, first_column, last_column : int
        The outermost cells of the known flow on sides where the picture continues; far away on
        other sides.
    """

    row: int
    column: int
    end: int
    top: int
    left: int
    first_row: int
    last_row: int
    first_column: int
    last_column: int
