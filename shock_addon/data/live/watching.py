# SPDX-License-Identifier: GPL-3.0-or-later
"""Which live copies are out of date, found out while Blender evaluates changes."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import bpy

from ..chosen import live_source

CHANGED = "shock_filter_changed"
"""Key among a copy's properties, in files that were saved while it was out of date."""

SEEN = "shock_filter_seen"
"""Key of what a copy was made of, see `sources.digest`, among its properties: undo restores it."""

_changed: dict[int, float] = {}
"""For copies that are out of date, by uids: when their sources changed last."""

_copies: dict[int, set[int]] = {}
"""The data on which the source of each live copy depends, by uids."""

_doubtful: set[int] = set()
"""Copies that are compared with what their sources show, by uids, as soon as that is evaluated."""

_is_doubted = False
"""Whether this is to be done with all copies."""

_counted = -1
_states: dict[int, str] = {}
"""What panels show of meshes, by uids, until they change."""

changed_at = 0.0
"""When a source of live copies changed last, by `time.monotonic`."""


def note(scene: bpy.types.Scene, graph: bpy.types.Depsgraph) -> None:
    """Look at what has changed; Blender calls it after each evaluation."""
    global changed_at, _counted, _is_doubted
    if _is_doubted:
        _copies.clear()  # they may have other sources now
        _counted = -1
        _find_copies()
        _doubtful.update(_copies)
        _is_doubted = False
    _find_copies()
    if not (_copies or _states):
        return
    uids = set()
    for each in graph.updates:
        if each.is_updated_geometry or each.is_updated_transform:
            uids.add(each.id.original.session_uid)
            _forget_state(each.id.original)
    for uid, sources in list(_copies.items()):
        if sources & uids:
            _changed[uid] = changed_at = time.monotonic()
            copy = _object(uid)
            source = None if copy is None else live_source(copy)
            _copies[uid] = set() if source is None else dependencies(source)
    if graph.mode == "VIEWPORT":
        for uid in list(_doubtful):
            _compare(uid, graph)


def doubt() -> None:
    """Mark all copies as unknown, after an undo, a redo or a preview.

    An undo also takes updates back, and a preview leaves sources as they were.
    """
    global _is_doubted
    _is_doubted = True


def note_updated(obj: bpy.types.Object) -> None:
    """Mark a copy as up to date."""
    graph = bpy.context.evaluated_depsgraph_get()  # which calls `note` with what waits
    _changed.pop(obj.session_uid, None)
    obj.pop(CHANGED, None)
    _states.clear()
    source = live_source(obj)
    if source is not None:
        _copies[obj.session_uid] = dependencies(source)
        obj[SEEN] = _seen(source, graph)


def has_changed(obj: bpy.types.Object) -> bool:
    """Whether the source of a live copy has changed since it was updated."""
    return obj.session_uid in _changed


def changed_copies() -> list[bpy.types.Object]:
    """List the live copies that are out of date."""
    return [obj for uid in list(_changed) if (obj := _object(uid)) is not None]


def changed_since(moment: float) -> set[int]:
    """Return the uids of the live copies whose sources have changed since, by `time.monotonic`."""
    return {uid for uid, changed in _changed.items() if changed > moment}


def state_for_panel(obj: bpy.types.Object, find: Any) -> str:
    """Return ``find(obj)``, which is kept until the mesh or the source changes."""
    uid = obj.session_uid
    if uid not in _states:
        _states[uid] = find(obj)
    return _states[uid]


def keep(*_: object) -> None:
    """Store in a saved file which copies are out of date."""
    for obj in filter(None, map(_object, _copies)):
        if obj.library is None:
            obj.pop(CHANGED, None)
    for obj in changed_copies():
        if obj.library is None:
            obj[CHANGED] = True


def read(*_: object) -> None:
    """Read this from a file that was opened."""
    global _counted
    forget()
    _counted = -1
    _changed.update((obj.session_uid, 0.0) for obj in bpy.data.objects if CHANGED in obj)


def forget() -> None:
    """Forget all objects."""
    global _counted, _is_doubted
    _changed.clear()
    _copies.clear()
    _doubtful.clear()
    _is_doubted = False
    _states.clear()
    _counted = -1


def dependencies(obj: bpy.types.Object) -> set[int]:
    """Return the uids of the data on which the visible shape of an object depends."""
    found: set[int] = set()
    open_ends: list[Any] = [obj]
    while open_ends:
        each = open_ends.pop()
        if each.session_uid not in found:
            found.add(each.session_uid)
            open_ends += _used_by(each)
    return found


def _used_by(each: bpy.types.ID) -> Iterator[bpy.types.ID]:
    if isinstance(each, bpy.types.Object):
        yield from filter(None, (each.data, each.parent, getattr(each.data, "shape_keys", None)))
        for part in (*each.modifiers, *each.constraints):
            yield from _pointers(part)
    elif isinstance(each, bpy.types.Collection):
        yield from each.all_objects
    elif isinstance(each, bpy.types.NodeTree):
        for node in each.nodes:
            yield from _pointers(node)
            values = [getattr(socket, "default_value", None) for socket in node.inputs]
            yield from (value for value in values if _counts(value))
    animation = getattr(each, "animation_data", None)
    for curve in animation.drivers if animation is not None else []:
        for variable in curve.driver.variables:
            yield from (target.id for target in variable.targets if _counts(target.id))


def _pointers(part: Any) -> Iterator[bpy.types.ID]:
    for known in part.bl_rna.properties:
        if known.type == "POINTER" and _counts(value := getattr(part, known.identifier)):
            yield value
    if isinstance(part, bpy.types.NodesModifier):
        yield from (value for value in _inputs(part) if _counts(value))


def _inputs(modifier: bpy.types.NodesModifier) -> list[Any]:
    if hasattr(modifier, "properties"):  # Blender 5.2
        inputs = modifier.properties.inputs
        names = [known.identifier for known in inputs.bl_rna.properties]
        return [getattr(getattr(inputs, name), "value", None) for name in names]
    return list(modifier.values())


def _counts(value: Any) -> bool:
    return isinstance(value, (bpy.types.Object, bpy.types.Collection, bpy.types.NodeTree))


def _find_copies() -> None:
    global _counted
    if len(bpy.data.objects) == _counted:
        return
    _counted = len(bpy.data.objects)
    sources = {obj.session_uid: live_source(obj) for obj in bpy.data.objects}
    there = {uid: source for uid, source in sources.items() if source is not None}
    for uid in _copies.keys() - there.keys():
        del _copies[uid]
    for uid in there.keys() - _copies.keys():
        _copies[uid] = dependencies(there[uid])


def _compare(uid: int, graph: bpy.types.Depsgraph) -> None:
    """Find out whether a copy was made of what its source shows, where that is evaluated."""
    global changed_at
    copy = _object(uid)
    source = None if copy is None else live_source(copy)
    if copy is None or source is None or not copy.get(SEEN):
        _doubtful.discard(uid)
        return
    seen = _seen(source, graph)
    if not seen:
        return
    _doubtful.discard(uid)
    _states.clear()
    if seen == copy[SEEN]:
        if not _is_masked(copy):
            _changed.pop(uid, None)
    elif uid not in _changed:
        _changed[uid] = changed_at = time.monotonic()


def _is_masked(copy: bpy.types.Object) -> bool:
    """Whether a result depends on a vertex group of the source, which digests do not cover."""
    from . import recipes  # which needs json

    return any(settings.get("vertex_group") for _, settings in recipes.all_noted(copy.data))


def _seen(source: bpy.types.Object, graph: bpy.types.Depsgraph) -> str:
    from . import sources  # which needs numpy

    return sources.digest(source, graph)


def _forget_state(each: bpy.types.ID) -> None:
    if isinstance(each, bpy.types.Mesh) or getattr(each, "type", "") == "MESH":
        _states.clear()


def _object(uid: int) -> bpy.types.Object | None:
    return next((obj for obj in bpy.data.objects if obj.session_uid == uid), None)
