# SPDX-License-Identifier: GPL-3.0-or-later
"""Between Blender's mesh objects and arrays: what to sharpen, and writing it back."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
import numpy.typing as npt

from . import shape_keys
from .masks import vertex_mask
from .sharpening import Surface
from .skipped import Skipped

_SINGULAR = 1e-6
_UNIFORM = 1e-5


@dataclass(frozen=True)
class Target:
    """A mesh object as it was read, to find it again when the result is there."""

    name: str
    object_uid: int
    mesh_uid: int
    output: str
    surface: Surface


def mesh_objects(context: bpy.types.Context) -> list[bpy.types.Object]:
    """List the mesh objects that an operator acts on; the active one comes first."""
    if context.mode == "OBJECT":
        objects = list(context.selected_objects)
    elif context.mode == "EDIT_MESH":
        objects = list(context.objects_in_mode)
    else:
        objects = [context.object]
    meshes = [obj for obj in objects if obj is not None and obj.type == "MESH"]
    return sorted(meshes, key=lambda obj: obj != context.object)


@contextmanager
def object_mode(context: bpy.types.Context) -> Iterator[None]:
    """Leave the current mode, since mesh data is complete in Object Mode only; then re-enter it."""
    mode = context.object.mode if context.object is not None else "OBJECT"
    if mode == "OBJECT":
        yield
        return
    bpy.ops.object.mode_set(mode="OBJECT")
    try:
        yield
    finally:
        bpy.ops.object.mode_set(mode=mode)


def read_targets(context: bpy.types.Context, parameters: Any) -> tuple[list[Target], list[str]]:
    """Read all objects that the operator acts on, each mesh once.

    Parameters
    ----------
    context : bpy.types.Context
    parameters : object
        Has `vertex_group`, `invert_mask`, `selected_only` and `output`.

    Returns
    -------
    targets : list of Target
    skipped : list of str
        A sentence for each object that was left alone.
    """
    mode = context.mode
    users: dict[int, bpy.types.Object] = {}
    for obj in mesh_objects(context):
        users.setdefault(obj.data.session_uid, obj)
    targets, skipped = [], []
    with object_mode(context):
        for obj in users.values():
            try:
                targets.append(_read(obj, mode, parameters))
            except Skipped as reason:
                skipped.append(f"Skipped {obj.name}: {reason}.")
    return targets, skipped


def write_target(target: Target, positions: npt.NDArray[np.float32]) -> bpy.types.Object:
    """Write new positions, in Object Mode; returns the object.

    Raises
    ------
    Skipped
        If the object was removed or its shape has changed since it was read.
    """
    obj = next((o for o in bpy.data.objects if o.session_uid == target.object_uid), None)
    if obj is None or obj.data is None or obj.data.session_uid != target.mesh_uid:
        raise Skipped("it was removed meanwhile")
    old = target.surface.positions
    if not np.array_equal(_source(obj, target.output), old):
        raise Skipped("it was changed meanwhile; run again")
    if target.output == "SHAPE_KEY":
        shape_keys.add(obj, positions - old)
    elif obj.data.shape_keys is None:
        write_positions(obj.data, positions)
    else:
        shape_keys.write_active(obj, positions)
        write_positions(obj.data, shape_keys.read(obj.data.shape_keys.reference_key))
    obj.data.update()
    return obj


def read_positions(mesh: bpy.types.Mesh) -> npt.NDArray[np.float32]:
    """Read vertex positions: (n, 3)."""
    flat = np.empty(3 * len(mesh.vertices), dtype=np.float32)
    mesh.attributes["position"].data.foreach_get("vector", flat)
    return flat.reshape(-1, 3)


def write_positions(mesh: bpy.types.Mesh, positions: npt.NDArray[np.float32]) -> None:
    """Write vertex positions; call ``mesh.update()`` afterwards."""
    flat = np.ascontiguousarray(positions, dtype=np.float32).reshape(-1)
    mesh.attributes["position"].data.foreach_set("vector", flat)


def read_triangles(mesh: bpy.types.Mesh) -> npt.NDArray[np.int32]:
    """Read the triangles that Blender cuts the faces into, as vertex indices: (m, 3)."""
    vertices = np.empty(len(mesh.loops), dtype=np.int32)
    mesh.attributes[".corner_vert"].data.foreach_get("value", vertices)
    mesh.calc_loop_triangles()
    if len(mesh.loop_triangles) == len(mesh.polygons):  # triangles already: 100 times faster
        return vertices.reshape(-1, 3)
    corners = np.empty(3 * len(mesh.loop_triangles), dtype=np.int32)
    mesh.loop_triangles.foreach_get("loops", corners)
    return vertices[corners].reshape(-1, 3)


def _read(obj: bpy.types.Object, mode: str, parameters: Any) -> Target:
    mesh = obj.data
    if mesh.library is not None or mesh.override_library is not None:
        raise Skipped(
            "its mesh is linked from another file; make it local first"
            " (Object > Relations > Make Local)"
        )
    if obj.mode != "OBJECT":
        raise Skipped(f"it is in {_label_of_mode(obj.mode)}; switch it to Object Mode first")
    if not mesh.polygons:
        raise Skipped("it has no faces; add some, or select another object")
    surface = Surface(
        positions=_source(obj, parameters.output),
        triangles=read_triangles(mesh),
        mask=vertex_mask(obj, mode, parameters),
        to_world=_to_world(obj),
        mirror=(mesh.use_mirror_x, mesh.use_mirror_y, mesh.use_mirror_z),
    )
    return Target(obj.name, obj.session_uid, mesh.session_uid, parameters.output, surface)


def _label_of_mode(mode: str) -> str:
    """Turn an object's mode into the words on screen."""
    return f"{mode.replace('_', ' ').title()} Mode"


def _source(obj: bpy.types.Object, output: str) -> npt.NDArray[np.float32]:
    if obj.data.shape_keys is None:
        return read_positions(obj.data)
    if output == "SHAPE_KEY":
        return shape_keys.visible_shape(obj)
    return shape_keys.read(shape_keys.active_key(obj))


def _to_world(obj: bpy.types.Object) -> npt.NDArray[np.float64]:
    # Rotation and uniform scale change nothing, so they are left out: no rounding.
    matrix = np.array(obj.matrix_world.to_3x3(), dtype=np.float64)
    stretches = np.linalg.svd(matrix, compute_uv=False)
    if not stretches[-1] > _SINGULAR * stretches[0]:
        raise Skipped("its scale is zero along an axis; set a scale that is not zero")
    if stretches[0] <= (1.0 + _UNIFORM) * stretches[-1]:
        return np.identity(3)
    return matrix / stretches[0]
