# SPDX-License-Identifier: GPL-3.0-or-later
"""Live textures: nodes in materials that mix an image with its result.

A group of shader nodes, *Shock Filter Texture*, stands between the node of the image and what reads
it; a node beside that of the image holds the result.
"""

from __future__ import annotations

import bpy

from .. import LIVE_RESULT_OF, LIVE_TEXTURE
from ..materials import MASK, live_mix
from ..mixes import AMOUNT, NEW, OLD, mixed, nodes_of, result_of

NAME = "Shock Filter Texture"
VERSION = 1

_OPACITY = "{} Opacity"
_COPIED = ("interpolation", "projection", "projection_blend", "extension")
_BESIDE = 320.0
"""How far new nodes are from that of the image."""


def show(
    names: list[str],
    old: bpy.types.Image,
    new: bpy.types.Image,
    mask: bpy.types.Image | None,
    is_inverted: bool,
) -> None:
    """Mix an image with its result in the materials of the objects of these names.

    Nodes that mix it already get the new result, and keep their amount and their mask.

    Parameters
    ----------
    names : list of str
    old, new : bpy.types.Image
    mask : bpy.types.Image or None
        What new nodes take as their mask.
    is_inverted : bool
        Whether the result is seen where the mask is black.
    """
    for node in nodes_of(names, old):
        mix = live_mix(node)
        if mix is None:
            mix = _insert(node)
            if mask is not None:
                link_mask(node, mask, is_inverted)
        result = result_of(mix) or _add_result(node, mix)
        if not _reads(mix.inputs[NEW], result):
            _link(result, mix, NEW)
        result.image = new


def remove(names: list[str], old: bpy.types.Image) -> bool:
    """Take these nodes away again, so that the image is seen; return whether there were any."""
    found = mixed(names, old)
    for node, mix in found:
        tree = node.id_data
        result = result_of(mix)
        for output, own in zip(mix.outputs, node.outputs, strict=True):
            for link in list(output.links):
                tree.links.new(own, link.to_socket)
        masks = [each for each in tree.nodes if each.label == _mask_label(mix)]
        for each in filter(None, (mix, result, *masks)):
            tree.nodes.remove(each)
    return bool(found)


def results(names: list[str], old: bpy.types.Image) -> list[bpy.types.ShaderNodeTexImage]:
    """List the nodes with results of an image, in the materials of the objects of these names."""
    found = [result_of(mix) for _, mix in mixed(names, old)]
    return [node for node in found if node is not None]


def _reads(socket: bpy.types.NodeSocket, node: bpy.types.Node) -> bool:
    # Whether an input depends on a node, through whatever nodes.
    before = [link.from_node for link in socket.links]
    for each in before:
        links = [link for entry in each.inputs for link in entry.links]
        before += [link.from_node for link in links if link.from_node not in before]
    return node in before


def _mask_label(mix: bpy.types.Node) -> str:
    return f"{MASK} of {mix.name}"


def link_mask(
    node: bpy.types.ShaderNodeTexImage, mask: bpy.types.Image, is_inverted: bool = False
) -> None:
    """Let an image say where the result for that of a node is seen."""
    tree, mix = node.id_data, live_mix(node)
    where = _add_image(node, -2.0 * _BESIDE)
    where.image, where.label = mask, _mask_label(mix)
    output = where.outputs["Color"]
    if is_inverted:
        inverse = tree.nodes.new("ShaderNodeInvert")
        inverse.label = where.label
        inverse.location = where.location[0] + _BESIDE, where.location[1]
        tree.links.new(output, inverse.inputs["Color"])
        output = inverse.outputs["Color"]
    tree.links.new(output, mix.inputs[MASK])


def _insert(node: bpy.types.ShaderNodeTexImage) -> bpy.types.Node:
    tree = node.id_data
    mix = tree.nodes.new("ShaderNodeGroup")
    mix.node_tree = _find_or_build()
    mix.location = node.location[0] + _BESIDE, node.location[1]
    for output, own in zip(mix.outputs, node.outputs, strict=True):
        for link in list(own.links):
            tree.links.new(output, link.to_socket)
    _link(node, mix, OLD)
    return mix


def _add_result(
    node: bpy.types.ShaderNodeTexImage, mix: bpy.types.Node
) -> bpy.types.ShaderNodeTexImage:
    result = _add_image(node, -_BESIDE)
    result.label, result[LIVE_RESULT_OF] = NAME, mix.name
    return result


def _link(node: bpy.types.ShaderNodeTexImage, mix: bpy.types.Node, name: str) -> None:
    links = node.id_data.links
    links.new(node.outputs["Color"], mix.inputs[name])
    links.new(node.outputs["Alpha"], mix.inputs[_OPACITY.format(name)])


def _add_image(node: bpy.types.ShaderNodeTexImage, below: float) -> bpy.types.ShaderNodeTexImage:
    # Lies on the surface as the other one.
    tree = node.id_data
    new = tree.nodes.new("ShaderNodeTexImage")
    new.location = node.location[0], node.location[1] + below
    for name in _COPIED:
        setattr(new, name, getattr(node, name))
    for link in node.inputs["Vector"].links:
        tree.links.new(link.from_socket, new.inputs["Vector"])
    return new


def _find_or_build() -> bpy.types.NodeTree:
    for tree in bpy.data.node_groups:
        if tree.library is None and tree.get(LIVE_TEXTURE) == VERSION:
            return tree
    tree = bpy.data.node_groups.new(NAME, "ShaderNodeTree")
    try:
        _build(tree)
    except BaseException:
        bpy.data.node_groups.remove(tree)
        raise
    tree[LIVE_TEXTURE] = VERSION  # only a whole one may be found again
    return tree


def _build(tree: bpy.types.NodeTree) -> None:
    add = tree.interface.new_socket
    for name, kind in (("Color", "NodeSocketColor"), ("Alpha", "NodeSocketFloat")):
        add(name, in_out="OUTPUT", socket_type=kind)
    amount = add(AMOUNT, in_out="INPUT", socket_type="NodeSocketFloat")
    amount.description = "How much of the result is seen: 0 none of it, 1 all, 2 twice as much"
    amount.default_value, amount.min_value, amount.max_value = 1.0, -1.0, 2.0
    mask = add(MASK, in_out="INPUT", socket_type="NodeSocketFloat")
    mask.description = "Where it is seen, 0 to 1"
    mask.default_value, mask.min_value, mask.max_value = 1.0, 0.0, 1.0
    for name in (OLD, NEW):
        add(name, in_out="INPUT", socket_type="NodeSocketColor")
    for name in (OLD, NEW):
        opacity = add(_OPACITY.format(name), in_out="INPUT", socket_type="NodeSocketFloat")
        opacity.default_value = 1.0

    given, end = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    share = tree.nodes.new("ShaderNodeMath")
    share.operation = "MULTIPLY"
    tree.links.new(given.outputs[AMOUNT], share.inputs[0])
    tree.links.new(given.outputs[MASK], share.inputs[1])
    ways = ("RGBA", "{}", "Color"), ("FLOAT", _OPACITY, "Alpha")
    for row, (kind, way, output) in enumerate(ways):
        mix = tree.nodes.new("ShaderNodeMix")
        mix.data_type, mix.clamp_factor = kind, False
        ends = {socket.identifier: socket for socket in (*mix.inputs, *mix.outputs)}
        name = "Color" if kind == "RGBA" else "Float"
        tree.links.new(share.outputs[0], ends["Factor_Float"])
        tree.links.new(given.outputs[way.format(OLD)], ends[f"A_{name}"])
        tree.links.new(given.outputs[way.format(NEW)], ends[f"B_{name}"])
        tree.links.new(ends[f"Result_{name}"], end.inputs[output])
        mix.location = 400.0, -250.0 * row
    share.location, end.location = (200.0, 100.0), (650.0, 0.0)
