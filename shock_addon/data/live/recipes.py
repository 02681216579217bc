# SPDX-License-Identifier: GPL-3.0-or-later
"""How a live result was made, kept with its mesh so that it can be made again."""

from __future__ import annotations

import json
from typing import Any

import bpy

from .. import LIVE_STAMP


class AsLive:
    """The parameters of an operator, with the output Live."""

    output = "LIVE"

    def __init__(self, parameters: Any) -> None:
        self._parameters = parameters

    def __getattr__(self, name: str) -> Any:
        return getattr(self._parameters, name)


def note(mesh: bpy.types.Mesh, operator: str, settings: dict[str, Any]) -> None:
    """Keep with a mesh the operator's name and its properties."""
    mesh[LIVE_STAMP] = json.dumps({"operator": operator, "settings": settings})


def noted(mesh: bpy.types.Mesh) -> tuple[str, dict[str, Any]] | None:
    """Return the operator and the properties that made a mesh's result; None if nothing says so."""
    try:
        found = json.loads(mesh.get(LIVE_STAMP, ""))
        return str(found["operator"]), dict(found["settings"])
    except (ValueError, TypeError, KeyError):
        return None
