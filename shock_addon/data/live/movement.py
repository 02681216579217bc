# SPDX-License-Identifier: GPL-3.0-or-later
"""The movement of a live result, as attributes of its mesh."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
import numpy as np
import numpy.typing as npt

from ....core.host.live.movement import digests, is_fitting, marks_of, movement
from .. import LIVE_STAMP, MOVE, arrays
from ..chosen import live_modifier
from ..mesh import geometry, shading
from ..mesh.targets import MeshTarget, find
from ..skipped import Skipped
from . import marks, nodes, stacks

if TYPE_CHECKING:
    from ....core.host.geometry import Reshaped

FRESH, MOVED, STALE, NONE = "fresh", "moved", "stale", ""
"""State of a movement: computed for the current mesh, computed before vertices moved, computed for
another connectivity and so not applied, or missing."""

_SHARP = "BOOLEAN", "EDGE"


def write(target: MeshTarget, result: Reshaped) -> bpy.types.Object:
    """Write a result as a movement, and put the modifier on all objects that show the mesh.

    Parameters
    ----------
    target : MeshTarget
        As `geometry.read_geometry` read it.
    result : Reshaped

    Raises
    ------
    Skipped
        If the object was removed or its shape has changed since it was read.
    """
    obj = find(target)
    users = stacks.takers(obj)
    old = target.surface.positions
    arrays.check_same(geometry.source(obj, target.place), old)
    _write_attributes(obj.data, old, result.positions)
    _write_sharp(obj, target, result)
    obj.data.update()
    for user in users:
        add(user, target.place.sharp_angle is not None)
    return obj


def add(obj: bpy.types.Object, mark_sharp: bool) -> None:
    """Put the modifier on an object; one that is there keeps its place and its inputs."""
    if live_modifier(obj) is None:
        modifier = stacks.add(obj, nodes.find_or_build(), LIVE_STAMP)
        stacks.write_input(modifier, nodes.MARK_SHARP, mark_sharp)


def remove(mesh: bpy.types.Mesh) -> bool:
    """Remove the movement of a mesh; return whether there was one."""
    was_live = MOVE in mesh.attributes and marks.SHAPE.vertices in mesh.attributes
    if was_live:
        marks.remove(mesh, nodes.ATTRIBUTES)
    if LIVE_STAMP in mesh:
        del mesh[LIVE_STAMP]
    return was_live


def state(obj: bpy.types.Object) -> str:
    """Return the state of the movement of an object that is not in Edit Mode."""
    mesh = obj.data
    if arrays.find_attribute(mesh, MOVE, "FLOAT_VECTOR", "POINT") is None:
        return NONE if MOVE not in mesh.attributes else STALE
    found = marks.read(mesh, marks.SHAPE)
    if found is None or not is_fitting(found, marks.connectivity(mesh)):
        return STALE
    try:
        positions = geometry.source(obj, geometry.Place("LIVE", obj.mode, "KEEP", None))
    except Skipped:
        return MOVED
    return FRESH if (digests(positions) == found.places).all() else MOVED


def _write_attributes(
    mesh: bpy.types.Mesh, old: npt.NDArray[np.float32], new: npt.NDArray[np.float32]
) -> None:
    _write(mesh, MOVE, ("FLOAT_VECTOR", "POINT"), movement(old, new))
    marks.write(mesh, marks.SHAPE, marks_of(old, marks.connectivity(mesh)))


def _write_sharp(obj: bpy.types.Object, target: MeshTarget, result: Reshaped) -> None:
    """Write which edges become sharp; without any, the attribute is left out."""
    mesh, place = obj.data, target.place
    edges = np.zeros(len(mesh.edges), dtype=bool)
    if place.sharp_angle is not None and not mesh.has_custom_normals:  # which would turn
        edges = shading.edges_to_mark(mesh, result, target.surface.mask, place.sharp_angle)
    if edges.any():
        _write(mesh, nodes.SHARP, _SHARP, edges)
    elif nodes.SHARP in mesh.attributes:
        mesh.attributes.remove(mesh.attributes[nodes.SHARP])


def _write(mesh: bpy.types.Mesh, name: str, kind: tuple[str, str], values: npt.NDArray) -> None:
    arrays.write_attribute(arrays.find_or_add_attribute(mesh, name, *kind), values)
