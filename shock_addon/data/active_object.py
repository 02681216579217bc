# SPDX-License-Identifier: GPL-3.0-or-later
"""Read the active object alone, whatever else is selected."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy

from .meshes import Target, read_targets


def read_active(
    context: bpy.types.Context, read: Callable[..., tuple], parameters: Any
) -> tuple[list[Target], list[str]]:
    """Read the active object; parameters and what is returned are those of `read_targets`."""
    only = [context.object]
    with context.temp_override(selected_objects=only, objects_in_mode=only):
        return read_targets(bpy.context, read, parameters)
