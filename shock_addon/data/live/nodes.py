# SPDX-License-Identifier: GPL-3.0-or-later
"""The node group *Shock Filter*, which adds a movement to the vertices of a mesh.

It is built of nodes that Blender 4.2 to 5.2 have, so that it works where the extension is missing.
If the mesh has another connectivity than the movement was computed for, it outputs its input.
"""

from __future__ import annotations

import bpy

from .. import LIVE_STAMP, MOVE
from . import graph, marks

NAME = "Shock Filter"
VERSION = 3
"""Version of the nodes; objects with a newer or older group keep it."""

SHARP = ".shock_sharp"
"""The attribute with the edges to be sharp."""

ATTRIBUTES = (MOVE, *marks.SHAPE, SHARP)
"""All attributes of a movement."""

MARK_SHARP = "Mark Sharp"
"""An input of the group, beside Amount and Mask."""


def find_or_build() -> bpy.types.NodeTree:
    """Return the file's own group of this version, and add it if there is none."""
    return graph.find_or_add(NAME, LIVE_STAMP, VERSION, _build)


def _build(tree: bpy.types.NodeTree) -> None:
    graph.add_amount_and_mask(tree)
    sharpens = tree.interface.new_socket(MARK_SHARP, in_out="INPUT", socket_type="NodeSocketBool")
    sharpens.description = "Mark the edges of creases that were closed as sharp"
    sharpens.default_value = True
    draw = graph.Drawing(tree)
    given = draw.node("NodeGroupInput", 0)
    mesh = given.outputs["Geometry"]
    fits = graph.fitting(draw, mesh, marks.SHAPE)

    scaled = draw.node("ShaderNodeVectorMath", 4, {"operation": "SCALE"})
    draw.link(draw.named(MOVE, "FLOAT_VECTOR", 3), scaled.inputs["Vector"])
    draw.link(graph.share(draw, given), scaled.inputs["Scale"])
    moved = draw.node("GeometryNodeSetPosition", 5, Geometry=mesh, Offset=scaled.outputs[0])

    sharp = draw.node("GeometryNodeSetShadeSmooth", 6, {"domain": "EDGE"})
    sharp.inputs["Shade Smooth"].default_value = False
    draw.link(moved.outputs["Geometry"], sharp.inputs["Geometry"])
    draw.link(draw.named(SHARP, "BOOLEAN", 5), sharp.inputs["Selection"])
    marked = draw.switch(7, given.outputs[MARK_SHARP], moved.outputs["Geometry"], sharp.outputs[0])
    graph.end(draw, fits, mesh, marked, ATTRIBUTES)
