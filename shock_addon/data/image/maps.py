# SPDX-License-Identifier: GPL-3.0-or-later
"""The maps of a material that belong together: base color, roughness, metallic, normals, height."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import bpy

from ..chosen import mesh_users
from ..materials import colors_surface, image_nodes, is_beside, live_mix
from ..skipped import Skipped, sentences

_ON_THE_WAY = {"REROUTE", "SEPARATE_COLOR", "COMBINE_COLOR", "CURVE_RGB", "INVERT", "GAMMA"}
"""Kinds of nodes that may lie between an image and a Normal Map node."""


class Maps(NamedTuple):
    """Images that are filtered together.

    Attributes
    ----------
    lead : bpy.types.Image
        The image whose flow moves all of them.
    followers : dict
        The content of each other image: "values", or as `normals_from` returns it.
    left : list of str
        A sentence for each image that is left out.
    """

    lead: bpy.types.Image
    followers: dict[bpy.types.Image, str]
    left: list[str]


def maps_of(context: bpy.types.Context, image: bpy.types.Image) -> Maps:
    """Find the other maps in the materials of the chosen objects that show an image.

    The image of the base color leads if there is one, otherwise the given image.
    """
    slots = [slot.material for obj in mesh_users(context) for slot in obj.material_slots]
    materials = [
        material
        for material in filter(None, dict.fromkeys(slots))
        if any(node.image == image for node in image_nodes(material))
    ]
    colors = {node.image for each in materials for node in colors_surface(each.node_tree)}
    lead = colors.pop() if len(colors) == 1 else image
    nodes = [
        node
        for each in materials
        for node in image_nodes(each)
        if node.image is not None and not is_beside(node)
    ]
    places = {coordinates_of(node) for node in nodes if node.image == lead}
    followers: dict[bpy.types.Image, str] = {}
    left: dict[str, str] = {}
    for node in nodes:
        if node.image == lead:
            continue
        try:
            _check(node, lead, places)
        except Skipped as reason:
            left[node.image.name] = str(reason)
            continue
        known = followers.get(node.image, "values")
        followers[node.image] = normals_from(node) or known
    for name in left:
        followers.pop(bpy.data.images[name], None)
    return Maps(lead, followers, sentences(list(left.items())))


def _check(
    node: bpy.types.ShaderNodeTexImage, lead: bpy.types.Image, places: set[tuple[str, ...]]
) -> None:
    image = node.image
    if coordinates_of(node) not in places:
        raise Skipped("it is mapped to the surface in another way than {lead}", lead=lead.name)
    if image.source != lead.source and "TILED" in {image.source, lead.source}:
        raise Skipped("only one of it and {lead} has UDIM tiles", lead=lead.name)
    if image.source == "TILED":
        sizes = [{t.number: tuple(t.size) for t in each.tiles} for each in (image, lead)]
        if sizes[0] != sizes[1]:
            raise Skipped("its tiles differ from those of {lead}", lead=lead.name)


def coordinates_of(
    node: bpy.types.ShaderNodeTexImage, passed: Collection[str] = ("REROUTE",)
) -> tuple[str, ...]:
    """Return a key for the source of a node's coordinates, equal for the same UV map.

    Nodes of the types `passed` are looked through.
    """
    socket = node.inputs["Vector"]
    while socket.is_linked:
        source, output = socket.links[0].from_node, socket.links[0].from_socket
        if source.type in passed:
            socket = source.inputs[0]
        elif source.type == "UVMAP":
            return "UV", source.uv_map
        elif source.type == "TEX_COORD" and output.name == "UV":
            break
        else:
            return source.id_data.name, source.name, output.identifier
    return "UV", ""


def as_held(kind: str, chosen: str) -> str:
    """Return the content of a map.

    Parameters
    ----------
    kind : str
        As `normals_from` returns it, or "values".
    chosen : str
        The choice in the panel, for kinds of normals that materials cannot tell apart.
    """
    return chosen if kind == "normals" and chosen == "normals_y_down" else kind


def normals_in(context: bpy.types.Context, image: bpy.types.Image) -> str:
    """Return the kind of normals in an image, as the chosen objects' materials use it."""
    slots = [slot.material for obj in mesh_users(context) for slot in obj.material_slots]
    nodes = [node for each in filter(None, dict.fromkeys(slots)) for node in image_nodes(each)]
    found = [normals_from(node) for node in nodes if node.image == image]
    return found[0] if found and len(set(found)) == 1 else ""


def normals_from(node: bpy.types.ShaderNodeTexImage) -> str:
    """Return the kind of normals that a Normal Map node reads; empty if there is no such node."""
    ahead = [link.to_node for link in node.outputs["Color"].links]
    for each in ahead:
        if each.type == "NORMAL_MAP" and each.space != "TANGENT":
            return "object_normals"
        if each.type == "NORMAL_MAP":
            is_down = getattr(each, "convention", "OPENGL") == "DIRECTX"
            return "normals_y_down" if is_down else "normals"
        if each.type in _ON_THE_WAY or each == live_mix(node):
            links = [link for output in each.outputs for link in output.links]
            ahead += [link.to_node for link in links if link.to_node not in ahead]
    return ""
