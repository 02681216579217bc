# SPDX-License-Identifier: GPL-3.0-or-later
"""The modifier of a live result in the stack of its object."""

from __future__ import annotations

from typing import Any

import bpy

from ..chosen import live_modifier
from ..skipped import Skipped
from . import nodes

_BOUND = {"MULTIRES", "SOFT_BODY"}
"""Modifiers that need the mesh itself right below them."""


def check(obj: bpy.types.Object) -> None:
    """Raise `Skipped` if no modifier can stand first in the stack."""
    if obj.library is not None:
        raise Skipped("it is linked from another file; make it local first")
    if live_modifier(obj) is not None:
        return
    for modifier in obj.modifiers:
        if modifier.type in _BOUND:
            raise Skipped(
                "its modifier {name} needs the mesh right below it; apply it, or choose the output"
                " Mesh",
                name=modifier.name,
            )


def add(obj: bpy.types.Object, mark_sharp: bool) -> bpy.types.NodesModifier:
    """Put the modifier first in the stack; one that is there keeps its place and its inputs."""
    modifier = live_modifier(obj)
    if modifier is not None:
        return modifier
    modifier = obj.modifiers.new(nodes.NAME, "NODES")
    modifier.node_group = nodes.find_or_build()
    obj.modifiers.move(len(obj.modifiers) - 1, 0)
    write_input(modifier, nodes.MARK_SHARP, mark_sharp)
    return modifier


def users_of(mesh: bpy.types.Mesh) -> list[bpy.types.Object]:
    """List the file's own objects that show a mesh."""
    return [obj for obj in bpy.data.objects if obj.data == mesh and obj.library is None]


def read_input(modifier: bpy.types.NodesModifier, name: str) -> Any:
    """Return the value of an input of the group."""
    key = nodes.input_of(modifier.node_group, name)
    if hasattr(modifier, "properties"):  # Blender 5.2
        return getattr(modifier.properties.inputs, key).value
    return modifier[key]


def write_input(modifier: bpy.types.NodesModifier, name: str, value: Any) -> None:
    """Set an input of the group."""
    key = nodes.input_of(modifier.node_group, name)
    if hasattr(modifier, "properties"):
        getattr(modifier.properties.inputs, key).value = value
    else:
        modifier[key] = value
    modifier.id_data.update_tag()


def link_input(modifier: bpy.types.NodesModifier, name: str, attribute: str) -> None:
    """Let an input of the group read an attribute or a vertex group."""
    key = nodes.input_of(modifier.node_group, name)
    if hasattr(modifier, "properties"):
        socket = getattr(modifier.properties.inputs, key)
        socket.type, socket.attribute_name = "ATTRIBUTE", attribute
    else:
        modifier[f"{key}_use_attribute"] = True
        modifier[f"{key}_attribute_name"] = attribute
    modifier.id_data.update_tag()


def linked_input(modifier: bpy.types.NodesModifier, name: str) -> str:
    """Name the attribute or vertex group that an input reads; empty for a value."""
    key = nodes.input_of(modifier.node_group, name)
    if hasattr(modifier, "properties"):
        socket = getattr(modifier.properties.inputs, key)
        return socket.attribute_name if socket.type == "ATTRIBUTE" else ""
    return modifier[f"{key}_attribute_name"] if modifier[f"{key}_use_attribute"] else ""


def draw_input(layout: bpy.types.UILayout, modifier: bpy.types.NodesModifier, name: str) -> None:
    """Draw the value of an input."""
    key = nodes.input_of(modifier.node_group, name)
    if hasattr(modifier, "properties"):
        layout.prop(getattr(modifier.properties.inputs, key), "value", text=name)
    else:
        layout.prop(modifier, f'["{key}"]', text=name)
