# SPDX-License-Identifier: GPL-3.0-or-later
"""The difference of colors of a live result, as attributes of its mesh."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import bpy
import numpy as np
import numpy.typing as npt

from ....core.host.live.movement import digests, is_fitting, marks_of, movement
from .. import DIFFERENCE, LIVE_COLORS, arrays
from ..mesh import colors, meshes
from ..mesh.targets import MeshTarget, find
from . import color_nodes, marks, recipes, stacks
from .movement import FRESH, MOVED, NONE, STALE

_LINEAR = "shock_linear"


def write(target: MeshTarget, result: Any) -> bpy.types.Object:
    """Write new colors as a difference, and put the modifier on all objects that show the mesh.

    Parameters
    ----------
    target : MeshTarget
        As `colors.read_colors` read it.
    result : Recolored

    Raises
    ------
    Skipped
        If the object was removed or its colors have changed since they were read.
    """
    obj = find(target)
    mesh = obj.data
    users = stacks.takers(obj)
    colors.check_unchanged(obj, target)
    attribute = mesh.color_attributes[target.place]
    data_type, domain = attribute.data_type, attribute.domain
    values = arrays.read_attribute(attribute)
    old = arrays.read(attribute.data, "color", 4)[:, :3]
    new = values.copy()
    new[:, :3] = result.colors
    difference = movement(old, _in_linear_light(mesh, data_type, domain, new))
    place = arrays.find_or_add_attribute(mesh, DIFFERENCE, "FLOAT_VECTOR", domain)
    arrays.write_attribute(place, difference)
    found = marks_of(meshes.read_positions(mesh), marks.connectivity(mesh))
    marks.write(mesh, marks.COLORS, replace(found, places=digests(values)), domain)
    mesh.update()
    for user in users:
        add(user, target.place)
    return obj


def add(obj: bpy.types.Object, name: str) -> None:
    """Put the modifier for a color attribute on an object; one that is there keeps its inputs."""
    attribute = obj.data.color_attributes[name]
    tree = color_nodes.find_or_build(attribute.data_type, attribute.domain)
    modifier = stacks.add(obj, tree, LIVE_COLORS)
    modifier.node_group = tree
    stacks.write_input(modifier, color_nodes.ATTRIBUTE, name)


def remove(mesh: bpy.types.Mesh) -> bool:
    """Remove the difference of colors of a mesh; return whether there was one."""
    was_live = DIFFERENCE in mesh.attributes and LIVE_COLORS in mesh
    if was_live:
        marks.remove(mesh, color_nodes.ATTRIBUTES)
        del mesh[LIVE_COLORS]
    return was_live


def state(obj: bpy.types.Object) -> str:
    """Return what the difference of colors of an object is to its mesh; see `movement`."""
    mesh = obj.data
    noted = recipes.noted(mesh, LIVE_COLORS)
    difference = mesh.attributes.get(DIFFERENCE)
    if noted is None or difference is None:
        return NONE
    attribute = mesh.color_attributes.get(noted[1].get("attribute", ""))
    found = marks.read(mesh, marks.COLORS, difference.domain)
    if found is None or attribute is None or not is_fitting(found, marks.connectivity(mesh)):
        return STALE
    if attribute.domain != difference.domain:
        return MOVED
    same = digests(arrays.read_attribute(attribute)) == found.places
    return FRESH if same.all() else MOVED


def _in_linear_light(
    mesh: bpy.types.Mesh, data_type: str, domain: str, values: npt.NDArray
) -> npt.NDArray[np.float32]:
    # As Blender converts them: byte colors are rounded.
    if data_type != "BYTE_COLOR":
        return values[:, :3].astype(np.float32)
    place = mesh.attributes.new(_LINEAR, data_type, domain)
    name = place.name
    arrays.write_attribute(place, values)
    linear = arrays.read(place.data, "color", 4)[:, :3]
    mesh.attributes.remove(mesh.attributes[name])
    return linear
