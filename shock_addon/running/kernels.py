# SPDX-License-Identifier: GPL-3.0-or-later
"""Loading of the compiled kernels on first use, and the folder of their cache."""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import os
import shutil
import threading
import time
from functools import cache
from typing import Any

import bpy

from ... import __version__
from ...core import registry
from ...core.base import cache_folder
from ...core.errors import ShockError

_PACKAGE = __package__.removesuffix(".shock_addon.running")
_REMEDY = (
    "what is missing comes inside the Shock Filter zip; install the zip that was made for this"
    " Blender version and platform"
)

_LIBRARIES = ("llvmlite", "numba", "scipy")

_UNUSABLE = (
    ImportError, OSError, AttributeError, TypeError, ValueError, RuntimeError, SystemError,
)  # fmt: skip
"""Errors from importing a broken library, or incompatible versions."""

_loading = threading.Lock()
_import_error = ""
_compiler: Any = None
"""Listener for numba's compiler; None until numba is loaded."""


class KernelsUnavailable(ShockError):
    """Numba or scipy is missing or cannot be imported."""


def problem() -> str:
    """Return why the kernels cannot run, with the remedy; empty if no reason is known."""
    missing = _missing()
    if missing:
        return f"{missing} cannot be found: {_REMEDY}."
    return _import_error


@cache
def _missing() -> str:
    return ", ".join(name for name in _LIBRARIES if importlib.util.find_spec(name) is None)


def _places() -> str:
    specs = {name: importlib.util.find_spec(name) for name in _LIBRARIES}
    return ", ".join(
        f"{name} in {os.path.dirname(spec.origin or '')}" for name, spec in specs.items() if spec
    )


def register() -> None:
    """Choose the extension's user folder for compiled code.

    Extensions must not write to their own folder. Otherwise numba chooses.
    """
    if _PACKAGE.startswith("bl_ext."):
        cache_folder.chosen = bpy.utils.extension_path_user(_PACKAGE, path=f"kernels-{__version__}")


@cache
def choose_folder() -> None:
    """Choose the session's temporary folder if the user folder is not writable.

    To be called on the main thread, before kernels are imported.
    """
    if cache_folder.chosen is None:
        return
    import tempfile

    with contextlib.suppress(OSError):  # another Blender may do the same
        _take_over(cache_folder.chosen)
    try:
        os.makedirs(cache_folder.chosen, exist_ok=True)
        with tempfile.TemporaryFile(dir=cache_folder.chosen):
            pass
    except OSError:
        cache_folder.chosen = os.path.join(bpy.app.tempdir, "shock_filter_kernels")


def _take_over(folder: str) -> None:
    """Reuse code compiled by another version, and remove that of a third version.

    Code whose sources differ is compiled anew, as files name their sources.
    """
    parent = os.path.dirname(folder)
    if not os.path.isdir(parent):
        return
    others = [entry.path for entry in os.scandir(parent) if entry.name.startswith("kernels-")]
    others = sorted({*others} - {folder}, key=os.path.getmtime)
    if others and not os.path.isdir(folder):
        os.rename(others.pop(), folder)
    for other in others:
        shutil.rmtree(other, ignore_errors=True)


def load() -> None:
    """Import the core's kernels; safe on any thread.

    Raises
    ------
    KernelsUnavailable
        If numba, scipy or a library below them is missing or cannot be imported.
    """
    global _import_error
    with _loading:
        _import_error = ""
        if problem():
            raise KernelsUnavailable(problem())
        try:
            _watch_compiler()
            for name in registry.kernel_modules():
                importlib.import_module(name)
        except _UNUSABLE as error:
            import logging

            logging.getLogger(__name__).exception("The compiled kernels cannot be loaded.")
            _import_error = (
                f"The compiled kernels cannot be loaded ({error}): {_REMEDY}, and remove other"
                f" copies. Found: {_places()}."
            )
            raise KernelsUnavailable(_import_error) from error


def _watch_compiler() -> None:
    global _compiler
    from numba.core import event

    class Compiler(event.Listener):
        depth, seconds = 0, 0.0  # compiling a kernel compiles those that it calls

        def on_start(self, event: Any) -> None:
            if not self.depth:
                self.began = time.perf_counter()
            self.depth += 1

        def on_end(self, event: Any) -> None:
            self.depth -= 1
            if not self.depth:
                self.seconds += time.perf_counter() - self.began

    if _compiler is None:
        _compiler = Compiler()
        event.register("numba:compile", _compiler)


def is_compiling() -> bool:
    """Whether a kernel is being compiled, on any thread."""
    return _compiler is not None and _compiler.depth > 0


def seconds_compiling() -> float:
    """Return the seconds of compiling in this session, without those of loading from disk."""
    return 0.0 if _compiler is None else _compiler.seconds


def unregister() -> None:
    """Check again for numba and scipy at the next use."""
    global _compiler, _import_error
    if _compiler is not None:
        from numba.core import event

        event.unregister("numba:compile", _compiler)
    _compiler, _import_error = None, ""
    cache_folder.chosen = None
    _missing.cache_clear()
    choose_folder.cache_clear()
