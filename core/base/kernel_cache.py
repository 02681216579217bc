# SPDX-License-Identifier: GPL-3.0-or-later
"""Compiled code on disk that may be damaged, old, foreign or shared: it can only cost time.

numba's own files are believed: bits that a disk turned, a file cut short, or the code of one of two
processes under the other's types end a later run, or the whole process. Here each file begins with
a digest of all that its code depends on and a checksum of the code; what does not fit is compiled
again. Part of that are the source files that a kernel's file imports: numba looks at the kernel's
own file only, and its date.
"""

from __future__ import annotations

import hashlib
import logging
import pickle
import re
from functools import cache
from pathlib import Path
from typing import Any
from zlib import crc32

from numba.core import config
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    InTreeCacheLocator,
    UserProvidedCacheLocator,
    UserWideCacheLocator,
)

from . import cache_folder

log = logging.getLogger(__name__)

_HEAD_SIZE = 16 + 4
_IMPORT = re.compile(r"^from (\.+)([\w.]*) import ([^(\n]+|\([^)]*\))", re.MULTILINE)


class _ChosenFolder(UserProvidedCacheLocator):
    """Files go where the host program says."""

    def __init__(self, py_func: Any, py_file: str) -> None:
        super().__init__(py_func, py_file)
        self._cache_path = cache_folder.chosen  # for all kernels alike: it may move, or be copied

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> Any:
        """Pass on to numba's own places where nothing was chosen."""
        chosen = cache_folder.chosen and not config.CACHE_DIR  # type: ignore[attr-defined]
        return (
            super(UserProvidedCacheLocator, cls).from_function(py_func, py_file) if chosen else None
        )


class _Places(CompileResultCacheImpl):
    _locator_classes = [
        _ChosenFolder,
        UserProvidedCacheLocator,
        InTreeCacheLocator,
        UserWideCacheLocator,
    ]


class _Files(IndexDataCacheFile):
    """A kernel's files: one for each combination of types and each kind of processor, no index."""

    def load(self, key: Any) -> Any:
        """Return what was saved under a key; None where nothing was."""
        try:
            content = Path(self._path(key)).read_bytes()
        except FileNotFoundError:
            return None
        code = content[_HEAD_SIZE:]
        if content[:_HEAD_SIZE] != self._head(key, code):
            raise ValueError("it is damaged or old")
        return pickle.loads(code)

    def save(self, key: Any, data: Any) -> None:
        """Save what belongs to a key: whole, or not at all."""
        code = self._dump(data)
        with self._open_for_write(self._path(key)) as file:
            file.write(self._head(key, code) + code)

    def _path(self, key: Any) -> str:
        types, processor, _ = key  # an edited kernel takes the place of the old one
        module, _ = self._source_stamp
        name = hashlib.blake2b(repr((module, types, processor)).encode(), digest_size=6)
        return self._data_path(self._data_name(int.from_bytes(name.digest(), "big")))

    def _head(self, key: Any, code: bytes) -> bytes:
        needs = repr((self._version, self._source_stamp, key)).encode()
        return hashlib.blake2b(needs, digest_size=16).digest() + crc32(code).to_bytes(4)


class KernelCache(FunctionCache):
    """numba's cache of one kernel, except that no file in it can make a run fail."""

    _impl_class = _Places

    def __init__(self, py_func: Any) -> None:
        super().__init__(py_func)
        # Compiled code names its kernel's module, and imports it.
        stamp = py_func.__module__, _stamp(Path(py_func.__code__.co_filename))
        self._cache_file = _Files(self.cache_path, self._impl.filename_base, stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled code for some types, or None where there is none to be used."""
        try:
            return super().load_overload(sig, target_context)
        except Exception as error:  # other versions of libraries can fail in any way
            log.info("Code in %s is compiled again: %s", self.cache_path, error)
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep compiled code, if the disk lets us."""
        try:
            super().save_overload(sig, data)
        except Exception as error:
            log.warning("Compiled code cannot be kept in %s (%s).", self.cache_path, error)


def keep_on_disk(kernel: Any) -> Any:
    """Give a kernel, as ``njit`` returns it, its cache; without any where none can be written."""
    try:
        kernel._cache = KernelCache(kernel.py_func)
    except (RuntimeError, OSError) as error:  # no folder to write to, or no source to read
        log.warning("Compiled code is not kept: %s", error)
    return kernel


@cache
def _stamp(path: Path) -> str:
    """Digest a source file and all that it imports from this package."""
    found = [path]
    for file in found:  # which grows meanwhile
        found += _imported(file).difference(found)
    digest = hashlib.sha256()
    for file in sorted(found):
        digest.update(_text(file))
    return digest.hexdigest()


@cache
def _imported(path: Path) -> frozenset[Path]:
    """Find the modules that a file imports relatively, at its top."""
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
