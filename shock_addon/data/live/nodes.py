# SPDX-License-Identifier: GPL-3.0-or-later
"""The node group *Shock Filter*, which adds a movement to the vertices of a mesh.

It is built of nodes that Blender 4.2 to 5.2 have, so that it works where the extension is missing.
Where the mesh has another connectivity than the movement was computed for, it hands its input on;
it decides as `core.host.live.movement.is_fitting` does.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import bpy

from ....core.host.live.movement import ROUNDING
from .. import LIVE_STAMP, MOVE

NAME = "Shock Filter"
VERSION = 2
"""Of the nodes; a group that is newer or older is left to the objects that have it."""

VERTEX, COUNTS, ENDS, FACES, PLACE, SHARP = (
    ".shock_vertex",
    ".shock_counts",
    ".shock_ends",
    ".shock_faces",
    ".shock_place",
    ".shock_sharp",
)
"""Attributes: marks of the movement (`core.host.live.movement.Marks`), and edges to be sharp."""

ATTRIBUTES = (MOVE, VERTEX, COUNTS, ENDS, FACES, PLACE, SHARP)
"""All of these, with the movement."""

AMOUNT, MASK, MARK_SHARP = "Amount", "Mask", "Mark Sharp"
"""Inputs of the group."""


def find_or_build() -> bpy.types.NodeTree:
    """Return the file's own group of this version, and add it if there is none."""
    for tree in bpy.data.node_groups:
        if tree.library is None and tree.get(LIVE_STAMP) == VERSION:
            return tree
    tree = bpy.data.node_groups.new(NAME, "GeometryNodeTree")
    tree[LIVE_STAMP] = VERSION
    _build(tree)
    return tree


def input_of(tree: bpy.types.NodeTree, name: str) -> str:
    """Return the key under which a modifier keeps an input of the group."""
    return next(
        item.identifier
        for item in tree.interface.items_tree
        if item.item_type == "SOCKET" and item.in_out == "INPUT" and item.name == name
    )


def _build(tree: bpy.types.NodeTree) -> None:
    tree.is_modifier = True
    _add_sockets(tree)
    draw = _Drawing(tree)
    given = draw.node("NodeGroupInput", 0)
    mesh = given.outputs["Geometry"]
    fitting = _fitting(draw, mesh)

    clamped = draw.node("ShaderNodeClamp", 2, Value=given.outputs[MASK])
    share = draw.math("MULTIPLY", 3, given.outputs[AMOUNT], clamped.outputs[0])
    scaled = draw.node("ShaderNodeVectorMath", 4, {"operation": "SCALE"})
    draw.link(draw.named(MOVE, "FLOAT_VECTOR", 3), scaled.inputs["Vector"])
    draw.link(share, scaled.inputs["Scale"])
    moved = draw.node("GeometryNodeSetPosition", 5, Geometry=mesh, Offset=scaled.outputs[0])

    sharp = draw.node("GeometryNodeSetShadeSmooth", 6, {"domain": "EDGE"})
    sharp.inputs["Shade Smooth"].default_value = False
    draw.link(moved.outputs["Geometry"], sharp.inputs["Geometry"])
    draw.link(draw.named(SHARP, "BOOLEAN", 5), sharp.inputs["Selection"])
    marked = draw.switch(7, given.outputs[MARK_SHARP], moved.outputs["Geometry"], sharp.outputs[0])

    result = draw.switch(9, fitting, mesh, marked)
    for column, name in enumerate(ATTRIBUTES):  # applying the modifier leaves nothing behind
        remove = draw.node("GeometryNodeRemoveAttribute", 10 + column, Geometry=result)
        remove.inputs["Name"].default_value = name
        result = remove.outputs["Geometry"]
    draw.node("NodeGroupOutput", 10 + len(ATTRIBUTES), Geometry=result)


def _add_sockets(tree: bpy.types.NodeTree) -> None:
    add = tree.interface.new_socket
    add("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    add("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    amount = add(AMOUNT, in_out="INPUT", socket_type="NodeSocketFloat")
    amount.description = "How much of the result is seen: 0 none of it, 1 all, 2 twice as much"
    amount.default_value, amount.min_value, amount.max_value = 1.0, -1.0, 2.0
    mask = add(MASK, in_out="INPUT", socket_type="NodeSocketFloat")
    mask.description = "Where it is seen: a vertex group or another attribute, 0 to 1"
    mask.default_value, mask.min_value, mask.max_value = 1.0, 0.0, 1.0
    mask.subtype = "FACTOR"
    marks = add(MARK_SHARP, in_out="INPUT", socket_type="NodeSocketBool")
    marks.description = "Mark the edges of creases that were closed as sharp"
    marks.default_value = True


def _fitting(draw: _Drawing, mesh: Any) -> Any:
    """Return a socket that is true if the mesh has the connectivity of the marks."""
    size = draw.node("GeometryNodeAttributeDomainSize", 1, {"component": "MESH"}, Geometry=mesh)
    counts = draw.node("ShaderNodeCombineXYZ", 2)
    for name, domain in (("X", "Point Count"), ("Y", "Edge Count"), ("Z", "Face Count")):
        draw.link(size.outputs[domain], counts.inputs[name])
    others = draw.node("FunctionNodeCompare", 3, {"data_type": "VECTOR", "mode": "LENGTH"})
    others.operation = "GREATER_THAN"  # the length of the difference is above 0
    differing = draw.node("ShaderNodeVectorMath", 3, {"operation": "SUBTRACT"})
    draw.link(draw.named(COUNTS, "FLOAT_VECTOR", 2), differing.inputs[0])
    draw.link(counts.outputs[0], differing.inputs[1])
    draw.link(differing.outputs[0], _socket(others, "A", "VECTOR"))

    ends = draw.node("GeometryNodeInputMeshEdgeVertices", 1)
    number = draw.named(VERTEX, "INT", 1)
    numbers = []
    for output in ("Vertex Index 1", "Vertex Index 2"):
        at = draw.node("GeometryNodeFieldAtIndex", 2, {"data_type": "INT", "domain": "POINT"})
        draw.link(ends.outputs[output], at.inputs["Index"])
        draw.link(number, _socket(at, "Value", "INT"))
        numbers.append(_enabled(at.outputs, "Value"))
    total = draw.math("ADD", 3, *numbers)
    cut = draw.node("FunctionNodeCompare", 4, {"data_type": "FLOAT", "operation": "NOT_EQUAL"})
    draw.link(total, _socket(cut, "A", "VALUE"))
    draw.link(draw.named(ENDS, "INT", 3), _socket(cut, "B", "VALUE"))
    _socket(cut, "Epsilon", "VALUE").default_value = 0.0

    mean = draw.node("GeometryNodeFieldOnDomain", 3, {"data_type": "FLOAT", "domain": "FACE"})
    draw.link(draw.named(VERTEX, "FLOAT", 2), _socket(mean, "Value", "VALUE"))
    other = draw.node("FunctionNodeCompare", 4, {"data_type": "FLOAT", "operation": "NOT_EQUAL"})
    draw.link(_enabled(mean.outputs, "Value"), _socket(other, "A", "VALUE"))
    draw.link(draw.named(FACES, "FLOAT", 3), _socket(other, "B", "VALUE"))
    _socket(other, "Epsilon", "VALUE").default_value = ROUNDING

    sums = []
    for domain, wrong in (("POINT", others), ("EDGE", cut), ("FACE", other)):
        count = draw.node("GeometryNodeAttributeStatistic", 5, {"domain": domain}, Geometry=mesh)
        draw.link(wrong.outputs["Result"], _socket(count, "Attribute", "VALUE"))
        sums.append(_enabled(count.outputs, "Sum"))
    faults = draw.math("ADD", 7, draw.math("ADD", 6, *sums[:2]), sums[2])
    none = draw.node("FunctionNodeCompare", 8, {"data_type": "FLOAT", "operation": "LESS_THAN"})
    draw.link(faults, _socket(none, "A", "VALUE"))
    _socket(none, "B", "VALUE").default_value = 0.5
    return none.outputs["Result"]


class _Drawing:
    """Adds nodes to a tree, in columns from left to right."""

    def __init__(self, tree: bpy.types.NodeTree) -> None:
        self._tree = tree
        self._rows: dict[int, int] = {}
        self.link = tree.links.new

    def node(
        self, kind: str, column: int, values: Mapping[str, Any] | None = None, **linked: Any
    ) -> Any:
        """Add a node with these values, whose inputs are linked to these sockets."""
        node = self._tree.nodes.new(kind)
        row = self._rows[column] = self._rows.get(column, -1) + 1
        node.location = 200.0 * column, -220.0 * row
        for name, value in (values or {}).items():
            setattr(node, name, value)
        for name, socket in linked.items():
            self.link(socket, node.inputs[name])
        return node

    def math(self, operation: str, column: int, one: Any, other: Any) -> Any:
        """Calculate with two numbers."""
        node = self.node("ShaderNodeMath", column, {"operation": operation})
        self.link(one, node.inputs[0])
        self.link(other, node.inputs[1])
        return node.outputs[0]

    def named(self, name: str, data_type: str, column: int) -> Any:
        """Read an attribute."""
        node = self.node("GeometryNodeInputNamedAttribute", column, {"data_type": data_type})
        node.inputs["Name"].default_value = name
        return _enabled(node.outputs, "Attribute")

    def switch(self, column: int, chosen: Any, false: Any, true: Any) -> Any:
        """Choose between two geometries."""
        node = self.node("GeometryNodeSwitch", column, {"input_type": "GEOMETRY"})
        self.link(chosen, _enabled(node.inputs, "Switch"))
        self.link(false, _enabled(node.inputs, "False"))
        self.link(true, _enabled(node.inputs, "True"))
        return _enabled(node.outputs, "Output")


def _enabled(sockets: Any, name: str) -> Any:
    # Nodes for several types have a socket for each, of which one is in use.
    return next(each for each in sockets if each.name == name and each.enabled)


def _socket(node: Any, name: str, kind: str) -> Any:
    return next(
        each for each in node.inputs if each.name == name and each.type == kind and each.enabled
    )
