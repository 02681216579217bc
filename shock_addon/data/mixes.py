# SPDX-License-Identifier: GPL-3.0-or-later
"""The nodes of live textures in materials: what mixes images with their results; nothing is read.

See `image.mixing`, which makes them.
"""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from . import LIVE_RESULT_OF
from .materials import active_image, image_nodes, is_live_result, live_mix, materials_of
from .skipped import Skipped

AMOUNT, OLD, NEW = "Amount", "Old", "New"
"""Inputs of what mixes, beside `materials.MASK` and the opacities."""


def mixed(
    names: list[str], old: bpy.types.Image | None = None
) -> list[tuple[bpy.types.ShaderNodeTexImage, bpy.types.Node]]:
    """List the nodes of an image, or of any, that are mixed with results, each with what mixes it.

    In this file's materials of the objects of these names.
    """
    found = [(node, live_mix(node)) for node in nodes_of(names, old)]
    return [(node, mix) for node, mix in found if mix is not None]


def first_mixed(
    obj: bpy.types.Object,
) -> tuple[bpy.types.ShaderNodeTexImage, bpy.types.Node] | None:
    """Return the pair of `mixed` that an object shows first; None if it has no live texture.

    It is that of the texture that is worked on in the active material, or else of any.
    """
    pairs = mixed([obj.name])
    try:
        image = None if obj.active_material is None else active_image(obj.active_material)
    except Skipped:  # it has several
        image = None
    shown = [pair for pair in pairs if pair[0].image == image]
    return next(iter(shown + pairs), None)


def nodes_of(
    names: list[str], old: bpy.types.Image | None
) -> Iterator[bpy.types.ShaderNodeTexImage]:
    """Find the nodes with an image, or any, in this file's materials of the objects of these names.

    Without those with results of a run on its result.
    """
    for material in materials_of(names):
        for node in image_nodes(material):
            is_own = node.id_data.library is None and material.library is None
            is_meant = node.image is not None and old in (None, node.image)
            if is_meant and is_own and not is_live_result(node):
                yield node


def result_of(mix: bpy.types.Node) -> bpy.types.ShaderNodeTexImage | None:
    """Return the node with the result that a node mixes in; None if it was removed.

    Others may be linked where it was; of copies, that which is linked is meant.
    """
    linked = [link.from_node for link in mix.inputs[NEW].links]
    marked = [each for each in mix.id_data.nodes if each.get(LIVE_RESULT_OF) == mix.name]
    own = [each for each in linked if LIVE_RESULT_OF in each]
    return next((each for each in (*own, *marked) if each.type == "TEX_IMAGE"), None)


def is_result(image: bpy.types.Image) -> bool:
    """Whether any material of this file mixes an image in."""
    nodes = (node for material in bpy.data.materials for node in image_nodes(material))
    return any(node.image == image and is_live_result(node) for node in nodes)
