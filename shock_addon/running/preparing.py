# SPDX-License-Identifier: GPL-3.0-or-later
"""Compiling and loading of kernels before the first press.

Once for each installation, separate Python processes compile all kernels at low priority. A press
uses those that are ready and compiles the others itself. In each session, kernels are loaded when
the tab is first drawn. In background mode, scripts load the kernels that they use.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import bpy

from ...core.base import cache_folder
from . import kernels
from .jobs import Job, redraw_sidebars

if TYPE_CHECKING:
    from .compiling import Process

_PACKAGE = __package__.removesuffix(".shock_addon.running")
_ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))

_AT_FIRST = 1.0
"""Seconds to wait after enabling, while Blender is busy."""

_INTERVAL = 0.5
_SHARES = ["geometry", "colors", "flow", "field"], ["image", "texture"]
"""Kinds of data for each process: half of the work, with few kernels in common."""

_NOTICED = 0.5
"""Seconds of compiling after which loading stops, as it would slow the window down."""

_processes: list[Process] = []
_is_prepared = False
_is_seen = False


def register() -> None:
    """Start soon, if the extension is installed and Blender has a window."""
    if _PACKAGE.startswith("bl_ext.") and not bpy.app.background:
        bpy.app.timers.register(_begin, first_interval=_AT_FIRST, persistent=True)


def fraction() -> float | None:
    """Return the fraction that is compiled; None if nothing is being compiled."""
    return min(sum(each.fraction for each in _processes), 1.0) if _processes else None


def tab_is_seen() -> None:
    """Load compiled kernels soon; called whenever the tab is drawn."""
    global _is_seen
    if not _is_seen:
        _is_seen = True
        _load()


def _begin() -> None:
    global _is_prepared
    if kernels.problem():
        return
    kernels.choose_folder()
    if _mark() == _installation():
        _is_prepared = True
        _load()
        return
    from .compiling import Process

    try:
        for kinds in _SHARES:
            _processes.append(Process(_PACKAGE, _ROOT, kinds))
    except OSError as error:
        _stop()
        _warn(f"Filters are compiled on first use, as no Python can be started: {error}")
        return
    bpy.app.timers.register(_watch, first_interval=_INTERVAL, persistent=True)


def _watch() -> float | None:
    global _is_prepared
    redraw_sidebars(bpy.context)
    if any(process.code is None for process in _processes):
        return _INTERVAL
    failed = [process for process in _processes if process.code]
    if failed:
        _warn(f"Filters are compiled on first use, as preparing failed: {failed[0].last_words()}")
    _is_prepared = not failed
    _processes.clear()
    _write_mark()  # what has failed once would fail in each session
    _load()
    return None


def _load() -> None:
    # On a thread; jobs that run are waited for when the extension is disabled.
    if _is_prepared and _is_seen:
        Job(_rehearse)


def _rehearse(progress: Any) -> None:
    kernels.load()
    from ...core.rehearsal.rehearse import rehearse

    before = kernels.seconds_compiling()

    def go_on(fraction: float, message: str) -> bool:
        if kernels.seconds_compiling() - before > _NOTICED:  # such as for another processor
            _remove_mark()
            return False
        return progress(fraction, message)

    rehearse(go_on)


def _path() -> str:
    return os.path.join(cache_folder.chosen, f"prepared-{sys.implementation.cache_tag}")


def _mark() -> str:
    """Read the mark of the installation whose kernels were compiled."""
    try:
        with open(_path(), encoding="utf-8") as file:
            return file.read()
    except (OSError, ValueError):
        return ""


def _write_mark() -> None:
    try:
        with open(_path(), "w", encoding="utf-8") as file:
            file.write(_installation())
    except OSError as error:
        _warn(f"Filters will be prepared again in the next session: {error}")


def _remove_mark() -> None:
    # The next session prepares again.
    with suppress(OSError):
        os.remove(_path())


def _warn(text: str) -> None:
    import logging

    logging.getLogger(__name__).warning(text)


def _installation() -> str:
    # Files get the date when they are unpacked.
    return str(os.stat(os.path.join(_ROOT, "__init__.py")).st_mtime_ns)


def unregister() -> None:
    """Stop compiling and loading."""
    global _is_prepared, _is_seen
    for timer in (_begin, _watch):
        if bpy.app.timers.is_registered(timer):
            bpy.app.timers.unregister(timer)
    _stop()
    _is_prepared, _is_seen = False, False


def _stop() -> None:
    for process in _processes:
        process.stop()
    _processes.clear()
