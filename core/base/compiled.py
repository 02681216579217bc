# SPDX-License-Identifier: GPL-3.0-or-later
"""Kernels compiled beforehand: one shared library, called by ctypes.

The extension comes with the package `shock_filter_kernels_VERSION`, made by tools/build_kernels.py:
the library of one platform, and a table of the kernels' symbols and types. Elsewhere numba compiles
the kernels; it also compiles what the library lacks, where it is installed.

A kernel gets slots of 8 bytes: an array has ``0, 0, size, itemsize, address, *shape, *strides``, a
tuple has the slots of its items, a number has one.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import importlib.util
import json
import os
import pickle
import re
import struct
from collections.abc import Callable
from ctypes import byref
from pathlib import Path
from typing import Any

import numpy as np

from ... import __version__
from ..errors import KernelMissing

_CORE = Path(__file__).parents[1]

PACKAGE = "shock_filter_kernels_" + re.sub(r"\W", "_", __version__)
"""Name of the package with the library: versions have packages of their own, as all extensions of
Blender share one folder of packages."""

TABLE = "kernels.json"
"""Name of the table in that package."""

_REMEDY = "install the Shock Filter zip for this platform again, and restart Blender"


class Library:
    """A shared library with its table.

    Parameters
    ----------
    folder : Path
        The folder of the table, which names the library beside it.

    Raises
    ------
    OSError
        If the library cannot be loaded.
    ValueError
        If it was built from other sources than those of this package.
    """

    def __init__(self, folder: Path) -> None:
        about = json.loads((folder / TABLE).read_text(encoding="utf-8"))
        if about["sources"] != sources_digest():
            raise ValueError("it was built from other sources")
        self._functions = ctypes.CDLL(str(folder / about["library"]))  # calls release the GIL
        self.free = self._functions["sf_free"]
        self.free.argtypes, self.free.restype = [ctypes.c_void_p], None
        self.is_wide = bool(self._functions["sf_is_wide"]())
        """Whether kernels for newer processors are used, where there are any."""
        self._kernels: dict[str, dict[str, list[Any]]] = about["kernels"]

    def find(self, name: str, types: list[str]) -> tuple[Any, Any] | None:
        """Return a kernel's function for given types and the type of its result, or None."""
        for known, (symbol, result, *wide) in self._kernels.get(name, {}).items():
            if _fits(types, known):
                function = self._functions[wide[0] if wide and self.is_wide else symbol]
                return function, result
        return None


@functools.cache
def library() -> Library | None:
    """Load the library that belongs to this package; None if there is none."""
    return _loaded()[0]


def library_problem() -> str:
    """Return why kernels cannot run, with the remedy; empty if the library or numba is there."""
    found, problem = _loaded()
    if found is not None or importlib.util.find_spec("numba"):
        return ""
    return f"The compiled kernels cannot be loaded ({problem}): {_REMEDY}."


@functools.cache
def _loaded() -> tuple[Library | None, str]:
    spec = importlib.util.find_spec(PACKAGE)
    if spec is None or spec.origin is None:
        return None, f"{PACKAGE} is missing"
    folder = Path(spec.origin).parent
    try:
        return Library(folder), ""
    except (OSError, ValueError, KeyError, AttributeError) as error:
        return None, f"{folder}: {error}"


def sources_digest() -> str:
    """Digest the source files of the core, in which all kernels are defined."""
    digest = hashlib.blake2b(digest_size=16)
    for path in sorted(_CORE.rglob("*.py"), key=lambda path: path.relative_to(_CORE).as_posix()):
        digest.update(path.relative_to(_CORE).as_posix().encode() + b"\n" + path.read_bytes())
    return digest.hexdigest()


class Kernel:
    """A kernel of the library.

    Parameters
    ----------
    function : callable
        Its source, for numba.

    Raises
    ------
    KernelMissing
        When called with types that the library lacks, if numba is not installed.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        functools.update_wrapper(self, function)
        self.py_func = function
        self.name = name_of(function)
        self._calls: dict[Any, _Call] = {}

    def __call__(self, *arguments: Any) -> Any:
        types = tuple([_key(each) for each in arguments])
        call = self._calls.get(types) or self._resolve(types, arguments)
        return call(arguments)

    def bind(self, *arguments: Any) -> Callable[[int, int], Any]:
        """Return a function of start and stop that calls the kernel with these arguments.

        For kernels without results, over many chunks: arguments are prepared once.
        """
        types = (int, int, *[_key(each) for each in arguments])
        call = self._calls.get(types) or self._resolve(types, (0, 0, *arguments))
        return call.bind(arguments)

    @functools.cached_property
    def dispatcher(self) -> Any:
        """The kernel compiled by numba; kept where NUMBA_CACHE_DIR says, never in an extension."""
        from .kernel_cache import compile_kernel, let_numba_call

        let_numba_call(Kernel)
        return compile_kernel(self.py_func, keep="NUMBA_CACHE_DIR" in os.environ)

    def _resolve(self, types: tuple[Any, ...], arguments: tuple[Any, ...]) -> _Call:
        call: Any = self._by_library(arguments) or self._by_numba()
        if call is None:  # the library may have it for arrays that are contiguous
            contiguous = _contiguous(arguments)
            known = self._by_library(contiguous)
            if known is None:
                raise KernelMissing(
                    "No kernel {name} was compiled for the types {types}: install numba, and report"
                    " this as a bug of Shock Filter.",
                    name=self.name,
                    types=", ".join(map(type_name, arguments)),
                )
            call = _CopyingCall(known)
        self._calls[types] = call
        return call

    def _by_library(self, arguments: tuple[Any, ...]) -> _Call | None:
        found = library()
        if found is None:
            return None
        entry = found.find(self.name, list(map(type_name, arguments)))
        return None if entry is None else _Call(self.name, arguments, *entry, found.free)

    def _by_numba(self) -> _NumbaCall | None:
        try:
            return _NumbaCall(self.dispatcher)
        except ImportError:
            return None


def name_of(function: Callable[..., Any]) -> str:
    """Return the name of a kernel in the table."""
    name = f"{function.__module__}:{function.__qualname__}"
    return name.partition(".core.")[2] or name


def type_name(value: Any) -> str:
    """Write the type of an argument as the table does.

    An array has numpy's dtype, its number of dimensions, its order (C, F, or A for any), and `r` if
    it is read only, as in ``<f82C``.
    """
    if type(value) is np.ndarray:
        flags = value.flags
        order = "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A"
        if not flags.aligned:
            order = "unaligned"
        return f"{value.dtype.str}{value.ndim}{order}{'' if flags.writeable else 'r'}"
    if isinstance(value, tuple):
        name = type(value).__name__ if hasattr(value, "_fields") else ""
        return f"{name}({','.join(map(type_name, value))})"
    if isinstance(value, np.generic):
        name = value.dtype.name
        return {"int64": "i", "float64": "f", "bool": "b"}.get(name, name)
    return _PLAIN.get(type(value)) or type(value).__name__


_PLAIN = {bool: "b", int: "i", float: "f", type(None): "n"}

_PART = re.compile(r"[(),]|[^(),]+")
_ARRAY = re.compile(r"([<>|=].*?\d)(\d)([CFA])(r?)")


def _fits(types: list[str], known: str) -> bool:
    # Whether values of these types can be given to a kernel compiled for others: arrays in any
    # order where those are known, writable ones where they are only read.
    given, taken = _PART.findall(",".join(types)), _PART.findall(known)
    return len(given) == len(taken) and all(map(_part_fits, given, taken))


def _part_fits(given: str, taken: str) -> bool:
    if given == taken:
        return True
    a, b = _ARRAY.fullmatch(given), _ARRAY.fullmatch(taken)
    if a is None or b is None:
        return False
    return a[1] + a[2] == b[1] + b[2] and b[3] in (a[3], "A") and (b[4] == "r" or a[4] != "r")


def _key(value: Any) -> Any:
    # A key that is equal only for values of one type in the table; cheaper than the type's name.
    if type(value) is np.ndarray:
        return value.dtype, value.ndim, value.flags.num
    if isinstance(value, tuple):
        return type(value), *map(_key, value)
    return type(value)


_RANGE = struct.Struct("@qq")


class _Call:
    """A kernel for some types: packs arguments, calls, and reads the result."""

    def __init__(
        self, name: str, arguments: tuple[Any, ...], function: Any, result: Any, free: Any
    ) -> None:
        self._name, self._function = name, function
        self._packing = struct.Struct("@" + "".join(map(_letters, arguments)))
        self._result = _Result(result, free) if result else None

    def __call__(self, arguments: tuple[Any, ...]) -> Any:
        slots: list[Any] = []
        for each in arguments:
            _slots(each, slots)
        error = ctypes.c_void_p()
        place = self._result.place() if self._result else ctypes.c_void_p()
        status = self._function(self._packing.pack(*slots), byref(place), byref(error))
        if status:
            raise _error(self._name, status, error)
        return self._result.read(place) if self._result else None

    def bind(self, arguments: tuple[Any, ...]) -> Callable[[int, int], Any]:
        slots: list[Any] = [0, 0]
        for each in arguments:
            _slots(each, slots)
        tail = self._packing.pack(*slots)[_RANGE.size :]

        function, error = self._function, ctypes.c_void_p()  # of any chunk that fails
        places = byref(ctypes.c_void_p()), byref(error)

        def call(start: int, stop: int, _kept: Any = arguments) -> Any:
            status = function(_RANGE.pack(start, stop) + tail, *places)
            if status:
                raise _error(self._name, status, error)

        return call


class _NumbaCall:
    """The same by numba."""

    def __init__(self, dispatcher: Any) -> None:
        self._dispatcher = dispatcher

    def __call__(self, arguments: tuple[Any, ...]) -> Any:
        return self._dispatcher(*arguments)

    def bind(self, arguments: tuple[Any, ...]) -> Callable[[int, int], Any]:
        return lambda start, stop: self._dispatcher(start, stop, *arguments)


class _CopyingCall:
    """The same with contiguous copies of arrays, whose values are copied back.

    Slower than a kernel for the types at hand, but no user lacks numba then.
    """

    def __init__(self, call: _Call) -> None:
        self._call = call

    def __call__(self, arguments: tuple[Any, ...]) -> Any:
        copies = _contiguous(arguments)
        result = self._call(copies)
        _copy_back(copies, arguments)
        return result

    def bind(self, arguments: tuple[Any, ...]) -> Callable[[int, int], Any]:
        copies = _contiguous(arguments)
        bound = self._call.bind(copies)

        def call(start: int, stop: int) -> Any:
            result = bound(start, stop)
            _copy_back(copies, arguments)
            return result

        return call


def _contiguous(value: Any) -> Any:
    # Arrays that are contiguous and writable, those of tuples included.
    if type(value) is np.ndarray:
        return np.require(value, requirements=["C", "A", "W"])
    if isinstance(value, tuple):
        parts = map(_contiguous, value)
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    return value


def _copy_back(copies: tuple[Any, ...], into: tuple[Any, ...]) -> None:
    for copy, given in zip(copies, into, strict=True):
        if isinstance(given, tuple):
            _copy_back(copy, given)
        elif copy is not given and type(given) is np.ndarray and given.flags.writeable:
            given[...] = copy


def _letters(value: Any) -> str:
    # How `struct` packs the slots of a value.
    if type(value) is np.ndarray:
        return f"{5 + 2 * value.ndim}q"
    if isinstance(value, tuple):
        return "".join(map(_letters, value))
    if isinstance(value, bool | np.bool_):
        return "?7x"
    if isinstance(value, float | np.float64):
        return "d"
    kind = value.dtype.name if isinstance(value, np.generic) else ""
    return {"float32": "f4x", "uint64": "Q"}.get(kind, "q")


_pointer_at = ctypes.c_void_p.from_address
_DATA = object.__basicsize__
"""Where an array keeps its address: after what all objects have, as numpy's ABI says."""


def _address(array: np.ndarray) -> int:
    # `array.ctypes.data` takes five times as long.
    return _pointer_at(id(array) + _DATA).value or 0


_probe = np.arange(3.0)[1:]
if _address(_probe) != _probe.ctypes.data:  # another kind of Python

    def _address(array: np.ndarray) -> int:
        return array.ctypes.data


def _slots(value: Any, into: list[Any]) -> None:
    if type(value) is np.ndarray:
        into += (0, 0, value.size, value.itemsize, _address(value))
        into += value.shape
        into += value.strides
    elif isinstance(value, tuple):
        for each in value:
            _slots(each, into)
    else:
        into.append(0 if value is None else value)


class _Result:
    """Reads what a kernel returns: a number, an array, or a tuple of these.

    Parameters
    ----------
    kinds : str or list of str
        Letters of `struct` for numbers, types of the table for arrays.
    free : callable
        Gives the memory of an array back.
    """

    def __init__(self, kinds: str | list[str], free: Any) -> None:
        self._is_one = isinstance(kinds, str)
        self._free = free
        self._kinds: list[np.dtype | None] = []
        self._sizes: list[int] = []  # in numbers
        letters = ""
        for kind in [kinds] if isinstance(kinds, str) else kinds:
            array = _ARRAY.fullmatch(kind)
            self._kinds.append(np.dtype(array[1]) if array else None)
            self._sizes.append(5 + 2 * int(array[2]) if array else 1)
            letters += f"{self._sizes[-1]}q" if array else kind
        self._packing = struct.Struct("@" + letters)

    def place(self) -> Any:
        return ctypes.create_string_buffer(self._packing.size)

    def read(self, place: Any) -> Any:
        numbers = iter(self._packing.unpack(place.raw))
        found = []
        for kind, size in zip(self._kinds, self._sizes, strict=True):
            part = [next(numbers) for _ in range(size)]
            found.append(part[0] if kind is None else self._copied(kind, part))
        return found[0] if self._is_one else tuple(found)

    def _copied(self, dtype: np.dtype, part: list[int]) -> np.ndarray:
        memory, _, _, _, address, *rest = part
        ndim = len(rest) // 2
        found: np.ndarray = np.empty(rest[:ndim], dtype)
        assert found.strides == tuple(rest[ndim:]) or not found.size
        ctypes.memmove(found.ctypes.data, address, found.nbytes)
        if memory:  # otherwise it was given
            self._free(memory)
        return found


_UNREADABLE = (
    pickle.UnpicklingError, EOFError, ImportError, AttributeError, IndexError, TypeError,
    ValueError,
)  # fmt: skip
"""Errors from reading an exception that this process cannot make."""


def _error(name: str, status: int, error: Any) -> Exception:
    # numba keeps the class and the arguments of an exception pickled.
    if status == 1 and error.value:
        data = ctypes.cast(error.value, ctypes.POINTER(ctypes.c_void_p))[0]
        size = ctypes.cast(error.value + 8, ctypes.POINTER(ctypes.c_int32))[0]
        try:
            kind, arguments, *_ = pickle.loads(ctypes.string_at(data, size))
            return kind(*arguments) if kind else RuntimeError(name)
        except _UNREADABLE as problem:
            return RuntimeError(f"{name} failed, and its error cannot be read: {problem!r}")
    return RuntimeError(f"{name} failed with status {status}.")
