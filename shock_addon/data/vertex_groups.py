# SPDX-License-Identifier: GPL-3.0-or-later
"""The weights of vertex groups.

Scripts reach weights only vertex by vertex, which takes seconds on a million of them. Geometry
nodes read them at once: a copy of the mesh, in a scene of its own, hands them out as an attribute.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import numpy as np
import numpy.typing as npt

from . import arrays
from .skipped import Skipped

_NAME = "shock_filter"
_WEIGHTS = "shock_filter weights"


def group_weights(obj: bpy.types.Object, name: str) -> npt.NDArray[np.float64]:
    """Read a vertex group's weights, 0 for vertices outside it: (n,).

    Raises
    ------
    Skipped
        If the object has no such group.
    """
    if name not in obj.vertex_groups:
        raise Skipped(
            "it has no vertex group named {name!r}; add it, or leave the field empty", name=name
        )
    with _copy(obj.data) as copy:
        group = copy.vertex_groups[name]
        group.name = "shock_filter group"  # an attribute's name would hide it
        with _weights_as_attribute(copy, group.name) as mesh:
            return arrays.read_attribute(mesh.attributes[_WEIGHTS]).astype(np.float64)


@contextmanager
def _copy(mesh: bpy.types.Mesh) -> Iterator[bpy.types.Object]:
    """Give an object with a copy of the mesh."""
    copy = mesh.copy()
    obj = bpy.data.objects.new(_NAME, copy)
    try:
        if copy.shape_keys is not None:
            copy.shape_keys.animation_data_clear()  # drivers would bring other objects along
        yield obj
    finally:
        bpy.data.objects.remove(obj)
        bpy.data.meshes.remove(copy)  # takes the copied shape keys along


@contextmanager
def _weights_as_attribute(obj: bpy.types.Object, group: str) -> Iterator[bpy.types.Mesh]:
    """Give the evaluated mesh of an object, with a vertex group as an attribute."""
    scene = bpy.data.scenes.new(_NAME)
    tree = bpy.data.node_groups.new(_NAME, "GeometryNodeTree")
    try:
        _build(tree, group)
        obj.modifiers.new(_NAME, "NODES").node_group = tree
        scene.collection.objects.link(obj)
        layer = scene.view_layers[0]
        layer.update()
        yield obj.evaluated_get(layer.depsgraph).data
    finally:
        bpy.data.scenes.remove(scene)
        bpy.data.node_groups.remove(tree)


def _build(tree: bpy.types.NodeTree, name: str) -> None:
    for direction in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    start, end = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    group = tree.nodes.new("GeometryNodeInputNamedAttribute")
    store = tree.nodes.new("GeometryNodeStoreNamedAttribute")
    group.data_type = store.data_type = "FLOAT"
    store.domain = "POINT"
    group.inputs["Name"].default_value = name
    store.inputs["Name"].default_value = _WEIGHTS
    tree.links.new(start.outputs["Geometry"], store.inputs["Geometry"])
    tree.links.new(group.outputs["Attribute"], store.inputs["Value"])
    tree.links.new(store.outputs["Geometry"], end.inputs["Geometry"])
