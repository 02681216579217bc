# SPDX-License-Identifier: GPL-3.0-or-later
"""Bring up the compiled kernels on first use, and choose where their code is kept."""

from __future__ import annotations

import importlib.util
import os
import threading
from contextlib import suppress
from functools import cache

import bpy

from ... import __version__
from ...core.errors import ShockError

_PACKAGE = __package__.removesuffix(".shock_addon.operators")
_REMEDY = (
    "what is missing comes inside the Shock Filter zip; install the zip that was made for this"
    " Blender version and platform"
)

_LIBRARIES = ("llvmlite", "numba", "scipy")

_UNUSABLE = (
    ImportError, OSError, AttributeError, TypeError, ValueError, RuntimeError, SystemError,
)  # fmt: skip
"""What the import of a broken library, or of versions that do not fit together, can raise."""

_loading = threading.Lock()
_import_error = ""
_known: set[str] = set()
"""The kinds of runs that `has_run` said yes to."""


class KernelsUnavailable(ShockError):
    """Numba or scipy is missing or cannot be imported."""


def problem() -> str:
    """Say why the kernels cannot run and how to mend it; empty as far as they can."""
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


def cache_folder() -> str | None:
    """Choose the folder for compiled code; None leaves the choice to numba.

    An extension's own folder is not for writing, so its code goes to the extension's user
    folder, or to this session's temporary folder if that is read-only. Main thread only.
    """
    if not _PACKAGE.startswith("bl_ext."):
        return None
    import tempfile

    folder = _user_folder()
    try:
        os.makedirs(folder, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError:
        return os.path.join(bpy.app.tempdir, "shock_filter_kernels")


def has_run(kind: str) -> bool:
    """Whether the kernels of a kind of run are compiled already, as far as is known."""
    if kind not in _known and (not _PACKAGE.startswith("bl_ext.") or os.path.exists(_mark(kind))):
        _known.add(kind)
    return kind in _known


def remember_run(kind: str) -> None:
    """Note beside the compiled code that it has what such runs need."""
    if not has_run(kind):
        _known.add(kind)
        with suppress(OSError):  # a folder that cannot be written keeps no compiled code either
            open(_mark(kind), "wb").close()


def _mark(kind: str) -> str:
    return os.path.join(_user_folder(), f"{kind}.compiled")


def _user_folder() -> str:
    return bpy.utils.extension_path_user(_PACKAGE, path=f"kernels-{__version__}")


def load(folder: str | None) -> None:
    """Import the core's kernels so that their compiled code is kept in `folder`.

    numba fixes the place when a kernel is decorated, so its global setting is changed only for
    the import. Safe on any thread.

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
            import numba

            chosen_by_user = numba.config.CACHE_DIR
            numba.config.CACHE_DIR = chosen_by_user or folder or ""
            try:
                from ...core.filters import denoising, geometry, images, signals, textures  # noqa: F401
            finally:
                numba.config.CACHE_DIR = chosen_by_user
        except _UNUSABLE as error:
            import logging

            logging.getLogger(__name__).exception("The compiled kernels cannot be loaded.")
            _import_error = (
                f"The compiled kernels cannot be loaded ({error}): {_REMEDY}, and remove other"
                f" copies. Found: {_places()}."
            )
            raise KernelsUnavailable(_import_error) from error


def forget() -> None:
    """Look again for numba and scipy when they are next asked for."""
    global _import_error
    _import_error = ""
    _missing.cache_clear()
    _known.clear()
