# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts of a picture that are filtered by themselves, and give what the whole picture would.

A part is cut out with more around it. What is near a side where the picture goes on comes out
wrong, as neighbors lack there: so far inwards is its margin. A flow-line that leaves the rest shows
that too little was cut out.
"""

from __future__ import annotations

from typing import NamedTuple

_FAR = 1 << 40  # no row or column


class LeftPart(Exception):
    """A flow-line leaves what is known of the picture; cut out more."""


class Part(NamedTuple):
    """A part of a picture.

    Attributes
    ----------
    shape : (int, int)
        Height and width of what was cut out.
    rows, columns : slice
        What of it is wanted.
    cut : (bool, bool, bool, bool)
        Whether the picture goes on above, below, to the left and to the right.
    margin : int
        Pixels from these sides where the flow is not known.
    """

    shape: tuple[int, int]
    rows: slice
    columns: slice
    cut: tuple[bool, bool, bool, bool] = (False, False, False, False)
    margin: int = 0

    @classmethod
    def whole(cls, shape: tuple[int, ...]) -> Part:
        """All of a picture."""
        height, width = shape[:2]
        return cls((height, width), slice(0, height), slice(0, width))

    def known(self) -> tuple[slice, slice]:
        """Rows and columns where the flow is known."""
        (height, width), (top, bottom, left, right) = self.shape, self.cut
        return (
            slice(top * self.margin, height - bottom * self.margin),
            slice(left * self.margin, width - right * self.margin),
        )

    def enlarged(self, times: int) -> Part:
        """Return the same part of the picture that is so many times larger."""
        rows, columns = (
            slice(times * each.start, times * each.stop) for each in (self.rows, self.columns)
        )
        shape = times * self.shape[0], times * self.shape[1]
        return Part(shape, rows, columns, self.cut, times * self.margin)

    def window(self) -> Window:
        """Tell kernels about it."""
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
    """What kernels need to know of a part.

    Attributes
    ----------
    row, column, end : int
        The first row and column that are wanted, and the end of the columns.
    top, left : int
        The first row and column where the flow is known.
    first_row, last_row, first_column, last_column : int
        Cells of the known flow beyond which the picture goes on; far away where it does not.
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
