# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks of signals, masks, images and settings; errors name what is wrong."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from typing import Any, ParamSpec, SupportsInt, TypeGuard, TypeVar

import numpy as np
import numpy.typing as npt

from ..errors import InvalidSettings, InvalidSignal
from .progress import ask

Floats = npt.NDArray[np.float64]


_Words = ParamSpec("_Words")
_Result = TypeVar("_Result")


def by_keyword(function: Callable[_Words, _Result]) -> Callable[_Words, _Result]:
    """Name the keywords in the `TypeError` of a call that gives too much by position.

    Public functions take the data and the settings after it by position, and all else by keyword.
    Python's own message only counts the arguments.
    """
    code, name = function.__code__, function.__qualname__.removesuffix(".__init__")
    places = code.co_varnames[: code.co_argcount]
    keywords = code.co_varnames[code.co_argcount :][: code.co_kwonlyargcount]

    @wraps(function)
    def call(*values: _Words.args, **words: _Words.kwargs) -> _Result:
        if len(values) > len(places):
            missed = [word for word in keywords if word not in words]
            raise TypeError(
                f"{name} takes {', '.join(word for word in places if word != 'self')} by position,"
                f" and all else by keyword; write {'=..., '.join(missed)}=..."
            )
        return function(*values, **words)

    return call


LARGEST = 1e30
"""Largest values of signals: flows hold their fourth powers, which must stay finite."""


def as_array(values: npt.ArrayLike, what: str) -> npt.NDArray:
    """Return `values` as an array; raises `InvalidSignal` if rows differ or values are masked."""
    if np.ma.is_masked(values):
        raise InvalidSignal(f"The {what} holds masked values; fill these first.")
    try:
        return np.asarray(values)
    except ValueError as error:
        raise InvalidSignal(f"The {what} is not made of numbers; give floats.") from error


def checked_word(word: str, name: str, choices: Iterable[str]) -> str:
    """Return `word` if it is one of the choices, or raise `InvalidSettings`."""
    if not isinstance(word, str) or word not in choices:
        raise InvalidSettings(f"{name} is {word!r}; choose one of: {', '.join(choices)}.")
    return word


def is_whole(number: object) -> TypeGuard[SupportsInt]:
    """Whether an object is a whole number of Python or numpy, of integer or float type."""
    if isinstance(number, (bool, np.bool_)):
        return False
    if isinstance(number, (float, np.floating)):
        return bool(number == np.floor(number)) and bool(np.isfinite(number))
    return isinstance(number, (int, np.integer))


def checked_count(number: object, name: str, least: int = 0, most: int | None = None) -> int:
    """Return a whole number from `least` to `most`, or raise `InvalidSettings`."""
    if not is_whole(number) or int(number) < least or (most is not None and int(number) > most):
        bounds = f"from {least}" if most is None else f"from {least} to {most}"
        raise InvalidSettings(f"{name} is {number!r}; give a whole number {bounds}.")
    return int(number)


def checked_number(number: Any, name: str, most: float = np.inf) -> float:
    """Return a number above 0 and up to `most`, or raise `InvalidSettings`."""
    is_number = isinstance(number, (int, float, np.integer, np.floating))
    if not is_number or isinstance(number, bool) or not 0 < number <= min(most, sys.float_info.max):
        bounds = "positive number" if most == np.inf else f"value in (0, {most:g}]"
        raise InvalidSettings(f"{name} is {number!r}; give a {bounds}.")
    return float(number)


def checked_angle(angle: Any, name: str, least: float, most: float) -> float:
    """Return an angle in degrees from `least` to `most`, or raise `InvalidSettings`."""
    is_number = isinstance(angle, (int, float, np.integer, np.floating))
    if not is_number or isinstance(angle, bool) or not least <= angle <= most:
        raise InvalidSettings(f"{name} is {angle!r}; give degrees from {least:g} to {most:g}.")
    return float(angle)


def checked_indices(
    indices: npt.ArrayLike, count: int, what: str, one: str
) -> npt.NDArray[np.int64]:
    """Return whole numbers below `count` as int64, or raise `InvalidSignal`."""
    given = as_array(indices, f"list of {what}")
    if given.size == 0:
        return np.zeros(given.shape, dtype=np.int64)
    if given.dtype.kind not in "iu":
        raise InvalidSignal(f"The {what} are of type {given.dtype}; give whole numbers.")
    if given.min() < 0 or given.max() >= count:
        wrong = given.min() if given.min() < 0 else given.max()
        raise InvalidSignal(f"There is no {one} {wrong}; give numbers from 0 to {count - 1}.")
    return given.astype(np.int64)


def checked_flag(value: object, name: str) -> bool:
    """Return a flag as a bool, or raise `InvalidSettings`."""
    if not isinstance(value, (bool, np.bool_, int)):
        raise InvalidSettings(f"{name} is {value!r}; give True or False.")
    return bool(value)


MOST_ROWS = 1 << 15
"""Most rows or columns of textures, and of images whose size is given."""


def checked_size(size: Any) -> tuple[int, int]:
    """Return the rows and columns of an image to make, or raise `InvalidSettings`."""
    is_row = isinstance(size, (tuple, list)) or (isinstance(size, np.ndarray) and size.ndim == 1)
    if not is_row or len(size) != 2:
        raise InvalidSettings(f"size is {size!r}; give the image's rows and columns.")
    rows, columns = size
    return (
        checked_count(rows, "The number of rows in size", 1, MOST_ROWS),
        checked_count(columns, "The number of columns in size", 1, MOST_ROWS),
    )


def checked_signal(
    signal: npt.ArrayLike,
    count: int,
    what: str = "signal",
    largest: float = LARGEST,
) -> Floats:
    """Return `signal` as a C-contiguous (count, d) float64 array, or raise `InvalidSignal`."""
    given = as_array(signal, what)
    if given.dtype.kind not in "fiub":
        raise InvalidSignal(f"The {what} is of type {given.dtype}, not numbers; give floats.")
    array = np.ascontiguousarray(given, dtype=np.float64)
    if array.ndim == 1:
        array = array.reshape(-1, 1)
    if array.ndim != 2 or len(array) != count or array.shape[1] == 0:
        raise InvalidSignal(
            f"The {what} has the shape {given.shape}; give ({count},) or ({count}, channels)."
        )
    ask()
    if not np.isfinite(array).all():
        raise InvalidSignal(f"The {what} holds NaN or infinity; replace these values first.")
    ask()
    if max(array.max(), -array.min()) > largest:
        raise InvalidSignal(f"The {what} holds values beyond {largest:g}; scale or clip them.")
    return array


def checked_mask(mask: npt.ArrayLike | None, count: int) -> Floats | None:
    """Return a mask as (count,) float64 in [0, 1], or None where all weights are 1."""
    if mask is None:
        return None
    array = checked_signal(mask, count, "mask")
    if array.shape[1] != 1 or np.ndim(mask) != 1:
        raise InvalidSignal(f"The mask has the shape {np.shape(mask)}; give ({count},).")
    weights = array.reshape(-1)
    if weights.min() < 0 or weights.max() > 1:
        raise InvalidSignal("The mask leaves the range 0 to 1; clip or rescale it.")
    return None if weights.min() == 1 else weights


def checked_type(signal: npt.ArrayLike) -> npt.NDArray:
    """Return a signal as an array, or raise `InvalidSignal` unless it is of float type."""
    array = as_array(signal, "signal")
    if array.dtype not in (np.float32, np.float64):
        raise InvalidSignal(
            f"The signal is of type {array.dtype}; give float32 or float64, colors in [0, 1]."
        )
    return array


SCALES = {"uint8": 1.0 / 255.0, "uint16": 1.0 / 65535.0, "float32": 1.0, "float64": 1.0}
"""The types of images, each with the factor that brings its values to [0, 1]."""


def is_dask(array: Any) -> TypeGuard[Any]:
    """Whether an array is a dask array; does not import dask to find out."""
    dask = sys.modules.get("dask.array")
    return dask is not None and isinstance(array, dask.Array)


def refuse_with_dask(**words: Any) -> None:
    """Raise `InvalidSettings` for parameters that are given but have no meaning for dask arrays."""
    for name, given in words.items():
        if given is not None:
            raise InvalidSettings(
                f"{name} is given with a dask array, which is computed later and elsewhere; leave"
                " it out."
            )


BAND = 256
"""Rows of an image that numpy processes at once."""


def checked_image(image: npt.ArrayLike, largest: float | None = None) -> npt.NDArray:
    """Return the image as a contiguous array; raises `InvalidSignal` if it cannot be filtered.

    Values up to `largest` are taken; None sets no limit.
    """
    array = as_array(image, "image")
    check_kind_of_image(array)
    array = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("="))
    if array.dtype.kind == "f":
        for start in range(0, len(array), BAND):
            if not np.isfinite(array[start : start + BAND]).all():
                raise InvalidSignal("The image holds NaN or infinity; replace these values first.")
        if largest is not None and max(-float(array.min()), float(array.max())) > largest:
            raise InvalidSignal(
                "The image holds values beyond {most:g}; scale or clip them.", most=largest
            )
    return array


def check_kind_of_image(array: Any) -> None:
    """Raise `InvalidSignal` if images of this type or shape cannot be filtered."""
    if array.dtype.name not in SCALES:
        raise InvalidSignal(
            f"The image is of type {array.dtype}; give uint8, uint16, float32 or float64."
        )
    if array.ndim not in (2, 3) or array.size == 0:
        raise InvalidSignal(f"The image has the shape {array.shape}; give (h, w) or (h, w, c).")


def checked_out(
    out: npt.NDArray | None, given: npt.NDArray, times: int = 1, others: Sequence[Any] = ()
) -> npt.NDArray:
    """Return the array for a result `times` as large: `out` if it fits, or a new one if None.

    It shares no memory with the image and what `others` there are.
    """
    shape = (times * given.shape[0], times * given.shape[1], *given.shape[2:])
    if out is None:
        return np.empty(shape, given.dtype)
    if not isinstance(out, np.ndarray):
        raise InvalidSignal(
            f"out is of type {type(out).__name__}; give a contiguous {given.dtype} array of shape"
            f" {shape}."
        )
    if out.shape != shape or out.dtype != given.dtype or not out.flags.carray:
        raise InvalidSignal(
            f"out is {out.dtype} of shape {out.shape}; give a contiguous {given.dtype} array of"
            f" shape {shape} that can be written to."
        )
    arrays = [given, *(each for each in others if isinstance(each, np.ndarray))]
    if any(np.may_share_memory(out, each) for each in arrays):
        raise InvalidSignal("out shares memory with what is given; give another array.")
    return np.asarray(out)


def check_shape_of_mask(mask: Any, given: Any) -> None:
    """Raise `InvalidSignal` unless a mask has the size of the image."""
    if mask.shape != given.shape[:2]:
        raise InvalidSignal(f"The mask has the shape {mask.shape}; give {given.shape[:2]}.")


def checked_weights(mask: npt.ArrayLike | None, given: Any) -> npt.NDArray | None:
    """Return the mask as float64; raises `InvalidSignal` if it does not fit the image."""
    if mask is None:
        return None
    weights = as_array(mask, "mask")
    check_shape_of_mask(weights, given)
    if weights.dtype.kind not in "bfiu" or not np.isfinite(weights).all():
        raise InvalidSignal("The mask holds NaN, infinity or no numbers; give weights in [0, 1].")
    if weights.min() < 0 or weights.max() > 1:
        raise InvalidSignal("The mask leaves the range 0 to 1; clip or rescale it.")
    return weights.astype(np.float64, copy=False)
