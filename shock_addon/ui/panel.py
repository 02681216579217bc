# SPDX-License-Identifier: GPL-3.0-or-later
"""The base class of the panels."""

from __future__ import annotations

import bpy

from ..modes import Mode, find
from ..operators import choosing


class Panel:
    """A panel of the mode that is chosen in the 3D view.

    Attributes
    ----------
    choice, job : str
        The properties of the mode and of the first row.
    own : str
        Key of its mode, if it is always the same.
    """

    choice = "mode"
    job = "job"
    own = ""
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Shock Filter"

    @classmethod
    def mode(cls, context: bpy.types.Context) -> Mode:
        return find(cls.own) if cls.own else choosing.mode(context, cls.choice)

    @classmethod
    def settings(cls, context: bpy.types.Context) -> bpy.types.PropertyGroup:
        return getattr(context.scene.shock_filter, cls.mode(context).group)
