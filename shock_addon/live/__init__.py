# SPDX-License-Identifier: GPL-3.0-or-later
"""Live results: updating them, by hand and when their source changes, and painting their masks.

May use `operators` and what these use. Scripts call `update` and `state`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import bpy


def update(obj: bpy.types.Object) -> None:
    """Update the live result of an object, with the settings that made it.

    A live copy is made from the current state of its source. The modifier keeps its inputs.

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
    """Return the state of an object's live result.

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
