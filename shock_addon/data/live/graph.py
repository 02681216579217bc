# SPDX-License-Identifier: GPL-3.0-or-later
"""What the node groups of live results have in common."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import bpy

from .marks import Names

AMOUNT, MASK = "Amount", "Mask"
"""Inputs that all groups have."""


def find_or_add(name: str, key: str, version: Any, build: Callable[[Any], None]) -> Any:
    """Return the file's own group whose `key` is this version; build one if there is none."""
    for tree in bpy.data.node_groups:
        if tree.library is None and tree.get(key) == version:
            return tree
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    tree.is_modifier = True
    try:
        build(tree)
    except BaseException:
        bpy.data.node_groups.remove(tree)
        raise
    tree[key] = version  # only a whole one may be found again
    return tree


def add_amount_and_mask(tree: bpy.types.NodeTree) -> None:
    """Add the inputs that all groups have."""
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


def input_of(tree: bpy.types.NodeTree, name: str) -> str:
    """Return the key under which a modifier keeps an input of the group."""
    return next(
        item.identifier
        for item in tree.interface.items_tree
        if item.item_type == "SOCKET" and item.in_out == "INPUT" and item.name == name
    )


def share(draw: Drawing, given: Any) -> Any:
    """Return a socket with Amount times Mask."""
    clamped = draw.node("ShaderNodeClamp", 2, Value=given.outputs[MASK])
    return draw.math("MULTIPLY", 3, given.outputs[AMOUNT], clamped.outputs[0])


def end(draw: Drawing, fits: Any, mesh: Any, changed: Any, attributes: Sequence[str]) -> None:
    """Output the changed mesh if it fits, without these attributes, so that Apply removes them."""
    result = draw.switch(9, fits, mesh, changed)
    for column, name in enumerate(attributes):
        remove = draw.node("GeometryNodeRemoveAttribute", 10 + column, Geometry=result)
        remove.inputs["Name"].default_value = name
        result = remove.outputs["Geometry"]
    draw.node("NodeGroupOutput", 10 + len(attributes), Geometry=result)


def fitting(draw: Drawing, mesh: Any, names: Names, others: Sequence[Any] = ()) -> Any:
    """Return a socket that is true if the mesh has the connectivity of its marks.

    It decides as `core.host.live.movement.is_fitting` does; none of the other sockets may be true.
    """
    size = draw.node("GeometryNodeAttributeDomainSize", 1, {"component": "MESH"}, Geometry=mesh)
    counts = draw.node("ShaderNodeCombineXYZ", 2)
    for name, domain in (("X", "Point Count"), ("Y", "Edge Count"), ("Z", "Face Count")):
        draw.link(size.outputs[domain], counts.inputs[name])
    sized = draw.node("FunctionNodeCompare", 3, {"data_type": "VECTOR", "mode": "LENGTH"})
    sized.operation = "GREATER_THAN"  # the length of the difference is above 0
    differing = draw.node("ShaderNodeVectorMath", 3, {"operation": "SUBTRACT"})
    draw.link(draw.named(names.counts, "FLOAT_VECTOR", 2), differing.inputs[0])
    draw.link(counts.outputs[0], differing.inputs[1])
    draw.link(differing.outputs[0], socket(sized, "A", "VECTOR"))

    ends = draw.node("GeometryNodeInputMeshEdgeVertices", 1)
    number = draw.named(names.vertices, "INT", 1)
    numbers = []
    for output in ("Vertex Index 1", "Vertex Index 2"):
        at = draw.node("GeometryNodeFieldAtIndex", 2, {"data_type": "INT", "domain": "POINT"})
        draw.link(ends.outputs[output], at.inputs["Index"])
        draw.link(number, socket(at, "Value", "INT"))
        numbers.append(enabled(at.outputs, "Value"))
    total = draw.math("ADD", 3, *numbers)
    cut = draw.node("FunctionNodeCompare", 4, {"data_type": "FLOAT", "operation": "NOT_EQUAL"})
    draw.link(total, socket(cut, "A", "VALUE"))
    draw.link(draw.named(names.edges, "INT", 3), socket(cut, "B", "VALUE"))
    socket(cut, "Epsilon", "VALUE").default_value = 0.0

    wrong = [("POINT", sized.outputs["Result"]), ("EDGE", cut.outputs["Result"])]
    wrong += [("POINT", each) for each in others]
    faults = _imbalance(draw, mesh, names)
    for column, (domain, field) in enumerate(wrong, 5):
        count = draw.node("GeometryNodeAttributeStatistic", 5, {"domain": domain}, Geometry=mesh)
        draw.link(field, socket(count, "Attribute", "VALUE"))
        faults = draw.math("ADD", column, faults, enabled(count.outputs, "Sum"))
    none = draw.node("FunctionNodeCompare", 8, {"data_type": "FLOAT", "operation": "LESS_THAN"})
    draw.link(faults, socket(none, "A", "VALUE"))
    socket(none, "B", "VALUE").default_value = 0.5
    return none.outputs["Result"]


def _imbalance(draw: Drawing, mesh: Any, names: Names) -> Any:
    # A sum of what is stored takes a fraction of the time of a field on faces.
    kind = {"domain": "FACE", "data_type": "FLOAT_VECTOR"}
    total = draw.node("GeometryNodeAttributeStatistic", 4, kind, Geometry=mesh)
    draw.link(draw.named(names.faces, "FLOAT_VECTOR", 3), socket(total, "Attribute", "VECTOR"))
    length = draw.node("ShaderNodeVectorMath", 5, {"operation": "LENGTH"})
    draw.link(enabled(total.outputs, "Sum"), length.inputs[0])
    return length.outputs["Value"]


class Drawing:
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
        return enabled(node.outputs, "Attribute")

    def switch(self, column: int, chosen: Any, false: Any, true: Any) -> Any:
        """Choose between two geometries."""
        node = self.node("GeometryNodeSwitch", column, {"input_type": "GEOMETRY"})
        self.link(chosen, enabled(node.inputs, "Switch"))
        self.link(false, enabled(node.inputs, "False"))
        self.link(true, enabled(node.inputs, "True"))
        return enabled(node.outputs, "Output")


def enabled(sockets: Any, name: str) -> Any:
    # Nodes for several types have a socket for each, of which one is in use.
    return next(each for each in sockets if each.name == name and each.enabled)


def socket(node: Any, name: str, kind: str) -> Any:
    return next(
        each for each in node.inputs if each.name == name and each.type == kind and each.enabled
    )
