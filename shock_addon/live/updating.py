# SPDX-License-Identifier: GPL-3.0-or-later
"""Updating of live results, and their states."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from typing import Any, NamedTuple

import bpy
from bpy.app.translations import pgettext_rpt

from .. import data
from ..running import jobs

_WORSE = ["", "fresh", "moved", "stale"]
"""States, from good to bad."""

_LOOK = 0.05
"""Seconds between checks whether a run has ended."""

_NOT_LIVE = "{name} has no live result; run a filter with the output Live first."
_BUSY = "{name} is in another mode; go to Object Mode first."
_LOST = "{name} is a live copy of an object that was removed; nothing can be updated."


class Step(NamedTuple):
    """A run that updates results.

    Attributes
    ----------
    operator : str
    settings : dict
        Its properties, and others that it does not know.
    objects : list of int
        Uids of the objects that it works on.
    subjects : set of int
        Uids of what the result depends on: the mesh and the source of a live copy, or all objects
        that show a texture.
    """

    operator: str
    settings: dict[str, Any]
    objects: list[int]
    subjects: set[int]

    def does(self, other: Step) -> bool:
        """Whether another step, of an object that shares mesh or texture, does the same."""
        return (self.operator, self.settings, self.subjects) == (
            other.operator,
            other.settings,
            other.subjects,
        )


def steps_of(obj: bpy.types.Object, with_textures: bool = True) -> list[Step]:
    """List the runs that update the live results of an object: colors, shape, textures."""
    recipes = data.live.recipes.all_noted(obj.data)
    source = data.chosen.live_source(obj)
    subjects = {each.session_uid for each in (obj.data, source) if each is not None}
    found = [Step(*recipe, [obj.session_uid], subjects) for recipe in recipes]
    for node, mix in data.mixes.mixed([obj.name]) if with_textures else []:
        recipe = data.live.recipes.noted(mix, data.LIVE_TEXTURE)
        step = None if recipe is None else _of_texture(obj, node, mix, recipe)
        if step is not None and step not in found:
            found.append(step)
    return found


def _of_texture(
    obj: bpy.types.Object,
    node: bpy.types.ShaderNodeTexImage,
    mix: bpy.types.Node,
    recipe: data.live.recipes.Recipe,
) -> Step | None:
    """Return the run that makes a texture's result again; None if it is that of other objects.

    A live copy shows the materials of its source, and is none of those that the texture is made of.
    """
    operator, settings = recipe
    names = settings.get("objects", [])
    if obj.name not in names and data.LIVE_SOURCE in obj:
        return None
    others = [
        each
        for each in bpy.context.view_layer.objects
        if each.name in names and each != obj and _shows(each, mix)
    ]
    if "\n" not in settings.get("result", ""):  # names may have changed since
        result = data.mixes.result_of(mix)
        settings["image"] = node.image.name
        shown = None if result is None else result.image
        settings["result"] = "" if shown is None else shown.name
    uids = [obj.session_uid, *(each.session_uid for each in others)]
    return Step(operator, settings, uids, set(uids))


def _shows(obj: bpy.types.Object, mix: bpy.types.Node) -> bool:
    return any(mix == own for _, own in data.mixes.mixed([obj.name]))


def obstacle(obj: bpy.types.Object | None) -> str:
    """Return why an object cannot be updated, in the language of the interface; empty if it can."""
    if obj is None:
        return pgettext_rpt("Select a mesh object.")
    if obj.type != "MESH" or not is_live(obj):
        return pgettext_rpt(_NOT_LIVE).format(name=obj.name)
    if obj.mode != "OBJECT":
        return pgettext_rpt(_BUSY).format(name=obj.name)
    if data.chosen.is_live_copy(obj) and data.chosen.live_source(obj) is None:
        return pgettext_rpt(_LOST).format(name=obj.name)
    return ""


def is_live(obj: bpy.types.Object) -> bool:
    """Whether anything says how results of a mesh object can be made again."""
    if data.live.recipes.all_noted(obj.data):
        return True
    mixes = [mix for _, mix in data.mixes.mixed([obj.name])]
    return any(data.live.recipes.noted(mix, data.LIVE_TEXTURE) for mix in mixes)


def update(
    obj: bpy.types.Object,
    how: str = "EXEC_DEFAULT",
    is_undoable: bool = False,
    began: Callable[[], None] = lambda: None,
    with_textures: bool = True,
) -> set[str]:
    """Run the filters that made live results, with their settings, on this object alone.

    Textures are computed from all objects of the original run. Runs follow each other; those after
    a cancelled one are left out.

    Parameters
    ----------
    obj : bpy.types.Object
    how : str
        ``"INVOKE_DEFAULT"`` lets a thread compute where there is a window.
    is_undoable : bool
        Whether it is a step of undo.
    began : callable
        Called after the start of each run.
    with_textures : bool
        Whether textures are made again, too.

    Raises
    ------
    RuntimeError
        With the reason, if it cannot be updated.
    """
    reason = obstacle(obj)
    if reason:
        raise RuntimeError(reason)
    return run_each(obj, steps_of(obj, with_textures), how, is_undoable, began)


def run_each(
    obj: bpy.types.Object,
    steps: list[Step],
    how: str,
    is_undoable: bool,
    began: Callable[[], None] = lambda: None,
    ended: Callable[[Step], None] = lambda step: None,
) -> set[str]:
    """Run steps of an object, as `update` does, which has the same parameters.

    `ended` is called with each step that has finished; not with those that a thread computes.
    """
    done: set[str] = set()
    for number, step in enumerate(steps):
        rest = steps[number + 1 :]
        is_written = bool(done)
        try:
            done = set()
            done = _run(step, how, is_undoable and not rest)
        finally:  # the runs before have changed something
            if is_written and is_undoable and done.isdisjoint({"FINISHED", "RUNNING_MODAL"}):
                bpy.ops.ed.undo_push(message="Update")
        began()
        if done != {"FINISHED"}:
            if rest and "RUNNING_MODAL" in done:
                _after(jobs.current(), obj.session_uid, rest, how, began)
            break
        ended(step)
    return done


def _after(
    job: jobs.Job | None,
    uid: int,
    steps: list[Step],
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
                run_each(obj, steps, how, True, began)
        except RuntimeError as error:
            print(f"Shock Filter: {obj.name}: {error}")
        return None

    _start(look)


def _start(look: Callable[[], float | None]) -> None:
    bpy.app.timers.register(look, first_interval=_LOOK)


def _run(step: Step, how: str, is_undoable: bool) -> set[str]:
    operator = getattr(bpy.ops.shock_filter, step.operator)
    known = operator.get_rna_type().properties
    values = {key: value for key, value in step.settings.items() if key in known}
    there = {obj.session_uid: obj for obj in bpy.data.objects}
    objects = [there[uid] for uid in step.objects if uid in there]
    with bpy.context.temp_override(
        selected_objects=objects,
        selected_editable_objects=objects,
        active_object=objects[0],
        object=objects[0],
    ):
        return operator(how, is_undoable, **values)


def state(obj: bpy.types.Object) -> str:
    """Return the state of a live result; see `live.state`."""
    states = data.live.movement.state(obj), data.live.coloring.state(obj)
    found = max(states, key=_WORSE.index)
    is_behind = found == data.live.movement.FRESH and data.live.watching.has_changed(obj)
    return data.live.movement.MOVED if is_behind else found
