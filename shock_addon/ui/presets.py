# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets of the modes: those of the extension, then the user's own."""

import struct
from typing import Any

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel
from bpy.app.translations import pgettext_iface as iface_
from bpy.app.translations import pgettext_tip

from ..data import PICTURES
from ..modes import DEFAULTS, Mode, Preset, choices, find
from ..operators.properties import label

_OF_ONE_OBJECT = {
    "vertex_group",
    "attribute",
    "image",
    "mask_image",
    "gain_map",
    "gain_colors",
    "start_group",
    "start_image",
    "along_attribute",
    "field",
    "folder",
    "scale_map",
    *PICTURES,
}

_REMOVED = "Presets"
"""Blender's label of a list of presets after one was removed."""

_MODES = [(mode.key, label(mode.key), "") for mode in choices()]


class SHOCK_FILTER_OT_use_preset(bpy.types.Operator):
    """Set all settings of the filter; masks and output stay"""

    bl_idname = "shock_filter.use_preset"
    bl_label = "Use Preset"
    bl_options = {"UNDO", "INTERNAL"}

    mode: bpy.props.EnumProperty(items=_MODES)
    name: bpy.props.StringProperty()

    @classmethod
    def description(
        cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties
    ) -> str:
        """Give the preset's reason."""
        preset = _find(properties.mode, properties.name)
        return pgettext_tip(preset.reason) if preset else ""

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Set the values, and the defaults of all others."""
        preset = _find(self.mode, self.name)
        if preset is None:
            names = ", ".join(preset.name for preset in _presets(self.mode))
            self.report({"ERROR"}, f"There is no preset {self.name!r}; choose one of: {names}.")
            return {"CANCELLED"}
        settings = getattr(context.scene.shock_filter, self.mode)
        for name in find(self.mode).filter_names:
            settings.property_unset(name)
        for name, value in preset.values.items():
            setattr(settings, name, value)
        return {"FINISHED"}


def _presets(mode: str) -> tuple[Preset, ...]:
    return DEFAULTS, *find(mode).presets


def _find(mode: str, name: str) -> Preset | None:
    known = (*_presets(mode), *find(mode).former)
    return next((preset for preset in known if preset.name == name), None)


_labels: dict[str, str] = {}
"""The names of the lists, by mode, to which Blender gives that of the last preset of a user."""

_values: dict[str, tuple[str, list[Any]]] = {}
"""That name, by mode, and what all was set to when a panel showed it first."""


def shown_name(mode: Mode, settings: Any) -> str:
    """Name the preset whose values the settings have; "Custom" if there is none.

    Parameters
    ----------
    mode : Mode
    settings : bpy.types.PropertyGroup
        The mode's settings.
    """
    differing = {
        name: getattr(settings, name)
        for name in mode.filter_names
        if getattr(settings, name) != _default(settings, name)
    }
    for preset in _presets(mode.key):
        wanted = {
            name: _stored(settings, name, value)
            for name, value in preset.values.items()
            if _stored(settings, name, value) != _default(settings, name)
        }
        if differing == wanted:
            return iface_(preset.name)
    name = getattr(bpy.types, f"SHOCK_FILTER_PT_{mode.key}_presets").bl_label
    now = [getattr(settings, each) for each in mode.filter_names]
    if name not in {_labels[mode.key], _REMOVED}:
        if _values.get(mode.key, ("",))[0] != name:
            _values[mode.key] = name, now
        if _values[mode.key][1] == now:
            return name
    return iface_("Custom")


def _default(settings: Any, name: str) -> Any:
    return settings.bl_rna.properties[name].default


def _stored(settings: Any, name: str, value: Any) -> Any:
    """Return a value as Blender stores it, whose numbers are short."""
    if settings.bl_rna.properties[name].type != "FLOAT":
        return value
    return struct.unpack("f", struct.pack("f", value))[0]


class _ModePresets(PresetPanel):
    """The list that the button with the preset's name opens."""

    mode: str
    preset_subdir: str
    preset_add_operator: str
    preset_operator = "script.execute_preset"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the shipped presets above those in the user's folder."""
        layout = self.layout
        layout.emboss = "PULLDOWN_MENU"
        column = layout.column(align=True)
        for preset in _presets(self.mode):
            operator = column.operator("shock_filter.use_preset", text=preset.name)
            operator.mode, operator.name = self.mode, preset.name
        layout.separator()
        if bpy.utils.preset_paths(self.preset_subdir):
            super().draw(context)
        else:  # Blender would name the folder as missing
            _draw_new(layout, context, self.preset_add_operator)


def _draw_new(layout: bpy.types.UILayout, context: bpy.types.Context, add_operator: str) -> None:
    """Draw a field for a name, and the button that adds a preset of that name."""
    row = layout.row()
    field = row.row()
    field.emboss = "NORMAL"
    field.prop(context.window_manager, "preset_name", text="")
    row.operator(add_operator, text="", icon="ADD").name = context.window_manager.preset_name


def _panel(mode: Mode) -> type:
    _labels[mode.key] = f"{label(mode.key)} Presets"
    return type(
        f"SHOCK_FILTER_PT_{mode.key}_presets",
        (_ModePresets, bpy.types.Panel),
        {
            "__doc__": _ModePresets.__doc__,
            "mode": mode.key,
            "bl_label": _labels[mode.key],
            "preset_subdir": f"shock_filter/{mode.key}",
            "preset_add_operator": f"shock_filter.{mode.key}_preset_add",
        },
    )


class _AddPreset(AddPresetBase):
    """The properties that Blender reads to save a preset."""

    mode: str

    @property
    def preset_defines(self) -> list[str]:
        """Return code that finds the settings."""
        return [f"settings = bpy.context.scene.shock_filter.{self.mode}"]

    @property
    def preset_values(self) -> list[str]:
        """List the properties that a preset keeps."""
        return [f"settings.{name}" for name in kept(find(self.mode))]


def kept(mode: Mode) -> list[str]:
    """List the properties that presets of a mode keep."""
    return [name for name in mode.names if name not in _OF_ONE_OBJECT]


def _add_operator(mode: Mode) -> type:
    return type(
        f"SHOCK_FILTER_OT_{mode.key}_preset_add",
        (_AddPreset, bpy.types.Operator),
        {
            "__doc__": f"Add or remove a preset of the settings for {label(mode.key).lower()}",
            "mode": mode.key,
            "bl_idname": f"shock_filter.{mode.key}_preset_add",
            "bl_label": f"Add {label(mode.key)} Preset",
            "preset_menu": f"SHOCK_FILTER_PT_{mode.key}_presets",
            "preset_subdir": f"shock_filter/{mode.key}",
        },
    )


CLASSES = (
    SHOCK_FILTER_OT_use_preset,
    *(_panel(mode) for mode in choices()),
    *(_add_operator(mode) for mode in choices()),
)
