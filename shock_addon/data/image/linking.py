# SPDX-License-Identifier: GPL-3.0-or-later
"""Links of generated images to the shaders of materials."""

from __future__ import annotations

import bpy

from ....core.host import forgetting
from ..chosen import mesh_objects
from ..skipped import Refused

_made: list[int] = []
"""The uids of generated images, the last one at the end."""

_AWAY = 300.0
"""How far to the left of a shader its new Mix node is."""


@forgetting.with_file
def forget() -> None:
    """Forget the images of the previous file."""
    _made.clear()


def note(image: bpy.types.Image) -> None:
    """Remember a generated image, which `waiting` then finds."""
    if image.session_uid in _made:
        _made.remove(image.session_uid)
    _made.append(image.session_uid)


def waiting(context: bpy.types.Context) -> bpy.types.Image | None:
    """Return the image that was generated last, if its node in a chosen material is not linked."""
    nodes = [node for tree in _trees(context) for node in _image_nodes(tree)]
    for uid in reversed(_made):
        found = [node for node in nodes if node.image.session_uid == uid]
        if found:
            return None if any(map(is_linked, found)) else found[0].image
    return None


def is_linked(node: bpy.types.Node) -> bool:
    """Whether something reads a node."""
    return any(output.is_linked for output in node.outputs)


def link(context: bpy.types.Context, image: bpy.types.Image, into: str) -> list[str]:
    """Link an image to the shaders of the chosen objects' materials that hold it.

    Parameters
    ----------
    context : bpy.types.Context
    image : bpy.types.Image
    into : str
        "COLOR" or "ROUGHNESS", in place of what is linked there; or "FACTOR", by which a Mix node
        goes from the color that was there to white.

    Returns
    -------
    list of str
        The names of the materials.

    Raises
    ------
    Refused
        If no material holds the image, or one has no shader with a base color. Nothing is changed.
    """
    found = []
    for tree in _trees(context):
        held = [node for node in _image_nodes(tree) if node.image == image]
        if held:
            found.append((tree, held[0], _shaders(tree)))
    if not found:
        text = "No material of the selected objects holds {name}; add an Image Texture node."
        raise Refused(text, name=image.name)
    for tree, _, shaders in found:
        if not shaders:
            text = "{name} has no Principled BSDF; link the node by hand."
            raise Refused(text, name=_material_of(context, tree).name)
    for tree, node, shaders in found:
        for shader in shaders:
            if into == "FACTOR":
                _mix(tree, node, shader)
            else:
                name = "Base Color" if into == "COLOR" else "Roughness"
                tree.links.new(node.outputs["Color"], shader.inputs[name])
    return [_material_of(context, tree).name for tree, _, _ in found]


def _mix(tree: bpy.types.NodeTree, node: bpy.types.Node, shader: bpy.types.Node) -> None:
    color = shader.inputs["Base Color"]
    mix = tree.nodes.new("ShaderNodeMix")
    mix.data_type = "RGBA"
    mix.location = shader.location[0] - _AWAY, shader.location[1]
    ends = {socket.identifier: socket for socket in (*mix.inputs, *mix.outputs)}
    if color.is_linked:
        tree.links.new(color.links[0].from_socket, ends["A_Color"])
    else:
        ends["A_Color"].default_value = color.default_value
    ends["B_Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    tree.links.new(node.outputs["Color"], ends["Factor_Float"])
    tree.links.new(ends["Result_Color"], color)


def _shaders(tree: bpy.types.NodeTree) -> list[bpy.types.Node]:
    return [node for node in tree.nodes if {"Base Color", "Roughness"} <= set(node.inputs.keys())]


def _materials(context: bpy.types.Context) -> list[bpy.types.Material]:
    found = dict.fromkeys(obj.active_material for obj in mesh_objects(context))
    return [each for each in found if each is not None and each.library is None]


def _trees(context: bpy.types.Context) -> list[bpy.types.NodeTree]:
    trees = [material.node_tree for material in _materials(context)]
    return [tree for tree in trees if tree is not None]


def _material_of(context: bpy.types.Context, tree: bpy.types.NodeTree) -> bpy.types.Material:
    return next(each for each in _materials(context) if each.node_tree == tree)


def _image_nodes(tree: bpy.types.NodeTree) -> list[bpy.types.Node]:
    return [node for node in tree.nodes if node.type == "TEX_IMAGE" and node.image is not None]
