# SPDX-License-Identifier: GPL-3.0-or-later
"""Have the kernels ready before the first press.

Once for each installation, a plain Python compiles them at low priority while people look around;
a press meanwhile takes what is there and compiles the rest itself. In each session they are loaded
when the tab is first seen. Not in background mode: scripts load what they use.
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

_PACKAGE = __package__.removesuffix(".shock_addon.operators")
_ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))

_AT_FIRST = 1.0
"""Seconds after enabling: until then Blender has other things to do."""

_INTERVAL = 0.5
_NOTICED = 0.5
"""Seconds of compiling after which loading is given up: that would slow the window down."""

_process: Process | None = None
_is_prepared = False
_is_seen = False


def register() -> None:
    """Begin soon, if a person sits before an installed extension."""
    if _PACKAGE.startswith("bl_ext.") and not bpy.app.background:
        bpy.app.timers.register(_begin, first_interval=_AT_FIRST, persistent=True)


def fraction() -> float | None:
    """Return how much is compiled; None while nothing is."""
    return None if _process is None else _process.fraction


def tab_is_seen() -> None:
    """Load what is compiled, soon; called whenever the tab is drawn."""
    global _is_seen
    if not _is_seen:
        _is_seen = True
        _load()


def _begin() -> None:
    global _process, _is_prepared
    if kernels.problem():
        return
    kernels.choose_folder()
    if _mark() == _installation():
        _is_prepared = True
        _load()
        return
    from .compiling import Process

    try:
        _process = Process(_PACKAGE, _ROOT)
    except OSError as error:
        _warn(f"Filters are compiled on first use, as no Python can be started: {error}")
        return
    bpy.app.timers.register(_watch, first_interval=_INTERVAL, persistent=True)


def _watch() -> float | None:
    global _process, _is_prepared
    redraw_sidebars(bpy.context)
    if _process.code is None:
        return _INTERVAL
    if _process.code:
        _warn(f"Filters are compiled on first use, as preparing failed: {_process.last_words()}")
    _is_prepared = not _process.code
    _process = None
    _write_mark()  # what has failed once would fail in each session
    _load()
    return None


def _load() -> None:
    # On a thread; jobs that run are waited for when the extension is disabled.
    if _is_prepared and _is_seen:
        Job(_rehearse)


def _rehearse(progress: Any) -> None:
    kernels.load()
    from ...core.host.rehearsal import rehearse

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
    """Read for which installation kernels were compiled."""
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
    """Stop what is under way."""
    global _process, _is_prepared, _is_seen
    for timer in (_begin, _watch):
        if bpy.app.timers.is_registered(timer):
            bpy.app.timers.unregister(timer)
    if _process is not None:
        _process.stop()
    _process, _is_prepared, _is_seen = None, False, False
