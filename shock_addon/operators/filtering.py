# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators that filter, one for each row of the table of modes."""

from __future__ import annotations

import bpy

from ..modes import MODES, Mode, load
from .properties import OF_ONE_RUN, parameters_of


def classes() -> list[type]:
    """Make them; they have the parameters that the panel keeps, and those of one run."""
    return [_operator(mode) for mode in MODES]


def _operator(mode: Mode) -> type:
    of_one_run = OF_ONE_RUN.get(mode.targets[-1].data_kind, {})
    return type(
        f"SHOCK_FILTER_OT_{mode.operator}",
        (load(mode.data.base), bpy.types.Operator),
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
