# SPDX-License-Identifier: GPL-3.0-or-later
"""Compiled code on disk that may be damaged, full or shared: it can only cost time.

numba keeps compiled kernels in files. A file that was cut short (a full disk, a lost power
supply) would stop every later run, and so would a disk without room; two processes that fill an
empty folder at once can leave one's code under the other's types. Then kernels are compiled again.
"""

from __future__ import annotations

import logging
import pickle
from typing import Any

from numba.core.caching import FunctionCache

log = logging.getLogger(__name__)

_UNREADABLE = (OSError, EOFError, pickle.UnpicklingError, ValueError, TypeError, LookupError,
               AttributeError, ImportError, RuntimeError)  # fmt: skip


class KernelCache(FunctionCache):
    """numba's cache of one kernel, except that no file in it can make a run fail."""

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
