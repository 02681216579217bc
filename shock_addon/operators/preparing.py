# SPDX-License-Identifier: GPL-3.0-or-later
"""Have the kernels ready before the first press.

Once for each installation, a plain Python compiles them at low priority while people look around;
a press meanwhile takes what is there and compiles the rest itself. In each session they are loaded
when the tab is first seen. Not in background mode: scripts load what they use.
"""

from __future__ import annotations

import json
import logging
import os
import sys
import threading
from typing import Any

import bpy

from ...core.base import cache_folder
from . import kernels
from .jobs import Job, redraw_sidebars

log = logging.getLogger(__name__)

_PACKAGE = __package__.removesuffix(".shock_addon.operators")
_ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
_SCRIPT = os.path.join(_ROOT, "core", "host", "rehearse_alone.py")

_AT_FIRST = 1.0
"""Seconds after enabling: until then Blender has other things to do."""

_INTERVAL = 0.5
_LONGEST = 5.0
"""Seconds until a process that was killed has ended, at most."""

_NOTICED = 0.5
"""Seconds of compiling after which loading is given up: that would slow the window down."""


class Process:
    """A plain Python that compiles all kernels into the chosen folder.

    Attributes
    ----------
    fraction : float
        How much is done, 0 to 1.
    said : str
        Its last line that is no number: of a traceback, if it failed.

    Raises
    ------
    OSError
        If it cannot be started.
    """

    def __init__(self) -> None:
        import subprocess

        if not os.path.basename(sys.executable).lower().startswith("python"):
            raise FileNotFoundError(f"{sys.executable or 'nothing'} is named as Python")
        flags = 0
        if sys.platform == "win32":
            flags = subprocess.CREATE_NO_WINDOW | subprocess.BELOW_NORMAL_PRIORITY_CLASS
        self.fraction, self.said = 0.0, ""
        self._process = subprocess.Popen(
            [sys.executable, "-I", _SCRIPT],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            creationflags=flags,
            text=True,
            encoding="utf-8",
            errors="replace",
        )
        task = {"package": _PACKAGE, "paths": sys.path, "folder": cache_folder.chosen}
        self._thread = threading.Thread(target=self._talk, args=(json.dumps(task),), daemon=True)
        self._thread.start()

    def _talk(self, task: str) -> None:
        try:
            self._process.stdin.write(task + "\n")
            self._process.stdin.flush()  # and stays open: it ends when this is closed
        except OSError:  # it has ended, and says why
            pass
        for line in self._process.stdout:
            try:
                self.fraction = max(self.fraction, float(line))
            except ValueError:
                self.said = line.strip() or self.said
        self._process.stdout.close()
        self._process.stdin.close()

    def wait(self, seconds: float) -> None:
        """Wait for its end and for its last words."""
        self._process.wait(seconds)
        self._thread.join(seconds)

    @property
    def code(self) -> int | None:
        """Its exit status; None while it runs."""
        return self._process.poll()

    def stop(self) -> None:
        """End it and wait until it has ended, so that it holds no files."""
        self._process.kill()
        self.wait(_LONGEST)


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
    try:
        _process = Process()
    except OSError as error:
        log.warning("Filters are compiled on first use, as no Python can be started: %s.", error)
        return
    bpy.app.timers.register(_watch, first_interval=_INTERVAL, persistent=True)


def _watch() -> float | None:
    global _process, _is_prepared
    redraw_sidebars(bpy.context)
    if _process.code is None:
        return _INTERVAL
    _process.wait(_LONGEST)
    if _process.code:
        log.warning("Filters are compiled on first use, as preparing failed: %s", _process.said)
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
        return progress(fraction, message) and kernels.seconds_compiling() - before < _NOTICED

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
        log.warning("Filters will be prepared again in the next session: %s", error)


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
