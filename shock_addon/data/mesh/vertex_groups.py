# SPDX-License-Identifier: GPL-3.0-or-later
"""The weights of vertex groups.

Scripts reach weights only vertex by vertex, which takes seconds on a million of them. Geometry
nodes read them at once: a copy of the mesh, in a separate scene, outputs them as an attribute.
"""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any

import bpy
import numpy as np
import numpy.typing as npt

from .. import arrays
from ..skipped import Skipped

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
    with ExitStack() as stack:

        def temporary(collection: Any, added: Any) -> Any:
            stack.callback(collection.remove, added)
            return added

        mesh = temporary(bpy.data.meshes, obj.data.copy())
        copy = temporary(bpy.data.objects, bpy.data.objects.new(_NAME, mesh))
        tree = temporary(bpy.data.node_groups, bpy.data.node_groups.new(_NAME, "GeometryNodeTree"))
        scene = temporary(bpy.data.scenes, bpy.data.scenes.new(_NAME))
        if mesh.shape_keys is not None:
            mesh.shape_keys.animation_data_clear()  # drivers would bring other objects along
        group = copy.vertex_groups[name]
        group.name = "shock_filter group"  # an attribute's name would hide it
        _build(tree, group.name)
        copy.modifiers.new(_NAME, "NODES").node_group = tree
        scene.collection.objects.link(copy)
        layer = scene.view_layers[0]
        layer.update()
        attributes = copy.evaluated_get(layer.depsgraph).data.attributes
        return arrays.read_attribute(attributes[_WEIGHTS]).astype(np.float64)


def carry(old: bpy.types.Mesh, obj: bpy.types.Object) -> None:
    """Give an object that is in no scene the vertex groups of another mesh that it lacks.

    Weights are those of the nearest places of that mesh.
    """
    with ExitStack() as stack:
        was = bpy.data.objects.new(_NAME, old)
        stack.callback(bpy.data.objects.remove, was)
        missing = [group.name for group in was.vertex_groups if group.name not in obj.vertex_groups]
        if not missing:
            return
        for name in missing:
            obj.vertex_groups.new(name=name)
        modifier = obj.modifiers.new(_NAME, "DATA_TRANSFER")
        stack.callback(obj.modifiers.remove, modifier)
        modifier.object, modifier.use_object_transform = was, False
        modifier.use_vert_data, modifier.data_types_verts = True, {"VGROUP_WEIGHTS"}
        modifier.vert_mapping = "POLYINTERP_NEAREST" if old.polygons else "NEAREST"
        modifier.layers_vgroup_select_src, modifier.layers_vgroup_select_dst = "ALL", "NAME"
        scene = bpy.data.scenes.new(_NAME)
        stack.callback(bpy.data.scenes.remove, scene)
        for each in (was, obj):
            scene.collection.objects.link(each)
        layer = scene.view_layers[0]
        layer.update()
        mesh = bpy.data.meshes.new_from_object(
            obj.evaluated_get(layer.depsgraph),
            preserve_all_data_layers=True,
            depsgraph=layer.depsgraph,
        )
        before, obj.data = obj.data, mesh
        bpy.data.meshes.remove(before)


def _build(tree: bpy.types.NodeTree, name: str) -> None:
    """Make nodes that store the group of this name as an attribute."""
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
