# SPDX-License-Identifier: GPL-3.0-or-later
"""How a live result was made, kept so that it can be made again: with its mesh or its node."""

from __future__ import annotations

import json
from typing import Any

import bpy

from .. import LIVE_COLORS, LIVE_STAMP

Recipe = tuple[str, dict[str, Any]]
"""The name of an operator, and its properties."""


OF_MESHES = LIVE_COLORS, LIVE_STAMP
"""Keys under which a mesh keeps how its results were made: colors, then the shape."""

LIMITED = "limited"
"""Key beside the properties, if a selection, mask or hidden parts of a mode left something out."""


class AsLive:
    """The parameters of an operator, with the output Live."""

    output = "LIVE"

    def __init__(self, parameters: Any) -> None:
        self._parameters = parameters

    def __getattr__(self, name: str) -> Any:
        return getattr(self._parameters, name)


def note(
    owner: bpy.types.Mesh | bpy.types.Node,
    operator: str,
    settings: dict[str, Any],
    key: str = LIVE_STAMP,
) -> None:
    """Keep the operator's name and its properties.

    Parameters
    ----------
    owner : bpy.types.Mesh or bpy.types.Node
        The mesh, or what mixes a texture with its result.
    operator : str
    settings : dict
    key : str
        `LIVE_COLORS` of colors, `LIVE_TEXTURE` of a texture.
    """
    owner[key] = json.dumps({"operator": operator, "settings": settings})


def put(mesh: bpy.types.Mesh, key: str, kept: str | None) -> None:
    """Put back what a mesh kept under a key; None for nothing."""
    if kept is not None:
        mesh[key] = kept
    elif key in mesh:
        del mesh[key]


def noted(owner: bpy.types.Mesh | bpy.types.Node, key: str = LIVE_STAMP) -> Recipe | None:
    """Return the operator and the properties that made a result; None if nothing says so."""
    try:
        found = json.loads(owner.get(key, ""))
        return str(found["operator"]), dict(found["settings"])
    except (ValueError, TypeError, KeyError):
        return None


def all_noted(mesh: bpy.types.Mesh) -> list[Recipe]:
    """List what made the results of a mesh: colors, then the shape; once if one made both."""
    found: list[Recipe] = []
    for key in OF_MESHES:
        recipe = noted(mesh, key)
        if recipe is not None and recipe not in found:
            found.append(recipe)
    return found
