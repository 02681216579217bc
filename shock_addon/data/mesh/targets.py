# SPDX-License-Identifier: GPL-3.0-or-later
"""Mesh objects that were read, and finding them again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy

from ....core.host.inputs import Surface
from ..skipped import Skipped


@dataclass(frozen=True)
class MeshTarget:
    """A mesh object as it was read, to find it again when the result is there.

    Attributes
    ----------
    place : object
        Where the result goes: for geometry a `Place`, for colors the attribute's name.
    surface : Surface
        The input of the filter.
    is_seen : bool
        Whether it is what is seen of the object, with modifiers and shape keys applied; the result
        then goes into a new one.
    """

    name: str
    object_uid: int
    mesh_uid: int
    place: Any
    surface: Surface
    is_seen: bool = False


def find(target: MeshTarget) -> bpy.types.Object:
    """Return the object that was read.

    Raises
    ------
    Skipped
        If it was removed, has another mesh, or is being edited where the context does not see it.
    """
    obj = next((o for o in bpy.data.objects if o.session_uid == target.object_uid), None)
    if obj is None or obj.data is None or obj.data.session_uid != target.mesh_uid:
        raise Skipped("it was removed meanwhile")
    if obj.data.is_editmode:
        raise Skipped("it is in Edit Mode in another scene or window; leave that and run again")
    return obj
