# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator Sharpen Colors."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt

from ...core import host as filters
from ...core.settings import ShockSettings
from .. import data
from .base import MeshOperator, Steps, counted, describe_colors
from .properties import ColorProperties


class SHOCK_FILTER_OT_sharpen_colors(MeshOperator, ColorProperties, bpy.types.Operator):
    """Turn blurred edges between painted colors into sharp ones, without new colors beside them"""

    bl_idname = "shock_filter.sharpen_colors"
    bl_label = "Sharpen Colors"
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    mode = "colors"
    settings_type = ShockSettings

    def steps(self) -> Steps:
        """Sharpen the colors of an attribute."""
        return Steps(data.read_colors, filters.sharpen_colors, data.write_colors)

    def summary(self, written: list[tuple], seconds: float) -> str:
        """Count meshes and colors."""
        return pgettext_rpt("Sharpened the colors of {meshes}: {changes}, {seconds:.1f} s.").format(
            meshes=counted(len(written), "1 mesh", "{:,} meshes"),
            changes=describe_colors([result for _, result in written], "colors"),
            seconds=seconds,
        )


CLASSES = (SHOCK_FILTER_OT_sharpen_colors,)
