# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets in the panels' headers: named sets of a mode's settings."""

from __future__ import annotations

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel

from .properties import NAMES, label

_OF_ONE_OBJECT = {"vertex_group", "attribute", "image", "mask_image"}


def _panel(mode: str) -> type:
    return type(
        f"SHOCK_FILTER_PT_{mode}_presets",
        (PresetPanel, bpy.types.Panel),
        {
            "__doc__": "The list that the header's button opens.",
            "__module__": __name__,
            "bl_label": f"{label(mode)} Presets",
            "preset_subdir": f"shock_filter/{mode}",
            "preset_operator": "script.execute_preset",
            "preset_add_operator": f"shock_filter.{mode}_preset_add",
        },
    )


def _add_operator(mode: str) -> type:
    names = [name for name in NAMES[mode] if name not in _OF_ONE_OBJECT]
    return type(
        f"SHOCK_FILTER_OT_{mode}_preset_add",
        (AddPresetBase, bpy.types.Operator),
        {
            "__doc__": f"Add or remove a preset of the settings for {label(mode).lower()}",
            "__module__": __name__,
            "bl_idname": f"shock_filter.{mode}_preset_add",
            "bl_label": f"Add {label(mode)} Preset",
            "preset_menu": f"SHOCK_FILTER_PT_{mode}_presets",
            "preset_subdir": f"shock_filter/{mode}",
            "preset_defines": [f"settings = bpy.context.scene.shock_filter.{mode}"],
            "preset_values": [f"settings.{name}" for name in names],
        },
    )


PANELS = {mode: _panel(mode) for mode in NAMES}
CLASSES = (*PANELS.values(), *(_add_operator(mode) for mode in NAMES))
