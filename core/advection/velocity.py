# SPDX-License-Identifier: GPL-3.0-or-later
"""The velocity of a flow in the plane, as steps from frame to frame (paper D, 4.3, 4.6, 6).

The input is a velocity field (right, up) of any resolution, steady or not. A `Motion` holds it in
pixels of the image, right and down.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.checks import as_array, by_keyword, checked_count, checked_number, checked_size
from ..base.parallel import kernel, run
from ..errors import InvalidSettings, InvalidSignal

FieldOfTime = Callable[[float], npt.ArrayLike]
"""A velocity at each moment, from 0, the first frame, to 1, the last."""

MOST_PIXELS = 1000
"""Longest step in a frame, and the width of the rim of noise around the image."""

ROWS = 32
"""Rows of an image that a kernel processes at once."""

_MOMENTS = 33
"""Number of times at which the greatest speed of a function is measured."""

_LARGEST = 1e30
_LEAST = 1e-30  # slower flows stand still

_Singles = npt.NDArray[np.float32]


class Motion(NamedTuple):
    """The displacement of each pixel in a frame.

    Attributes
    ----------
    right, down : (h, w) float32
        In pixels; 0 where the velocity is undefined.
    defined : (h, w) bool
    """

    right: _Singles
    down: _Singles
    defined: npt.NDArray[np.bool_]


class Flow:
    """A velocity, scaled to an image and to the number of its frames.

    Parameters
    ----------
    velocity : (h, w, 2) or (k, h, w, 2) array of float, or function
        Steady, at k even times, or as a function of time. Components are (right, up).
    size : (int, int), optional
        Rows and columns of the image. Default: those of the velocity.
    mask : (h, w) array of bool, optional
        Where the velocity is defined, at its own resolution or the image's.
    step : float
        Longest step in pixels; with 0, velocities are in pixels a frame.
    periodic : str
        As in `NoiseSettings`.
    frames : int
    loops : bool
        Whether the last frame is followed by the first one.
    """

    def __init__(
        self,
        velocity: npt.ArrayLike | FieldOfTime,
        size: tuple[int, int] | None,
        mask: npt.ArrayLike | None,
        step: float,
        periodic: str = "none",
        frames: int = 1,
        loops: bool = False,
    ) -> None:
        self._field = _Function(velocity) if callable(velocity) else _KeyFrames(velocity)
        self._steady = len(self._field) == 1
        self._wraps = wraps(periodic)
        self.frames, self._loops = frames, loops
        rows, columns = self._field.shape[:2] if size is None else checked_size(size)
        self.size = rows, columns
        self._mask: npt.NDArray[np.bool_] | None = None
        self._masks_field: npt.NDArray[np.bool_] | None = None
        if mask is not None:
            self._take_mask(mask)
        fastest = max(map(self._speed, self._field.samples()))
        self._scale = 1.0
        if step > 0:
            self._scale = step / fastest if fastest > _LEAST else 0.0
        self.longest = self._scale * fastest
        """Longest step of all, in pixels."""
        if self.longest > MOST_PIXELS * (1 + 1e-6):
            raise InvalidSignal(
                "The velocity is {most:.6g} pixels a frame in places; give at most {bound}, or a"
                " step to which it is scaled.",
                most=self.longest,
                bound=MOST_PIXELS,
            )
        self._known: Motion | None = None

    @property
    def steady(self) -> bool:
        """Whether the motion is the same at all times."""
        return self._steady

    def at(self, frame: float) -> Motion:
        """Return the motion at a frame; between frames it changes linearly."""
        if self._steady and self._known is not None:
            return self._known
        field = self._field.at(self._moment(frame), self._loops)
        motion = self._motion(self._masked(field))
        if self._steady:
            self._known = motion
        return motion

    def _moment(self, frame: float) -> float:
        if self._loops:
            return frame / self.frames % 1.0
        return min(max(frame / max(self.frames - 1, 1), 0.0), 1.0)

    def _take_mask(self, mask: npt.ArrayLike) -> None:
        given = as_array(mask, "mask")
        shape = self._field.shape[:2]
        if given.shape not in (shape, self.size):
            raise InvalidSignal(
                f"The mask has the shape {given.shape}; give {shape}, as the velocity has, or"
                f" {self.size}, as the image."
            )
        if given.dtype.kind not in "bfiu" or not np.isfinite(given).all():
            raise InvalidSignal("The mask holds NaN, infinity or no numbers; give True or False.")
        if given.shape == shape:
            self._masks_field = given > 0
        else:
            self._mask = given > 0

    def _masked(self, field: _Singles) -> _Singles:
        if self._masks_field is None:
            return field
        return np.where(self._masks_field[..., None], field, np.float32(np.nan))

    def _speed(self, field: _Singles) -> float:
        speeds = np.hypot(*np.moveaxis(self._masked(field), -1, 0).astype(np.float64))
        return float(np.nanmax(speeds, initial=0.0))

    def _motion(self, field: _Singles) -> Motion:
        rows, columns = self.size
        right = np.empty(self.size, dtype=np.float32)
        down = np.empty(self.size, dtype=np.float32)
        defined = np.ones(self.size, dtype=np.bool_) if self._mask is None else self._mask.copy()
        wrap_x, wrap_y = self._wraps
        places = (*_places(rows, field.shape[0], wrap_y), *_places(columns, field.shape[1], wrap_x))
        run(_resample, rows, field, *places, np.float32(self._scale), np.float32(self.longest),
            right, down, defined, chunk=ROWS)  # fmt: skip
        return Motion(right, down, defined)


@by_keyword
def flow_frames(
    velocity: npt.ArrayLike | FieldOfTime,
    *,
    columns: int,
    width: float,
    duration: float,
    step: float = 2.0,
    mask: npt.ArrayLike | None = None,
) -> int:
    """Return the number of frames for which a flow has its natural speed.

    Parameters
    ----------
    velocity, mask
        As in `advect_noise`; in units of length by units of time.
    columns : int
        Width of the image, in pixels.
    width, duration : float
        The extent of the velocity field in its own units of length and of time.
    step : float
        The longest step in a frame, in pixels.

    Returns
    -------
    int

    Raises
    ------
    InvalidSignal, InvalidSettings
        If the velocity cannot be used, or a number is not positive.

    Notes
    -----
    Paper D, section 6.

    Examples
    --------
    The paper's cylinder: up to 9.9 m/s, for 4 s, in 8 m.

    >>> import numpy as np
    >>> from shock_filter import core
    >>> velocity = np.full((5, 5, 2), [9.9, 0.0])
    >>> domain = {"width": 8.0, "duration": 4.0}
    >>> [core.flow_frames(velocity, columns=n, step=6.0, **domain) for n in (300, 600, 900)]
    [248, 495, 743]
    """
    for name, value in {
        "columns": columns,
        "width": width,
        "duration": duration,
        "step": step,
    }.items():
        checked_number(value, name)
    flow = Flow(velocity, None, mask, step)
    fastest = flow.longest / flow._scale if flow._scale > 0 else 0.0
    with np.errstate(all="ignore"):
        frames = float(np.float64(fastest) * duration * columns / width / step)
    if not math.isfinite(frames):
        raise InvalidSettings(
            "The number of frames is too large; give a larger width or step, or a shorter duration."
        )
    return max(math.ceil(frames - 1e-9 * frames), 1)


def wraps(periodic: str) -> tuple[bool, bool]:
    """Return whether left and right are joined, and top and bottom."""
    return periodic in ("x", "both"), periodic in ("y", "both")


def checked_frames(frames: object, fade: int) -> int:
    """Return the number of frames, or raise `InvalidSettings`."""
    count = checked_count(frames, "frames", 1)
    if fade > count:
        raise InvalidSettings(
            "loop is {fade}, but there are only {frames} frames; give at most as many.",
            fade=fade,
            frames=count,
        )
    return count


class _KeyFrames:
    """Velocities at even times, with linear interpolation."""

    def __init__(self, velocity: npt.ArrayLike) -> None:
        given = as_array(velocity, "velocity")
        if given.ndim not in (3, 4) or given.shape[-1] != 2 or given.size == 0:
            raise InvalidSignal(
                f"The velocity has the shape {given.shape}; give (h, w, 2), or (k, h, w, 2) for k"
                " moments."
            )
        self._given = given if given.ndim == 4 else given[None]
        self.shape = self._given.shape[1:]

    def __len__(self) -> int:
        return len(self._given)

    def samples(self) -> Iterator[_Singles]:
        return (_checked_field(field, self.shape) for field in self._given)

    def at(self, moment: float, loops: bool) -> _Singles:
        count = len(self._given)
        place = moment * (count if loops else count - 1)
        before = min(int(place), count - 1)
        share = np.float32(place - before)
        first = self._given[before].astype(np.float32)
        if share == 0:
            return first
        after = self._given[(before + 1) % count].astype(np.float32)
        return (1 - share) * first + share * after


class _Function:
    """A function of time that returns velocities."""

    def __init__(self, function: FieldOfTime) -> None:
        self._function = function
        self.shape = _checked_field(as_array(function(0.0), "velocity"), None).shape

    def __len__(self) -> int:
        return _MOMENTS

    def samples(self) -> Iterator[_Singles]:
        return (self.at(moment, False) for moment in np.linspace(0.0, 1.0, _MOMENTS))

    def at(self, moment: float, loops: bool) -> _Singles:
        return _checked_field(as_array(self._function(float(moment)), "velocity"), self.shape)


def _checked_field(field: npt.NDArray, shape: tuple[int, ...] | None) -> _Singles:
    if shape is not None and field.shape != shape:
        raise InvalidSignal(
            f"The velocity has the shape {field.shape} at one moment and {shape} at another;"
            " give the same for all."
        )
    if field.ndim != 3 or field.shape[-1] != 2 or field.size == 0:
        raise InvalidSignal(f"The velocity has the shape {field.shape}; give (h, w, 2).")
    if field.dtype.kind not in "fiu":
        raise InvalidSignal(f"The velocity is of type {field.dtype}; give floats.")
    # To float16 that limit would be infinity.
    if (
        field.dtype.kind == "f"
        and (abs(field) > min(_LARGEST, float(np.finfo(field.dtype).max))).any()
    ):
        raise InvalidSignal(
            "The velocity holds infinity or values beyond 1e30; give NaN where it is undefined."
        )
    return field.astype(np.float32)


def _places(
    count: int, given: int, wraps: bool
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], _Singles]:
    # How pixels interpolate a field of another resolution along an axis: two samples and a share.
    places = (np.arange(count) + 0.5) * (given / count) - 0.5
    if not wraps:
        places = np.clip(places, 0.0, given - 1.0)
    before = np.floor(places).astype(np.int64)
    after = (before + 1) % given if wraps else np.minimum(before + 1, given - 1)
    return before % given, after, (places - before).astype(np.float32)


@kernel
def _resample(
    start, stop, field, above, below, downs, left, right, rights, scale, longest,
    to_right, to_down, defined,
):  # fmt: skip
    for i in range(start, stop):
        for j in range(to_right.shape[1]):
            weight = x = y = np.float32(0)
            for corner in range(4):
                row = below[i] if corner & 2 else above[i]
                column = right[j] if corner & 1 else left[j]
                share = downs[i] if corner & 2 else np.float32(1) - downs[i]
                share *= rights[j] if corner & 1 else np.float32(1) - rights[j]
                u = field[row, column, 0]
                v = field[row, column, 1]
                if share > 0 and u == u and v == v:
                    weight += share
                    x += share * u
                    y += share * v
            inside = weight >= np.float32(0.5) and defined[i, j]
            factor = scale / weight if inside else np.float32(0)
            x *= factor
            y *= -factor
            length = np.sqrt(x * x + y * y)
            if length > longest:  # between the moments at which a function of time was asked
                x *= longest / length
                y *= longest / length
            to_right[i, j] = x if inside else np.float32(0)
            to_down[i, j] = y if inside else np.float32(0)
            defined[i, j] = inside
