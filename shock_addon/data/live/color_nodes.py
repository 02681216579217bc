# SPDX-License-Identifier: GPL-3.0-or-later
"""The node group *Shock Filter Colors*, which adds a difference to a color attribute.

It works like `nodes` for movements. There is one for each kind of color attribute, since a node
that stores an attribute has its type and its domain fixed. Opacity does not change.
"""

from __future__ import annotations

from functools import partial

import bpy

from .. import DIFFERENCE, LIVE_COLORS
from . import graph, marks

NAME = "Shock Filter Colors"
VERSION = 2

ATTRIBUTES = (DIFFERENCE, *marks.COLORS)
"""All attributes of a difference of colors."""

ATTRIBUTE = "Attribute"
"""An input of the group, beside Amount and Mask: the name of the color attribute."""


def find_or_build(data_type: str, domain: str) -> bpy.types.NodeTree:
    """Return the file's own group for this kind of color attribute; add it if there is none."""
    build = partial(_build, data_type, domain)
    return graph.find_or_add(NAME, LIVE_COLORS, f"{VERSION} {data_type} {domain}", build)


def _build(data_type: str, domain: str, tree: bpy.types.NodeTree) -> None:
    graph.add_amount_and_mask(tree)
    name = tree.interface.new_socket(ATTRIBUTE, in_out="INPUT", socket_type="NodeSocketString")
    name.description = "The color attribute"
    draw = graph.Drawing(tree)
    given = draw.node("NodeGroupInput", 0)
    mesh = given.outputs["Geometry"]
    old = draw.node("GeometryNodeInputNamedAttribute", 3, {"data_type": "FLOAT_COLOR"})
    draw.link(given.outputs[ATTRIBUTE], old.inputs["Name"])
    missing = draw.node("FunctionNodeBooleanMath", 4, {"operation": "NOT"})
    draw.link(old.outputs["Exists"], missing.inputs[0])
    fits = graph.fitting(draw, mesh, marks.COLORS, [missing.outputs[0]])

    before = graph.enabled(old.outputs, "Attribute")
    scaled = draw.node("ShaderNodeVectorMath", 4, {"operation": "SCALE"})
    draw.link(draw.named(DIFFERENCE, "FLOAT_VECTOR", 3), scaled.inputs["Vector"])
    draw.link(graph.share(draw, given), scaled.inputs["Scale"])
    added = draw.node("ShaderNodeVectorMath", 5, {"operation": "ADD"})
    draw.link(before, added.inputs[0])
    draw.link(scaled.outputs[0], added.inputs[1])
    light = draw.node("ShaderNodeSeparateXYZ", 6, Vector=added.outputs[0])
    opacity = draw.node("FunctionNodeSeparateColor", 6, Color=before)
    color = draw.node("FunctionNodeCombineColor", 7, Alpha=opacity.outputs["Alpha"])
    for channel, part in (("Red", "X"), ("Green", "Y"), ("Blue", "Z")):
        draw.link(light.outputs[part], color.inputs[channel])
    kind = {"data_type": data_type, "domain": domain}
    store = draw.node("GeometryNodeStoreNamedAttribute", 8, kind, Geometry=mesh)
    draw.link(given.outputs[ATTRIBUTE], store.inputs["Name"])
    draw.link(color.outputs["Color"], graph.enabled(store.inputs, "Value"))
    graph.end(draw, fits, mesh, store.outputs["Geometry"], ATTRIBUTES)
