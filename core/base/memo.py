# SPDX-License-Identifier: GPL-3.0-or-later
"""Memoization: caches results with the object they were computed from, for the next run on it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

Result = TypeVar("Result")


def kept(owner: Any, name: str, key: tuple[Any, ...], make: Callable[[], Result]) -> Result:
    """Return the cached result of this owner and key, or call `make` and cache its result.

    The last result of each name lives as long as the owner. Callers must not modify it.

    Parameters
    ----------
    owner : object
        For example a mesh; it must not change from now on.
    name : str
        The name of the result.
    key : tuple
        What the result depends on besides the owner; arrays are compared by their bits.
    make : callable
        Computes the result. Threads that ask at the same time may each call it.
    """
    results: dict[str, tuple[tuple[Any, ...], Any]] = owner.__dict__.setdefault("_kept", {})
    old = results.get(name)
    if old is not None and equal(old[0], key):
        return old[1]
    result = make()
    # Callers may change their arrays later.
    own = tuple(part.copy() if isinstance(part, np.ndarray) else part for part in key)
    results[name] = own, result
    return result


def equal(first: tuple[Any, ...], second: tuple[Any, ...]) -> bool:
    """Compare two keys: arrays by type, shape and bits, all else by equality."""
    return len(first) == len(second) and all(map(_same, first, second))


def _same(first: Any, second: Any) -> bool:
    if isinstance(first, np.ndarray) and isinstance(second, np.ndarray):
        alike = first.dtype == second.dtype and first.shape == second.shape
        return alike and np.array_equal(_bits(first), _bits(second))
    if isinstance(first, np.ndarray) or isinstance(second, np.ndarray):
        return False
    return bool(first == second)


def _bits(array: npt.NDArray) -> npt.NDArray[np.unsignedinteger]:
    # 0.0 and -0.0 are equal numbers, but results keep the sign. Wide integers compare faster.
    width = array.dtype.itemsize
    kind = f"u{width}" if width in {4, 8} else "u1"
    return np.ascontiguousarray(array).reshape(-1).view(kind)
