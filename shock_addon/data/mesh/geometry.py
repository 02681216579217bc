# SPDX-License-Identifier: GPL-3.0-or-later
"""Between a mesh object's shape and arrays: the mesh itself or its shape keys."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np
import numpy.typing as npt

from ....core.host.inputs import MirroredSurface, MirrorPlane
from ..arrays import check_same
from ..skipped import Skipped
from . import meshes, shading, shape_keys
from .masks import color_mask
from .targets import MeshTarget, find

if TYPE_CHECKING:
    from ....core.host.geometry import Reshaped


@dataclass(frozen=True)
class Place:
    """Where a new shape is written, and what is recomputed afterwards.

    Attributes
    ----------
    output : str
        "MESH", "SHAPE_KEY", "LIVE" or "OBJECT"; the last one, and "AUTO", are written as a mesh,
        and "LIVE" by `data.live`.
    mode : str
        The mode that the person works in.
    custom_normals : str
        "KEEP", "RECOMPUTE" or "CLEAR".
    sharp_angle : float or None
        Edges whose faces meet at more than this become sharp, after sharpening those of creases;
        None marks none. Not where the shape is a key's, or custom normals are kept.
    """

    output: str
    mode: str
    custom_normals: str
    sharp_angle: float | None


def read_geometry(
    obj: bpy.types.Object, mode: str, parameters: Any
) -> tuple[Place, MirroredSurface]:
    """Read what is sharpened.

    Parameters
    ----------
    obj, mode
        As in `color_mask`.
    parameters : object
        As there, and has `output`, `custom_normals`, `mark_sharp` and `sharp_angle`.

    Raises
    ------
    Skipped
        If the shape cannot be changed, or nothing of it may change.
    """
    mesh = obj.data
    _check_multires(obj, mode)
    place = Place(
        output=parameters.output,
        mode=mode,
        custom_normals=parameters.custom_normals,
        sharp_angle=parameters.sharp_angle if parameters.mark_sharp else None,
    )
    positions, triangles = source(obj, place), meshes.read_triangles(mesh)
    surface = MirroredSurface(
        positions=positions,
        triangles=triangles,
        mask=color_mask(obj, mode, "POINT", parameters)[0],
        to_world=meshes.lengths_of_shape(obj, positions, triangles),
        mirror=(mesh.use_mirror_x, mesh.use_mirror_y, mesh.use_mirror_z),
        planes=tuple(_mirror_planes(obj)),
        sharp_angle=None if place.sharp_angle is None else math.degrees(place.sharp_angle),
        edges=meshes.read_edges(mesh),
    )
    return place, surface


def write_geometry(
    target: MeshTarget, result: Reshaped, key_name: str = "Sharpened"
) -> bpy.types.Object:
    """Write new positions, in Object Mode; returns the object.

    Parameters
    ----------
    target : MeshTarget
    result : Reshaped
    key_name : str
        What a new shape key is called.

    Raises
    ------
    Skipped
        If the object was removed or its shape has changed since it was read.
    """
    obj = find(target)
    place, old, mask = target.place, target.surface.positions, target.surface.mask
    check_same(source(obj, place), old)
    if place.output == "SHAPE_KEY":
        if (result.positions != old).any():  # else it would be of no use
            shape_keys.add(obj, key_name, old, result.positions, place.mode)
    elif obj.data.shape_keys is None:
        meshes.write_positions(obj.data, result.positions)
    else:
        shape_keys.write_active(obj, result.positions)
        meshes.write_positions(obj.data, shape_keys.read(obj.data.shape_keys.reference_key))
    if place.sharp_angle is not None and _may_mark(obj, place):
        shading.mark(obj.data, shading.edges_to_mark(obj.data, result, mask, place.sharp_angle))
    obj.data.update()
    shading.renew_normals(obj, place.custom_normals, mask)
    return obj


def _may_mark(obj: bpy.types.Object, place: Place) -> bool:
    # Marks belong to the whole mesh, whatever its shape keys; and custom normals lie in fans
    # between marks, so that they would turn.
    if place.output == "SHAPE_KEY":
        return False
    if obj.data.has_custom_normals and place.custom_normals == "KEEP":
        return False
    keys = obj.data.shape_keys
    return keys is None or shape_keys.active_key(obj) == keys.reference_key


def source(obj: bpy.types.Object, place: Place) -> npt.NDArray[np.float32]:
    """Return the shape that is filtered: (n, 3).

    Raises
    ------
    Skipped
        If the shape keys do not allow it.
    """
    if obj.data.shape_keys is None:
        return meshes.read_positions(obj.data)
    if place.output in {"SHAPE_KEY", "LIVE"}:
        return shape_keys.visible_shape(obj, place.mode)
    return shape_keys.read(shape_keys.active_key(obj))


def _check_multires(obj: bpy.types.Object, mode: str) -> None:
    sculpted = any(each.type == "MULTIRES" and each.sculpt_levels for each in obj.modifiers)
    if mode == "SCULPT" and sculpted:
        raise Skipped(
            "the details of its Multiresolution modifier cannot be filtered; apply the modifier,"
            " or go to Object Mode to filter the mesh below it"
        )


def _mirror_planes(obj: bpy.types.Object) -> list[MirrorPlane]:
    """List the planes at which Mirror modifiers join the mesh with its image."""
    planes = []
    for modifier in obj.modifiers:
        if modifier.type != "MIRROR" or not (modifier.show_viewport and modifier.use_mirror_merge):
            continue
        matrix = np.identity(4)
        if modifier.mirror_object is not None:
            to_mirror = modifier.mirror_object.matrix_world.inverted_safe()
            matrix = np.array(to_mirror @ obj.matrix_world)
        for axis in np.flatnonzero(modifier.use_axis):
            across = np.linalg.norm(np.linalg.inv(matrix[:3, :3])[:, axis])
            planes.append(
                MirrorPlane(
                    normal=matrix[axis, :3],
                    offset=float(matrix[axis, 3]),
                    reach=0.5 * modifier.merge_threshold / float(across),
                )
            )
    return planes
