# SPDX-License-Identifier: GPL-3.0-or-later
"""Work on a thread of its own while the window stays alive, with progress and Esc.

The work must not touch bpy. What it returns is applied on the main thread, at once.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import bpy

Work = Callable[[Callable[[float, str], bool]], Any]

_INTERVAL = 0.1
_PASSED_ON = {
    "TIMER",
    "MOUSEMOVE",
    "INBETWEEN_MOUSEMOVE",
    "MIDDLEMOUSE",
    "WHEELUPMOUSE",
    "WHEELDOWNMOUSE",
    "TRACKPADPAN",
    "TRACKPADZOOM",
    "WINDOW_DEACTIVATE",
}

_running: set[Job] = set()
_modal: list[ModalJob] = []


class Job:
    """One run of ``work(progress)`` on a thread of its own.

    Attributes
    ----------
    fraction : float
        How much is done, 0 to 1.
    message : str
        What is being done.
    """

    def __init__(self, work: Work) -> None:
        self.fraction = 0.0
        self.message = "Preparing"
        self._cancelled = threading.Event()
        executor = ThreadPoolExecutor(1, thread_name_prefix="shock-filter-job")
        self._future = executor.submit(work, self._progress)
        executor.shutdown(wait=False)
        _running.add(self)
        self._future.add_done_callback(lambda _: _running.discard(self))

    def _progress(self, fraction: float, message: str) -> bool:
        self.fraction = max(self.fraction, fraction)  # a bar that goes back worries people
        self.message = message or self.message
        return not self._cancelled.is_set()

    @property
    def done(self) -> bool:
        """Whether the work has ended, in whatever way."""
        return self._future.done()

    def cancel(self) -> None:
        """Ask the work to stop; returns at once."""
        self._cancelled.set()

    def wait(self) -> None:
        """Wait for the work's end."""
        self._future.exception()

    def result(self) -> Any:
        """Return what the work returned, or raise what it raised; waits for its end."""
        return self._future.result()


class ModalJob:
    """Mixin for operators: `start` from invoke; `finish` is called when the work has ended."""

    def finish(self, context: bpy.types.Context, compute: Callable[[], Any]) -> set[str]:
        """Apply what `compute` returns; it raises what the work raised."""
        raise NotImplementedError

    def start(self, context: bpy.types.Context, work: Work) -> set[str]:
        """Begin the work and wait for it as a modal operator."""
        manager = context.window_manager
        self._job = Job(work)
        self._status = ""
        self._timer = manager.event_timer_add(_INTERVAL, window=context.window)
        manager.progress_begin(0.0, 1.0)
        manager.modal_handler_add(self)
        _modal.append(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Show progress; end when the work has, or on Esc."""
        if event.type == "ESC" and event.value == "PRESS":
            self.cancel(context)
            self.report({"INFO"}, "Cancelled; nothing was changed.")
            return {"CANCELLED"}
        if event.type == "TIMER":
            if self._job.done:
                self._close(context)
                return self.finish(context, self._job.result)
            self._show(context)
        return {"PASS_THROUGH"} if event.type in _PASSED_ON else {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Drop the work; Blender calls this too, when a window closes or a file is loaded."""
        self._job.cancel()
        self._close(context)

    def _show(self, context: bpy.types.Context) -> None:
        job = self._job
        status = f"{job.message}: {job.fraction:.0%} (Esc cancels)"
        if status == self._status:  # drawing can be slow
            return
        self._status = status
        context.window_manager.progress_update(job.fraction)
        context.workspace.status_text_set(status)
        _redraw_sidebars(context)

    def _close(self, context: bpy.types.Context) -> None:
        _modal.remove(self)
        manager = context.window_manager
        manager.event_timer_remove(self._timer)
        manager.progress_end()
        if context.workspace is not None:
            context.workspace.status_text_set(None)
        _redraw_sidebars(context)


def current() -> Job | None:
    """Return the job that a modal operator waits for, if any."""
    return _modal[-1]._job if _modal else None


def stop_all() -> None:
    """Cancel all jobs and wait for their threads."""
    for operator in list(_modal):
        operator.cancel(bpy.context)
    for job in list(_running):
        job.cancel()
        job.wait()


def _redraw_sidebars(context: bpy.types.Context) -> None:
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in {"VIEW_3D", "IMAGE_EDITOR"}:
                for region in area.regions:
                    if region.type == "UI":
                        region.tag_redraw()
