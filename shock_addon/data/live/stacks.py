# SPDX-License-Identifier: GPL-3.0-or-later
"""The modifier of a live result in the stack of its object."""

from __future__ import annotations

from typing import Any

import bpy

from ..chosen import live_modifier, live_modifiers
from ..skipped import Skipped
from . import graph

_BOUND = {"MULTIRES", "SOFT_BODY"}
"""Modifiers that need the mesh itself right below them."""


def check(obj: bpy.types.Object) -> None:
    """Raise `Skipped` if no modifier can stand first in the stack."""
    if obj.library is not None:
        raise Skipped("it is linked from another file; make it local first")
    if live_modifiers(obj):
        return
    for modifier in obj.modifiers:
        if modifier.type in _BOUND:
            raise Skipped(
                "its modifier {name} needs the mesh right below it; apply it, or choose the output"
                " Mesh",
                name=modifier.name,
            )


def add(obj: bpy.types.Object, tree: bpy.types.NodeTree, key: str) -> bpy.types.NodesModifier:
    """Put a modifier with a group first in the stack; one that is there keeps its place.

    Parameters
    ----------
    obj : bpy.types.Object
    tree : bpy.types.NodeTree
    key : str
        `LIVE_STAMP`, or `LIVE_COLORS`: what groups of that kind have.
    """
    modifier = live_modifier(obj, key)
    if modifier is not None:
        return modifier
    modifier = obj.modifiers.new(tree.name, "NODES")
    modifier.node_group = tree
    obj.modifiers.move(len(obj.modifiers) - 1, 0)
    return modifier


def users_of(mesh: bpy.types.Mesh) -> list[bpy.types.Object]:
    """List the file's own objects that show a mesh."""
    return [obj for obj in bpy.data.objects if obj.data == mesh and obj.library is None]


def takers(obj: bpy.types.Object) -> list[bpy.types.Object]:
    """List the file's own objects that show the mesh of one and can take a modifier.

    Raises
    ------
    Skipped
        If the object itself cannot; others show the mesh as it was.
    """
    check(obj)
    return [obj, *(user for user in users_of(obj.data) if user != obj and _can_take(user))]


def _can_take(obj: bpy.types.Object) -> bool:
    try:
        check(obj)
    except Skipped:
        return False
    return True


def read_input(modifier: bpy.types.NodesModifier, name: str) -> Any:
    """Return the value of an input of the group."""
    key = graph.input_of(modifier.node_group, name)
    if hasattr(modifier, "properties"):  # Blender 5.2
        return getattr(modifier.properties.inputs, key).value
    return modifier[key]


def write_input(modifier: bpy.types.NodesModifier, name: str, value: Any) -> None:
    """Set an input of the group."""
    key = graph.input_of(modifier.node_group, name)
    if hasattr(modifier, "properties"):
        getattr(modifier.properties.inputs, key).value = value
    else:
        modifier[key] = value
    modifier.id_data.update_tag()


def link_input(modifier: bpy.types.NodesModifier, name: str, attribute: str) -> None:
    """Let an input of the group read an attribute or a vertex group."""
    key = graph.input_of(modifier.node_group, name)
    if hasattr(modifier, "properties"):
        socket = getattr(modifier.properties.inputs, key)
        socket.type, socket.attribute_name = "ATTRIBUTE", attribute
    else:
        modifier[f"{key}_use_attribute"] = True
        modifier[f"{key}_attribute_name"] = attribute
    modifier.id_data.update_tag()


def linked_input(modifier: bpy.types.NodesModifier, name: str) -> str:
    """Name the attribute or vertex group that an input reads; empty for a value."""
    key = graph.input_of(modifier.node_group, name)
    if hasattr(modifier, "properties"):
        socket = getattr(modifier.properties.inputs, key)
        return socket.attribute_name if socket.type == "ATTRIBUTE" else ""
    return modifier[f"{key}_attribute_name"] if modifier[f"{key}_use_attribute"] else ""


def draw_input(
    layout: bpy.types.UILayout, modifier: bpy.types.NodesModifier, name: str, label: str
) -> None:
    """Draw the value of an input."""
    key = graph.input_of(modifier.node_group, name)
    if hasattr(modifier, "properties"):
        layout.prop(getattr(modifier.properties.inputs, key), "value", text=label)
    else:
        layout.prop(modifier, f'["{key}"]', text=label)
