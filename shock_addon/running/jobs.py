# SPDX-License-Identifier: GPL-3.0-or-later
"""Background threads with progress and Esc, while the window stays responsive.

The work must not use bpy. Its result is applied on the main thread.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface_

from .status import StatusText

Work = Callable[[Callable[[float, str], bool]], Any]

_INTERVAL = 0.03
"""Seconds between two checks whether a job has ended."""

_CALM = 0.2
"""Seconds between two drawings of the progress, which take time from the job."""

_SETTLED = 0.3
"""Seconds after which each window has had an event from a timer."""

_PASSED_ON = {"MIDDLEMOUSE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "TRACKPADPAN", "TRACKPADZOOM"}
"""Events for navigation during a job. Others are ignored, except in sidebars."""

_BUTTONS = {"LEFTMOUSE", "RIGHTMOUSE", "PEN", "ERASER"}
_BUTTONS |= {f"BUTTON{number}MOUSE" for number in range(4, 8)}
"""Events that are ignored outside sidebars also where `Job.keys_pass`."""

_READ_BY_OTHERS = ("RENDER", "OBJECT_BAKE")
"""Blender's jobs that read the scene on other threads; results wait for their end."""

_LINGERS = 2.0
"""Seconds without a change after which operators of other add-ons count as permanent."""

_OWN = (__package__.partition(".shock_addon")[0] + ".", "bl_operators.")
"""How modules of operators begin that end soon: of this extension, and of Blender in Python."""

_running: set[Job] = set()
_waits: list[_Wait] = []
previews: list[Any] = []
"""Previews that have not ended; the data that they show must not be read."""

_unsettled: dict[int, bpy.types.Timer] = {}


class Job:
    """One run of ``work(progress)`` on a thread of its own.

    Attributes
    ----------
    fraction : float
        Progress, 0 to 1.
    message : str
        The current step.
    outcome : set of str
        What the operator returned at the end of its run; empty before, and if it was dropped.
    quiet_until : float
        When its progress is shown first, by `time.monotonic`.
    keys_pass : bool
        Whether keys other than Esc work as usual.
    is_welcome : callable
        ``is_welcome()`` returns whether the result may be applied now; otherwise it waits.
    """

    def __init__(self, work: Work) -> None:
        from concurrent.futures import ThreadPoolExecutor

        self.fraction = 0.0
        self.message = "Preparing"
        self.outcome: set[str] = set()
        self.quiet_until = 0.0
        self.keys_pass = False
        self.is_welcome: Callable[[], bool] = lambda: True
        self._cancelled = threading.Event()
        executor = ThreadPoolExecutor(1, thread_name_prefix="shock-filter-job")
        self._future = executor.submit(work, self._progress)
        executor.shutdown(wait=False)
        _running.add(self)
        self._future.add_done_callback(lambda _: _running.discard(self))

    def _progress(self, fraction: float, message: str) -> bool:
        self.fraction = max(self.fraction, fraction)  # a bar never goes back
        self.message = message or self.message
        return not self._cancelled.is_set()

    @property
    def done(self) -> bool:
        """Whether the work has ended, successfully or not."""
        return self._future.done()

    @property
    def cancelled(self) -> bool:
        """Whether the work was asked to stop."""
        return self._cancelled.is_set()

    def cancel(self) -> None:
        """Ask the work to stop; returns at once."""
        self._cancelled.set()

    def wait(self) -> None:
        """Wait for the work's end."""
        self._future.exception()

    def result(self) -> Any:
        """Return what the work returned, or raise what it raised; waits for its end."""
        return self._future.result()


class _Wait:
    """The job of a modal operator, with its timer and status text.

    It is separate from the operator, which Blender may free at any time; accessing its attributes
    then raises.
    """

    def __init__(self, operator: ModalJob, context: bpy.types.Context, work: Work) -> None:
        self.operator = operator
        self.job = Job(work)
        self._status, self._drawn_next = StatusText(), 0.0
        self._timer = context.window_manager.event_timer_add(_INTERVAL, window=context.window)
        _waits.append(self)

    @property
    def is_forsaken(self) -> bool:
        """Whether Blender has freed the operator."""
        return is_freed(self.operator)

    def show(self, context: bpy.types.Context) -> None:
        """Show the progress, but not too often."""
        now = time.monotonic()
        if now < max(self.job.quiet_until, self._drawn_next):
            return
        self._drawn_next = now + _CALM
        status = iface_("{message}: {fraction:.0%} (Esc cancels)").format(
            message=iface_(self.job.message), fraction=self.job.fraction
        )
        if self.job.done and is_scene_read():
            status = iface_("Waiting for the render to end (Esc cancels)")
        if self._status.show(context, status):
            redraw_sidebars(context)

    def drop(self, context: bpy.types.Context) -> None:
        """Stop waiting, whether or not the job has ended."""
        self.job.cancel()
        self.close(context)

    def close(self, context: bpy.types.Context) -> None:
        """Remove timer and status text."""
        _waits.remove(self)
        context.window_manager.event_timer_remove(self._timer)
        self._status.clear(context)
        redraw_sidebars(context)


class ModalJob:
    """Mixin for operators: `run_job` from invoke; `finish` is called when the work has ended."""

    _wait = None  # type: _Wait | None  # Blender would evaluate an annotation for each operator

    def finish(self, context: bpy.types.Context, compute: Callable[[], Any]) -> set[str]:
        """Apply the result of the work, which `compute` returns; it raises its errors."""
        raise NotImplementedError

    def run_job(self, context: bpy.types.Context, work: Work) -> set[str]:
        """Start the work and wait for it as a modal operator."""
        if is_settling():
            self.report({"WARNING"}, "The last run is still being put away; run again.")
            return {"CANCELLED"}
        for wait in list(_waits):
            if wait.is_forsaken:
                wait.drop(context)
        self._wait = _Wait(self, context, work)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Show progress; finish when the work has ended, or on Esc."""
        try:
            return self._step(context, event)
        except Exception:
            self.cancel(context)  # Blender then ends the operator, and may free it at once
            raise

    def _step(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        wait = self._wait
        if wait not in _waits:
            return {"CANCELLED"}
        if event.type == "ESC" and event.value == "PRESS":
            wait.job.cancel()
        if wait.job.cancelled:
            self.cancel(context)
            self.tell("INFO", "Cancelled; nothing was changed.")
            return {"CANCELLED"}
        if event.type == "TIMER":
            if wait.job.done and not is_scene_read() and wait.job.is_welcome():
                wait.close(context)
                wait.job.outcome = self.finish(context, wait.job.result)
                return wait.job.outcome
            wait.show(context)
        is_key = event.type not in _BUTTONS and wait.job.keys_pass
        is_held_back = not is_key and _is_held_back(context, event)
        return {"RUNNING_MODAL"} if is_held_back else {"PASS_THROUGH"}

    def tell(self, kind: str, text: str) -> None:
        """Report the end: ``INFO``, ``WARNING`` or ``ERROR``."""
        self.report({kind}, text)

    def cancel(self, context: bpy.types.Context) -> None:
        """Drop the work; Blender also calls this when a window closes or a file is loaded."""
        if self._wait in _waits:
            self._wait.drop(context)


class SHOCK_FILTER_OT_cancel(bpy.types.Operator):
    """Cancel the run that is under way; nothing is changed"""

    bl_idname = "shock_filter.cancel"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether a run is under way."""
        return current() is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Ask the run to stop; its operator ends at the next timer event."""
        current().cancel()
        return {"FINISHED"}


def is_previewing() -> bool:
    """Whether a preview is under way."""
    return any(each.is_under_way for each in previews)


def current() -> Job | None:
    """Return the job of a modal operator, if one is under way."""
    jobs = [wait.job for wait in _waits if not wait.is_forsaken]
    return jobs[-1] if jobs else None


def shown() -> Job | None:
    """Return the job whose progress is shown, if one is under way."""
    job = current()
    return None if job is None or time.monotonic() < job.quiet_until else job


def stop_all() -> None:
    """Cancel all jobs and wait for their threads, before operators are unregistered."""
    if _waits:
        settle(bpy.context.window_manager)
    for wait in list(_waits):
        if wait.is_forsaken:
            wait.drop(bpy.context)
        else:
            wait.operator.cancel(bpy.context)
    for job in list(_running):
        job.cancel()
        job.wait()


def is_freed(operator: bpy.types.Operator) -> bool:
    """Whether Blender has freed an operator; accessing its attributes then raises."""
    try:
        getattr(operator, "bl_idname", "")
    except ReferenceError:
        return True
    return False


def is_settling() -> bool:
    """Whether modal operators have to wait before they start."""
    return bool(_unsettled)


def settle(manager: bpy.types.WindowManager) -> None:
    """Block modal operators until each window has had an event.

    Blender keeps an empty handler of an unregistered modal operator until then, and crashes if
    another modal operator is added.
    """
    for window in manager.windows:
        timer = manager.event_timer_add(0.1 * _SETTLED, window=window)
        _unsettled[window.as_pointer()] = timer
    bpy.app.timers.register(_settled, first_interval=_SETTLED, persistent=True)


def _settled() -> None:
    manager = bpy.context.window_manager
    for window in manager.windows:
        if window.as_pointer() in _unsettled:  # the timer of a window that was closed is gone
            manager.event_timer_remove(_unsettled[window.as_pointer()])
    _unsettled.clear()


def is_scene_read() -> bool:
    """Whether Blender renders or bakes, so that nothing may be written."""
    return any(bpy.app.is_job_running(kind) for kind in _READ_BY_OTHERS)


def is_artist_busy(rested: float) -> bool:
    """Whether a modal operator that is no run is under way, or an animation is played.

    Parameters
    ----------
    rested : float
        Seconds without a change. After some, operators of other add-ons count no more, of which
        some are under way as long as Blender is.
    """
    for window in bpy.context.window_manager.windows:
        others = [each.bl_idname for each in getattr(window, "modal_operators", ())]
        for wait in _waits:
            if not wait.is_forsaken and wait.operator.bl_idname in others:
                others.remove(wait.operator.bl_idname)
        if rested > _LINGERS:
            others = [name for name in others if not _is_of_others(name)]
        if others or window.screen.is_animation_playing:
            return True
    return False


def _is_of_others(name: str) -> bool:
    """Whether an operator is one of another add-on; most of Blender's are in no Python class."""
    found = bpy.types.Operator.bl_rna_get_subclass_py(name)
    return found is not None and not found.__module__.startswith(_OWN)


def _is_held_back(context: bpy.types.Context, event: bpy.types.Event) -> bool:
    if event.value in {"NOTHING", "RELEASE"} or event.type in _PASSED_ON:
        return False  # where a button is held, such as that of a slider, its release must arrive
    sidebars = _sidebars(context.window)
    in_sidebar = any(holds(region, event.mouse_x, event.mouse_y) for region in sidebars)
    return not (event.type == "LEFTMOUSE" and in_sidebar)


def holds(region: bpy.types.Region, x: float, y: float) -> bool:
    """Whether a place in the window is in a region."""
    in_columns = region.x <= x < region.x + region.width
    return in_columns and region.y <= y < region.y + region.height


def redraw_sidebars(context: bpy.types.Context) -> None:
    """Redraw the tab wherever it is shown."""
    for window in context.window_manager.windows:
        for region in _sidebars(window):
            region.tag_redraw()


def _sidebars(window: bpy.types.Window) -> list[bpy.types.Region]:
    return [
        region
        for area in window.screen.areas
        if area.type in {"VIEW_3D", "IMAGE_EDITOR"}
        for region in area.regions
        if region.type == "UI"
    ]


CLASSES = (SHOCK_FILTER_OT_cancel,)
