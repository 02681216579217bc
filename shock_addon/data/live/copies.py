# SPDX-License-Identifier: GPL-3.0-or-later
"""Live copies: objects that show the result of what another object shows, and know which."""

from __future__ import annotations

from typing import Any

import bpy

from .. import LIVE_SOURCE
from ..chosen import live_source
from ..mesh import visible
from ..mesh.targets import MeshTarget, find
from . import coloring, movement, results, watching


def write(target: MeshTarget, result: Any) -> bpy.types.Object:
    """Write a result of what is seen of an object into its live copy, which is added if need be.

    Raises
    ------
    Skipped
        If an object was removed, or what is seen of it has changed since it was read.
    """
    obj = find(target)
    source = live_source(obj)
    if source is not None:
        visible.write_into(target, source, result, results.write)
        movement.add(obj, mark_sharp=True)
        if isinstance(target.place, tuple):
            coloring.add(obj, target.place[1])
        watching.note_updated(obj)
        return obj
    new = visible.write_new(target, result, results.write, "live")
    if new != obj:
        new[LIVE_SOURCE] = obj
        watching.note_updated(new)
    return new
