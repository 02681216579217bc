# SPDX-License-Identifier: GPL-3.0-or-later
"""Making live results again, and knowing when that is due."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt

from .. import data
from ..running import jobs

_WORSE = ["", "fresh", "moved", "stale"]
"""States, from good to bad."""

_LOOK = 0.05
"""Seconds between looks whether a run has ended."""

_NOT_LIVE = "{name} has no live result; run a filter with the output Live first."
_BUSY = "{name} is in another mode; go to Object Mode first."
_LOST = "{name} is a live copy of an object that was removed; nothing can be updated."


def obstacle(obj: bpy.types.Object | None) -> str:
    """Return why an object cannot be updated, in the language of the interface; empty if it can."""
    if obj is None or obj.type != "MESH" or not data.live.recipes.all_noted(obj.data):
        return pgettext_rpt(_NOT_LIVE).format(name="" if obj is None else obj.name)
    if obj.mode != "OBJECT":
        return pgettext_rpt(_BUSY).format(name=obj.name)
    if data.LIVE_SOURCE in obj and data.chosen.live_source(obj) is None:
        return pgettext_rpt(_LOST).format(name=obj.name)
    return ""


def update(
    obj: bpy.types.Object,
    how: str = "EXEC_DEFAULT",
    is_undoable: bool = False,
    began: Callable[[], None] = lambda: None,
) -> set[str]:
    """Run the filters that made live results, with their settings, on this object alone.

    One runs after the other; what follows one that was cancelled is left out.

    Parameters
    ----------
    obj : bpy.types.Object
    how : str
        ``"INVOKE_DEFAULT"`` lets a thread compute where there is a window.
    is_undoable : bool
        Whether it is a step of undo.
    began : callable
        Called after the start of each run.

    Raises
    ------
    RuntimeError
        With the reason, if it cannot be updated.
    """
    reason = obstacle(obj)
    if reason:
        raise RuntimeError(reason)
    return _run_each(obj, data.live.recipes.all_noted(obj.data), how, is_undoable, began)


def _run_each(
    obj: bpy.types.Object,
    recipes: list[data.live.recipes.Recipe],
    how: str,
    is_undoable: bool,
    began: Callable[[], None],
) -> set[str]:
    done: set[str] = set()
    for number, recipe in enumerate(recipes):
        rest = recipes[number + 1 :]
        is_written = bool(done)
        try:
            done = set()
            done = _run(obj, recipe, how, is_undoable and not rest)
        finally:  # the runs before have changed something
            if is_written and is_undoable and done.isdisjoint({"FINISHED", "RUNNING_MODAL"}):
                bpy.ops.ed.undo_push(message="Update")
        began()
        if done != {"FINISHED"}:
            if rest and "RUNNING_MODAL" in done:
                _after(jobs.current(), obj.session_uid, rest, how, began)
            break
    return done


def _after(
    job: jobs.Job | None,
    uid: int,
    recipes: list[data.live.recipes.Recipe],
    how: str,
    began: Callable[[], None],
) -> None:
    # Run the rest when the job has ended, whose operator has added a step of undo by then.
    def look() -> float | None:
        if jobs.current() is not None or jobs.is_settling() or jobs.is_scene_read():
            return _LOOK
        obj = next((each for each in bpy.data.objects if each.session_uid == uid), None)
        if job is None or job.outcome != {"FINISHED"} or obj is None or obstacle(obj):
            return None
        windows = bpy.context.window_manager.windows
        window = windows[0] if windows and not bpy.app.background else None
        try:
            with bpy.context.temp_override(window=window) if window else nullcontext():
                _run_each(obj, recipes, how, True, began)
        except RuntimeError as error:
            print(f"Shock Filter: {obj.name}: {error}")
        return None

    _start(look)


def _start(look: Callable[[], float | None]) -> None:
    bpy.app.timers.register(look, first_interval=_LOOK)


def _run(
    obj: bpy.types.Object, recipe: tuple[str, dict[str, Any]], how: str, is_undoable: bool
) -> set[str]:
    name, settings = recipe
    operator = getattr(bpy.ops.shock_filter, name)
    known = operator.get_rna_type().properties
    values = {key: value for key, value in settings.items() if key in known}
    with bpy.context.temp_override(
        selected_objects=[obj], selected_editable_objects=[obj], active_object=obj, object=obj
    ):
        return operator(how, is_undoable, **values)


def state(obj: bpy.types.Object) -> str:
    """Return the state of a live result; see `live.state`."""
    states = data.live.movement.state(obj), data.live.coloring.state(obj)
    found = max(states, key=_WORSE.index)
    is_behind = found == data.live.movement.FRESH and data.live.watching.has_changed(obj)
    return data.live.movement.MOVED if is_behind else found
