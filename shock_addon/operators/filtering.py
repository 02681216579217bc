# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators that filter, one for each row of the table of modes."""

from __future__ import annotations

from functools import cache

import bpy

from ..modes import MODES, Mode
from .base import FilterOperator
from .generating import GenerateOperator
from .images import ImageOperator
from .meshes import MeshOperator
from .properties import OF_ONE_RUN, parameters_of
from .textures import TextureOperator
from .visualizing import FlowOperator


def classes() -> list[type]:
    """List all operators that filter."""
    return [operator_of(mode) for mode in MODES]


@cache
def operator_of(mode: Mode) -> type[bpy.types.Operator]:
    """Make a mode's operator, with the parameters of the panel and those of one run."""
    bases: dict[str, type[FilterOperator]] = {
        "meshes": MeshOperator,
        "images": ImageOperator,
        "textures": TextureOperator,
        "fields": GenerateOperator,
        "films": FlowOperator,
    }
    of_one_run = OF_ONE_RUN.get(mode.targets[-1].data_kind, {})
    return type(
        f"SHOCK_FILTER_OT_{mode.operator}",
        (bases[mode.data.handled_as], bpy.types.Operator),
        {
            "__doc__": mode.tooltip,
            "__module__": __name__,
            "__annotations__": {**parameters_of(mode), **of_one_run},
            "bl_idname": f"shock_filter.{mode.operator}",
            "bl_label": mode.title,
            "bl_options": {"REGISTER", "UNDO", "PRESET"},
            "row": mode,
        },
    )
