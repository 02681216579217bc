# SPDX-License-Identifier: GPL-3.0-or-later
"""The images in the nodes of materials."""

from __future__ import annotations

import bpy

from . import LIVE_RESULT_OF, LIVE_TEXTURE
from .skipped import Skipped

MASK = "Mask"
"""The input of a live texture that says where its result is seen."""

_ON_THE_WAY = {"REROUTE", "INVERT"}
"""Kinds of nodes that may lie between a mask and that input."""


def active_image(material: bpy.types.Material) -> bpy.types.Image:
    """Return the image of the active node, or else the image of the base color.

    Raises
    ------
    Skipped
        If there is none, or more than one.
    """
    nodes = [
        node for node in image_nodes(material) if node.image is not None and not is_beside(node)
    ]
    if not nodes:
        raise Skipped(
            "its material {name} has no Image Texture node with an image; add one, or name an"
            " image",
            name=material.name,
        )
    active = material.node_tree.nodes.active
    chosen = [node for node in nodes if node == active]
    chosen = chosen or colors_surface(material.node_tree) or nodes
    if len({node.image for node in chosen}) > 1:
        raise Skipped(
            "its material {name} has several images ({images}); click the node of the one that is"
            " meant, or name it",
            name=material.name,
            images=", ".join(sorted({node.image.name for node in chosen})),
        )
    return chosen[0].image


def colors_surface(tree: bpy.types.NodeTree) -> list[bpy.types.ShaderNodeTexImage]:
    """List the image texture nodes that feed a shader's base color."""
    ahead = [
        socket
        for node in tree.nodes
        for socket in node.inputs
        if socket.name == "Base Color" and socket.is_linked
    ]
    found: list[bpy.types.ShaderNodeTexImage] = []
    for socket in ahead:
        for node in (link.from_node for link in socket.links):
            is_image = node.type == "TEX_IMAGE" and node.image is not None
            if is_image and not is_beside(node):
                found.append(node)
            ahead += [each for each in node.inputs if each.is_linked and each not in ahead]
    return found


def materials_of(names: list[str]) -> list[bpy.types.Material]:
    """List the materials of the objects of these names."""
    objects = [obj for obj in bpy.data.objects if obj.name in names]
    slots = [slot.material for obj in objects for slot in obj.material_slots]
    return list(filter(None, dict.fromkeys(slots)))


def image_nodes(material: bpy.types.Material) -> list[bpy.types.ShaderNodeTexImage]:
    """List the image texture nodes of a material, including those in node groups."""
    # From Blender 5.0 on, all materials use nodes, and asking is deprecated.
    if material.node_tree is None or not (bpy.app.version >= (5, 0, 0) or material.use_nodes):
        return []
    found, trees = [], [material.node_tree]
    for tree in trees:
        for node in tree.nodes:
            if node.type == "TEX_IMAGE":
                found.append(node)
            elif node.type == "GROUP" and node.node_tree not in [None, *trees]:
                trees.append(node.node_tree)
    return found


def live_mix(node: bpy.types.ShaderNodeTexImage, name: str = "Old") -> bpy.types.Node | None:
    """Return the node of a live texture that reads an image by its input Old, or New."""
    links = list(node.outputs["Color"].links)
    for link in links:
        if link.to_node.type == "REROUTE":
            links += [each for each in link.to_node.outputs[0].links if each not in links]
        elif _is_live_mix(link.to_node) and link.to_socket.name == name:
            return link.to_node
    return None


def is_beside(node: bpy.types.ShaderNodeTexImage) -> bool:
    """Whether a node contains the result or the mask of a live texture, and not a texture."""
    return is_live_result(node) or is_live_mask(node)


def is_live_mask(node: bpy.types.ShaderNodeTexImage) -> bool:
    """Whether the color of a node goes into the masks of live textures alone."""
    links = list(node.outputs["Color"].links)
    for link in links:  # grows
        if link.to_node.type in _ON_THE_WAY:
            links += [each for each in link.to_node.outputs[0].links if each not in links]
    ends = [link for link in links if link.to_node.type not in _ON_THE_WAY]
    return bool(ends) and all(
        _is_live_mix(link.to_node) and link.to_socket.name == MASK for link in ends
    )


def live_mask(mix: bpy.types.Node) -> tuple[bpy.types.ShaderNodeTexImage | None, bool]:
    """Return the node with the mask of a live texture, None for no image, and if it is inverted."""
    is_inverted, links = False, list(mix.inputs[MASK].links)
    while links:
        node = links[0].from_node
        if node.type == "TEX_IMAGE" and node.image is not None:
            return node, is_inverted
        if node.type not in _ON_THE_WAY:
            break
        is_inverted ^= node.type == "INVERT"
        links = list(node.inputs["Color" if node.type == "INVERT" else 0].links)
    return None, False


def masked_image(obj: bpy.types.Object | None, mask: bpy.types.Image) -> bpy.types.Image | None:
    """Return the texture of an object whose live result an image masks; None if it masks none."""
    slots = [] if obj is None else obj.material_slots
    for material in filter(None, (slot.material for slot in slots)):
        for node in image_nodes(material):
            mix = live_mix(node)
            found = None if mix is None else live_mask(mix)[0]
            if found is not None and found.image == mask:
                return node.image
    return None


def is_live_result(node: bpy.types.ShaderNodeTexImage) -> bool:
    """Whether a node holds the result of a live texture, linked or not."""
    mix = node.id_data.nodes.get(node.get(LIVE_RESULT_OF, ""))
    return (mix is not None and _is_live_mix(mix)) or live_mix(node, "New") is not None


def _is_live_mix(node: bpy.types.Node) -> bool:
    return node.type == "GROUP" and node.node_tree is not None and LIVE_TEXTURE in node.node_tree
