# SPDX-License-Identifier: GPL-3.0-or-later
"""A cache of compiled code on disk: damaged, old, foreign or shared files only cost time.

numba trusts its cache files: flipped bits, a truncated file, or the code of one of two processes
under the other's types make a later run fail or crash the process. Here each file begins with a
digest of all that its code depends on and a checksum of the code; code that does not match is
compiled again. The digest covers the source files that a kernel's file imports: numba compares
the kernel's own file only, by its date.
"""

from __future__ import annotations

import hashlib
import logging
import pickle
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any
from zlib import crc32

from numba import njit
from numba import types as numba_types
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    InTreeCacheLocator,
    UserProvidedCacheLocator,
    UserWideCacheLocator,
)
from numba.extending import typeof_impl

log = logging.getLogger(__name__)

_HEAD_SIZE = 16 + 4
_IMPORT = re.compile(r"^from (\.+)([\w.]*) import ([^(\n]+|\([^)]*\))", re.MULTILINE)


class _Places(CompileResultCacheImpl):
    _locator_classes = [UserProvidedCacheLocator, InTreeCacheLocator, UserWideCacheLocator]


class _Files(IndexDataCacheFile):
    """A kernel's files: one for each combination of types and each kind of processor, no index."""

    def load(self, key: Any) -> Any:
        """Return the data saved under a key, or None."""
        try:
            content = Path(self._path(key)).read_bytes()
        except FileNotFoundError:
            return None
        code = content[_HEAD_SIZE:]
        if content[:_HEAD_SIZE] != self._head(key, code):
            raise ValueError("it is damaged or old")
        return pickle.loads(code)

    def save(self, key: Any, data: Any) -> None:
        """Save the data of a key: all of it, or none."""
        code = self._dump(data)
        with self._open_for_write(self._path(key)) as file:
            file.write(self._head(key, code) + code)

    def _path(self, key: Any) -> str:
        types, processor, _ = key  # an edited kernel replaces the old one
        module, _ = self._source_stamp
        name = hashlib.blake2b(repr((module, types, processor)).encode(), digest_size=6)
        return self._data_path(self._data_name(int.from_bytes(name.digest(), "big")))

    def _head(self, key: Any, code: bytes) -> bytes:
        needs = repr((self._version, self._source_stamp, key)).encode()
        return hashlib.blake2b(needs, digest_size=16).digest() + crc32(code).to_bytes(4)


class KernelCache(FunctionCache):
    """numba's cache of one kernel, except that none of its files can make a run fail."""

    _impl_class = _Places

    def __init__(self, py_func: Any) -> None:
        super().__init__(py_func)
        # Compiled code holds its kernel's module name and imports that module.
        stamp = py_func.__module__, _stamp(Path(py_func.__code__.co_filename))
        self._cache_file = _Files(self.cache_path, self._impl.filename_base, stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled code for some types, or None if there is none that can be used."""
        try:
            return super().load_overload(sig, target_context)
        except Exception as error:  # other versions of libraries can raise anything
            log.info("Code in %s is compiled again: %s", self.cache_path, error)
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep compiled code if the disk allows it."""
        try:
            super().save_overload(sig, data)
        except Exception as error:
            log.warning("Compiled code cannot be kept in %s (%s).", self.cache_path, error)


_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
"""No C code calls kernels: a wrapper for it would take some of the time to compile."""


def compile_kernel(function: Callable[..., Any], keep: bool = True) -> Any:
    """Return numba's dispatcher of a kernel; `keep` its code on disk."""
    kernel = njit(**_OPTIONS)(function)
    return keep_on_disk(kernel) if keep else kernel


@cache
def let_numba_call(kind: type) -> None:
    """Let kernels that numba compiles call those of a class with a numba `dispatcher`."""
    typeof_impl.register(kind)(lambda kernel, _: numba_types.Dispatcher(kernel.dispatcher))


def keep_on_disk(kernel: Any) -> Any:
    """Give a kernel, as ``njit`` returns it, its cache; leave it without if none can be written."""
    try:
        kernel._cache = KernelCache(kernel.py_func)
    except (RuntimeError, OSError) as error:  # no folder to write to, or no source to read
        log.warning("Compiled code is not kept: %s", error)
    return kernel


@cache
def _stamp(path: Path) -> str:
    """Digest a source file and all files of this package that it imports."""
    files = [path]
    for file in files:  # grows during the loop
        files += _imported(file).difference(files)
    digest = hashlib.sha256()
    for file in sorted(files):
        digest.update(_text(file))
    return digest.hexdigest()


@cache
def _imported(path: Path) -> frozenset[Path]:
    """Find the modules that a file imports relatively at its top."""
    found: set[Path] = set()
    for dots, module, names in _IMPORT.findall(_text(path).decode()):
        place = path.parents[len(dots) - 1].joinpath(*module.split("."))
        below = [place / name for name in re.findall(r"(\w+)(?: as \w+)?", names)]
        for imported in (place, *below):
            found |= {imported.with_suffix(".py"), imported / "__init__.py"}
    return frozenset(file for file in found if file.is_file())


@cache
def _text(path: Path) -> bytes:
    return path.read_bytes()
