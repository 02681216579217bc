# SPDX-License-Identifier: GPL-3.0-or-later
"""Between a mesh object and a crisp low poly of it, with its materials and UVs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy
import numpy as np
import numpy.typing as npt

from ....core.host.inputs import CutSurface
from .. import arrays
from ..chosen import mesh_objects, mesh_refusal
from . import creases, meshes, shading, visible
from .targets import MeshTarget, find

if TYPE_CHECKING:
    from ....core.shape.low_poly import LowPoly


def read_cut(obj: bpy.types.Object, mode: str, parameters: Any) -> tuple[None, CutSurface]:
    """Read the mesh, and where its UVs and materials end; `mode` and `parameters` do not count."""
    mesh = obj.data
    positions, corners = meshes.read_positions(mesh), meshes.read_triangle_corners(mesh)
    triangles = meshes.read_corner_vertices(mesh)[corners]
    data = [_of_triangles(mesh, _materials(mesh))[:, None, None] + np.zeros((1, 3, 1))]
    data += [arrays.read(layer.uv, "vector", 2)[corners] for layer in mesh.uv_layers]
    return None, CutSurface(
        positions=positions,
        triangles=triangles,
        mask=None,
        to_world=meshes.lengths_of_shape(obj, positions, triangles),
        cuts=_borders(triangles, np.concatenate(data, axis=2)),
    )


def is_seen(obj: bpy.types.Object) -> bool:
    """Whether what is seen of an object is read: modifiers, shape keys, or a linked mesh."""
    return bool(obj.modifiers or obj.data.shape_keys or mesh_refusal(obj.data))


def add_low_poly(
    target: MeshTarget, low: LowPoly, context: bpy.types.Context, angle: float
) -> list[bpy.types.Object]:
    """Add an object with the new mesh for each chosen one of the old mesh, which are hidden.

    Materials, UVs and whether faces are smooth are those of what was read; edges that are steeper
    than the angle, in radians, are marked as sharp if any is smooth. Other attributes, shape keys
    and modifiers are left out. The object of the target comes first.

    Raises
    ------
    Skipped
        If the object was removed or its shape has changed since it was read.
    """
    if target.is_seen:
        obj = find(target)
        with visible.shown(obj) as found:
            arrays.check_same(meshes.read_positions(found.data), target.surface.positions)
            mesh = _build(f"{obj.name} low poly", found.data, low, angle)
        return [_put_in_place(obj, mesh)]
    obj = creases.find_same(target)
    mesh = _build(f"{obj.name} low poly", obj.data, low, angle)
    users = [each for each in mesh_objects(context) if each.data == obj.data and not is_seen(each)]
    return [_put_in_place(each, mesh) for each in (obj, *(user for user in users if user != obj))]


def _build(name: str, old: bpy.types.Mesh, low: LowPoly, angle: float) -> bpy.types.Mesh:
    old_corners = meshes.read_triangle_corners(old)
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(low.vertices.tolist(), [], low.faces.tolist())
    for material in old.materials:
        mesh.materials.append(None if material is None else material.original)
    numbers = _of_triangles(old, _materials(old))[low.face_source]
    arrays.write(mesh.polygons, "material_index", numbers, np.int32)
    corners = old_corners.reshape(-1)[low.corner_source.reshape(-1)]
    for layer in old.uv_layers:
        new = mesh.uv_layers.new(name=layer.name, do_init=False)
        arrays.write(new.uv, "vector", arrays.read(layer.uv, "vector", 2)[corners])
        new.active_render = layer.active_render
    mesh.uv_layers.active_index = old.uv_layers.active_index
    flat = _of_triangles(old, shading.flat_faces(old))[low.face_source]
    arrays.write(mesh.polygons, "use_smooth", ~flat, bool)
    mesh.update()
    if not flat.all():
        shading.mark(mesh, shading.steep_edges(mesh, meshes.read_positions(mesh), None, angle))
        mesh.update()
    return mesh


def _put_in_place(obj: bpy.types.Object, mesh: bpy.types.Mesh) -> bpy.types.Object:
    # Adds an object with the new mesh, and hides the old object.
    made = visible.with_mesh(obj, mesh)
    made.name = f"{obj.name} low poly"
    visible.place(made, obj)
    return made


def _materials(mesh: bpy.types.Mesh) -> npt.NDArray[np.int32]:
    # The number of each face's material.
    return arrays.read(mesh.polygons, "material_index", dtype=np.int32)


def _of_triangles(mesh: bpy.types.Mesh, of_faces: npt.NDArray[Any]) -> npt.NDArray[Any]:
    if len(mesh.loop_triangles) == len(mesh.polygons):
        return of_faces
    return of_faces[arrays.read(mesh.loop_triangles, "polygon_index", dtype=np.int32)]


def _borders(triangles: npt.NDArray, data: npt.NDArray) -> npt.NDArray[np.int64]:
    # Edges (k, 2) at whose ends the data of corners (m, 3, d) differ from face to face.
    begin, end = triangles.reshape(-1), np.roll(triangles, -1, axis=1).reshape(-1)
    ahead = (begin < end)[:, None]
    here, there = (each.reshape(len(begin), -1) for each in (data, np.roll(data, -1, axis=1)))
    of_edge = np.concatenate([np.where(ahead, here, there), np.where(ahead, there, here)], axis=1)
    keys = np.minimum(begin, end).astype(np.int64) << 32 | np.maximum(begin, end)
    order = np.argsort(keys, kind="stable")
    same = keys[order][1:] == keys[order][:-1]
    differ = (np.abs(np.diff(of_edge[order], axis=0)) > 1e-6).any(axis=1)
    found = np.unique(keys[order][1:][same & differ])
    return np.stack([found >> 32, found & 0xFFFFFFFF], axis=1)
