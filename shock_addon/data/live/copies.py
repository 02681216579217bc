# SPDX-License-Identifier: GPL-3.0-or-later
"""Live copies: objects that show the filtered shape of another object, their source."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy

from .. import LIVE_AUTO, LIVE_SOURCE
from ..chosen import live_source
from ..mesh import visible
from ..mesh.targets import MeshTarget, find
from . import coloring, movement, results, stacks, watching


def write(target: MeshTarget, result: Any) -> bpy.types.Object:
    """Write the filtered visible shape of an object into its live copy; add one if there is none.

    Linked duplicates of the copy get its new mesh, too.

    Raises
    ------
    Skipped
        If an object was removed, or what is seen of it has changed since it was read.
    """
    obj = find(target)
    source = live_source(obj)
    if source is not None:
        copies = visible.write_into(target, source, result, results.write, _is_copy_of(source))
        for each in copies:
            movement.add(each, mark_sharp=True)
            if isinstance(target.place, tuple):
                coloring.add(each, target.place[1])
            watching.note_updated(each)
        return obj
    new = visible.write_new(target, result, results.write, "live")
    if new != obj:
        new[LIVE_SOURCE] = obj
        watching.note_updated(new)
    return new


def release(mesh: bpy.types.Mesh) -> None:
    """Make the objects that show a mesh no longer live copies, since it has no source."""
    for obj in stacks.users_of(mesh):
        for key in (LIVE_SOURCE, LIVE_AUTO, watching.SEEN, watching.CHANGED):
            obj.pop(key, None)


def _is_copy_of(source: bpy.types.Object) -> Callable[[bpy.types.Object], bool]:
    return lambda obj: obj.library is None and live_source(obj) == source
