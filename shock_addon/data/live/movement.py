# SPDX-License-Identifier: GPL-3.0-or-later
"""The movement of a live result, as attributes of its mesh."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy
import numpy as np
import numpy.typing as npt

from ....core.host.live.movement import (
    Connectivity,
    Marks,
    digests,
    is_fitting,
    marks_of,
    movement,
)
from .. import LIVE_STAMP, MOVE, arrays
from ..mesh import colors, geometry, meshes, painted, shading
from ..mesh.targets import MeshTarget, find
from ..skipped import Skipped
from . import nodes, stacks

if TYPE_CHECKING:
    from ....core.host.geometry import Reshaped

FRESH, MOVED, STALE, NONE = "fresh", "moved", "stale", ""
"""What a movement is to its mesh: computed for it as it is, before vertices moved, or for another
connectivity, so that it is not applied; or there is none."""

_KINDS = {
    nodes.VERTEX: ("INT", "POINT"),
    nodes.COUNTS: ("FLOAT_VECTOR", "POINT"),
    nodes.ENDS: ("INT", "EDGE"),
    nodes.FACES: ("FLOAT", "FACE"),
    nodes.PLACE: ("INT", "POINT"),
}
_SHARP = "BOOLEAN", "EDGE"


def write(target: MeshTarget, result: Any) -> bpy.types.Object:
    """Write a result as a movement, and put the modifier on all objects that show the mesh.

    Parameters
    ----------
    target : MeshTarget
        As `geometry.read_geometry` or `painted.read_painted` read it.
    result : object
        Of the filter; colors are written as they are.

    Raises
    ------
    Skipped
        If the object was removed or its shape has changed since it was read.
    """
    if isinstance(target.place, tuple):
        shape, paint = painted.split(target)
        colors.check_unchanged(find(target), paint)
        write(shape, result.shape)
        return colors.write_colors(paint, result.paint)
    obj = find(target)
    stacks.check(obj)
    old = target.surface.positions
    arrays.check_same(geometry.source(obj, target.place), old)
    _write_attributes(obj.data, old, result.positions)
    _write_sharp(obj, target, result)
    obj.data.update()
    for user in stacks.users_of(obj.data):
        try:
            stacks.check(user)
        except Skipped:
            if user == obj:
                raise
            continue  # it shows the mesh as it was
        stacks.add(user, target.place.sharp_angle is not None)
    return obj


def remove(mesh: bpy.types.Mesh) -> bool:
    """Remove the movement of a mesh; return whether there was one."""
    was_live = MOVE in mesh.attributes and nodes.VERTEX in mesh.attributes
    if was_live:
        for name in nodes.ATTRIBUTES:
            if name in mesh.attributes:
                mesh.attributes.remove(mesh.attributes[name])
        mesh.update()
    if LIVE_STAMP in mesh:
        del mesh[LIVE_STAMP]
    return was_live


def state(obj: bpy.types.Object) -> str:
    """Return what the movement of an object that is not in Edit Mode is to its mesh."""
    mesh = obj.data
    marks = _read_marks(mesh)
    if marks is None:
        return NONE if MOVE not in mesh.attributes else STALE
    if not is_fitting(marks, connectivity(mesh)):
        return STALE
    try:
        positions = geometry.source(obj, geometry.Place("LIVE", obj.mode, "KEEP", None))
    except Skipped:
        return MOVED
    return FRESH if (digests(positions) == marks.places).all() else MOVED


def connectivity(mesh: bpy.types.Mesh) -> Connectivity:
    """Read what is connected in a mesh."""
    if len(mesh.loops) == 3 * len(mesh.polygons):
        starts = np.arange(0, len(mesh.loops), 3, dtype=np.int32)
    else:
        starts = arrays.read(mesh.polygons, "loop_start", dtype=np.int32)
    ends = arrays.read_attribute(mesh.attributes[".edge_verts"])
    return Connectivity(ends, meshes.read_corner_vertices(mesh), starts)


def _write_attributes(
    mesh: bpy.types.Mesh, old: npt.NDArray[np.float32], new: npt.NDArray[np.float32]
) -> None:
    marks = marks_of(old, connectivity(mesh))
    values = (marks.vertices, marks.counts, marks.edges, marks.faces, marks.places)
    _write(mesh, MOVE, ("FLOAT_VECTOR", "POINT"), movement(old, new))
    for (name, kind), each in zip(_KINDS.items(), values, strict=True):
        _write(mesh, name, kind, each)


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


def _read_marks(mesh: bpy.types.Mesh) -> Marks | None:
    found = [arrays.find_attribute(mesh, name, *kind) for name, kind in _KINDS.items()]
    move = arrays.find_attribute(mesh, MOVE, "FLOAT_VECTOR", "POINT")
    if move is None or any(each is None for each in found):
        return None
    return Marks(*map(arrays.read_attribute, found))
