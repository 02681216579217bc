# SPDX-License-Identifier: GPL-3.0-or-later
"""How a live result was made, kept with its mesh so that it can be made again."""

from __future__ import annotations

import json
from typing import Any

import bpy

from .. import LIVE_COLORS, LIVE_STAMP

Recipe = tuple[str, dict[str, Any]]
"""The name of an operator, and its properties."""


class AsLive:
    """The parameters of an operator, with the output Live."""

    output = "LIVE"

    def __init__(self, parameters: Any) -> None:
        self._parameters = parameters

    def __getattr__(self, name: str) -> Any:
        return getattr(self._parameters, name)


def note(
    mesh: bpy.types.Mesh, operator: str, settings: dict[str, Any], key: str = LIVE_STAMP
) -> None:
    """Keep with a mesh the operator's name and its properties; `key` is `LIVE_COLORS` of colors."""
    mesh[key] = json.dumps({"operator": operator, "settings": settings})


def noted(mesh: bpy.types.Mesh, key: str = LIVE_STAMP) -> Recipe | None:
    """Return the operator and the properties that made a mesh's result; None if nothing says so."""
    try:
        found = json.loads(mesh.get(key, ""))
        return str(found["operator"]), dict(found["settings"])
    except (ValueError, TypeError, KeyError):
        return None


def all_noted(mesh: bpy.types.Mesh) -> list[Recipe]:
    """List what made the results of a mesh: colors, then the shape; once if one made both."""
    found: list[Recipe] = []
    for key in (LIVE_COLORS, LIVE_STAMP):
        recipe = noted(mesh, key)
        if recipe is not None and recipe not in found:
            found.append(recipe)
    return found
