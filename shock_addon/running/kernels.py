# SPDX-License-Identifier: GPL-3.0-or-later
"""Loading of the compiled kernels on first use."""

from __future__ import annotations

import contextlib
import importlib
import os
import re
import threading
from functools import cache

import bpy

from ...core import registry
from ...core.errors import ShockError
from .jobs import Job

_PACKAGE = __package__.removesuffix(".shock_addon.running")
_REMEDY = "install the Shock Filter zip that was made for this Blender version and platform"

_UNUSABLE = (
    ImportError, OSError, AttributeError, TypeError, ValueError, RuntimeError, SystemError,
)  # fmt: skip
"""Errors from importing a broken library, or incompatible versions."""

_loading = threading.Lock()
_import_error = ""


class KernelsUnavailable(ShockError):
    """The compiled kernels, or a library that they need, are missing or cannot be imported."""


def problem() -> str:
    """Return why the kernels cannot run, with the remedy; empty if no reason is known."""
    return _library_problem() or _import_error


@cache
def _library_problem() -> str:
    from ...core.base.compiled import library_problem

    return library_problem()


def register() -> None:
    """Remove what earlier versions compiled and kept in the extension's user folder."""
    if _PACKAGE.startswith("bl_ext."):
        _remove_old(bpy.utils.extension_path_user(_PACKAGE))


def _remove_old(folder: str) -> None:
    # Another Blender may do the same.
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            is_old = re.fullmatch(r"kernels-\d[\w.+-]*", entry.name)
            if is_old and entry.is_dir(follow_symlinks=False):
                import shutil  # rarely needed; at the top it would slow each start

                shutil.rmtree(entry.path, ignore_errors=True)


@cache
def tab_is_seen() -> None:
    """Load the kernels on a thread, once in a session, so that the first run is quick."""
    Job(lambda progress: load())


def load() -> None:
    """Import the core's kernels; safe on any thread.

    Raises
    ------
    KernelsUnavailable
        If the kernels, or a library that they need, are missing or cannot be imported.
    """
    global _import_error
    with _loading:
        _import_error = ""
        if problem():
            raise KernelsUnavailable(problem())
        try:
            for name in registry.kernel_modules():
                importlib.import_module(name)
        except _UNUSABLE as error:
            import logging

            logging.getLogger(__name__).exception("The compiled kernels cannot be loaded.")
            _import_error = f"The compiled kernels cannot be loaded ({error}): {_REMEDY}."
            raise KernelsUnavailable(_import_error) from error


def unregister() -> None:
    """Check the kernels again at the next use."""
    global _import_error
    _import_error = ""
    _library_problem.cache_clear()
    tab_is_seen.cache_clear()
