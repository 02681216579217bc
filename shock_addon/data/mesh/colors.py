# SPDX-License-Identifier: GPL-3.0-or-later
"""Between a mesh's color attributes and arrays.

Byte colors are read and written as the sRGB values that are stored, float colors as the linear
ones: a value that does not change is stored as the same bits. `core.host.colors` filters light.
"""

from __future__ import annotations

from typing import Any

import bpy

from ....core.host.inputs import ColoredSurface
from ....core.host.recolored import Recolored
from ..arrays import check_same, read_attribute, write_attribute
from ..skipped import Skipped
from . import meshes
from .masks import color_mask
from .targets import MeshTarget, find


def read_colors(obj: bpy.types.Object, mode: str, parameters: Any) -> tuple[str, ColoredSurface]:
    """Read what is sharpened; parameters are those of `color_mask` and `attribute`.

    Raises
    ------
    Skipped
        If there is no such attribute, or nothing of it may change.
    """
    mesh = obj.data
    attribute = find_colors(mesh, parameters.attribute)
    mask, free = color_mask(obj, mode, attribute.domain, parameters)
    surface = ColoredSurface(
        positions=meshes.read_positions(mesh),
        triangles=meshes.read_triangles(mesh),
        mask=mask,
        to_world=meshes.lengths_in_world(obj),
        colors=read_attribute(attribute)[:, :3].copy(),
        corners=meshes.read_triangle_corners(mesh) if attribute.domain == "CORNER" else None,
        free=free,
        levels=255 if attribute.data_type == "BYTE_COLOR" else 0,
    )
    return attribute.name, surface


def write_colors(target: MeshTarget, result: Recolored) -> bpy.types.Object:
    """Write new colors, in Object Mode; opacity stays. Returns the object.

    Raises
    ------
    Skipped
        If the object was removed or its colors have changed since they were read.
    """
    obj = find(target)
    check_unchanged(obj, target)
    attribute = obj.data.color_attributes[target.place]
    values = read_attribute(attribute)
    values[:, :3] = result.colors
    write_attribute(attribute, values)
    obj.data.update()
    return obj


def check_unchanged(obj: bpy.types.Object, target: MeshTarget) -> None:
    """Raise `Skipped` if the colors have changed since they were read."""
    attribute = obj.data.color_attributes.get(target.place)
    reason = "its colors were changed meanwhile; run again"
    if attribute is None:
        raise Skipped(reason)
    check_same(read_attribute(attribute)[:, :3], target.surface.colors, reason)


def find_colors(mesh: bpy.types.Mesh, name: str) -> bpy.types.Attribute:
    """Return a mesh's color attribute of this name, or the active one if it is empty.

    Raises
    ------
    Skipped
        If there is none.
    """
    attributes = mesh.color_attributes
    attribute = attributes.get(name) if name else attributes.active_color
    if attribute is not None:
        return attribute
    if not attributes:
        raise Skipped(
            "it has no color attribute; add one (Object Data > Color Attributes), or paint in"
            " Vertex Paint Mode"
        )
    raise Skipped(
        "it has no color attribute named {name!r}; choose one of: {names}"
        if name
        else "it has no active color attribute; choose one of: {names}",
        name=name,
        names=", ".join(attributes.keys()),
    )
