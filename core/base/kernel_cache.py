# SPDX-License-Identifier: GPL-3.0-or-later
"""Compiled code on disk that may be damaged, full, shared or old: it can only cost time.

numba keeps compiled kernels in files. A file that was cut short (a full disk, a lost power
supply) would stop every later run, and so would a disk without room; two processes that fill an
empty folder at once can leave one's code under the other's types. Then kernels are compiled again.
So they are where a source file has changed that a kernel's file imports: numba itself looks at the
kernel's own file only, and its date.
"""

from __future__ import annotations

import hashlib
import logging
import os
import pickle
import re
from functools import cache
from pathlib import Path
from typing import Any

from numba.core import config
from numba.core.caching import CompileResultCacheImpl, FunctionCache, UserProvidedCacheLocator

from . import cache_folder

log = logging.getLogger(__name__)

_UNREADABLE = (OSError, EOFError, pickle.UnpicklingError, ValueError, TypeError, LookupError,
               AttributeError, ImportError, RuntimeError)  # fmt: skip

_IMPORT = re.compile(r"^from (\.+)([\w.]*) import ([^(\n]+|\([^)]*\))", re.MULTILINE)


class _ChosenFolder(UserProvidedCacheLocator):
    """Files go where the host program says."""

    def __init__(self, py_func: Any, py_file: str) -> None:
        super().__init__(py_func, py_file)
        below = self.get_suitable_cache_subpath(py_file)
        self._cache_path = os.path.join(cache_folder.chosen or "", below)

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> Any:
        """Pass on to numba's own places where nothing was chosen."""
        chosen = cache_folder.chosen and not config.CACHE_DIR  # type: ignore[attr-defined]
        return (
            super(UserProvidedCacheLocator, cls).from_function(py_func, py_file) if chosen else None
        )


class _Files(CompileResultCacheImpl):
    _locator_classes = [_ChosenFolder, *CompileResultCacheImpl._locator_classes]


class KernelCache(FunctionCache):
    """numba's cache of one kernel, except that no file in it can make a run fail."""

    _impl_class = _Files

    def __init__(self, py_func: Any) -> None:
        super().__init__(py_func)
        self._cache_file._source_stamp = _stamp(Path(py_func.__code__.co_filename))

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled code for some types, or None where there is none to be used."""
        try:
            found = super().load_overload(sig, target_context)
        except _UNREADABLE as error:
            log.warning("Compiled code in %s is damaged (%s); compiling again.",
                        self.cache_path, error)  # fmt: skip
            self._forget()
            return None
        if found is not None and tuple(found.signature.args) != tuple(sig):
            return None
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep compiled code, if the disk lets us."""
        try:
            super().save_overload(sig, data)
        except _UNREADABLE as error:
            log.warning("Compiled code cannot be kept in %s (%s).", self.cache_path, error)

    def _forget(self) -> None:
        try:
            self.flush()
        except OSError as error:
            log.warning("%s cannot be written to (%s).", self.cache_path, error)


def keep_on_disk(kernel: Any) -> Any:
    """Give a kernel, as ``njit`` returns it, its cache; without any where none can be written."""
    try:
        kernel._cache = KernelCache(kernel.py_func)
    except RuntimeError as error:  # numba finds no folder to write to
        log.warning("Compiled code is not kept: %s", error)
    return kernel


@cache
def _stamp(path: Path) -> str:
    """Digest a source file and all that it imports from this package."""
    found = {path}
    left = [path]
    while left:
        imported = _imported(left.pop()) - found
        found |= imported
        left += imported
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
