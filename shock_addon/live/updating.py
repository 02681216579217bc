# SPDX-License-Identifier: GPL-3.0-or-later
"""Making live results again, and knowing when that is due."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt

from .. import data

_WORSE = ["", "fresh", "moved", "stale"]
"""States, from good to bad."""

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


def update(obj: bpy.types.Object, how: str = "EXEC_DEFAULT", is_undoable: bool = False) -> set[str]:
    """Run the filter that made a live result, with its settings, on this object alone.

    Parameters
    ----------
    obj : bpy.types.Object
    how : str
        ``"INVOKE_DEFAULT"`` lets a thread compute where there is a window.
    is_undoable : bool
        Whether it is a step of undo.

    Raises
    ------
    RuntimeError
        With the reason, if it cannot be updated.
    """
    reason = obstacle(obj)
    if reason:
        raise RuntimeError(reason)
    *first, last = data.live.recipes.all_noted(obj.data)
    for recipe in first:
        _run(obj, recipe, "EXEC_DEFAULT", False)
    return _run(obj, last, how, is_undoable)


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
