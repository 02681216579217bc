# SPDX-License-Identifier: GPL-3.0-or-later
"""Live results: updating them, by hand and when their source changes, painting where they are seen.

May use `operators` and what these use. Scripts call `update` and `state`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import bpy


def update(obj: bpy.types.Object) -> None:
    """Make the live result of an object again, with the settings that made it.

    That of a live copy is made of what its source shows now. The modifier keeps its inputs.

    Parameters
    ----------
    obj : bpy.types.Object
        In Object Mode.

    Raises
    ------
    RuntimeError
        If it has no live result, or the filter refuses; the text says why.
    """
    from .updating import update

    update(obj)


def state(obj: bpy.types.Object) -> str:
    """Return what the live result of an object is to its mesh.

    Parameters
    ----------
    obj : bpy.types.Object
        Not in Edit Mode.

    Returns
    -------
    str
        ``"fresh"``; ``"moved"`` if vertices have moved since, or the source of a live copy has
        changed; ``"stale"`` if the mesh has another connectivity, so that nothing is applied; empty
        if there is no live result.
    """
    from .updating import state

    return state(obj)
