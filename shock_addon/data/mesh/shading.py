# SPDX-License-Identifier: GPL-3.0-or-later
"""Shading data: sharp edges and custom normals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
import numpy as np
import numpy.typing as npt

from ....core.host.edge_marks import face_normals, faces_at, sharp_edges
from .. import arrays
from .meshes import read_corner_vertices

if TYPE_CHECKING:
    from ....core.host.geometry import Reshaped


MARKS = "sharp_edge"
"""Name of the attribute of edges that are marked as sharp."""

_TURNS = "custom_normal"


def edges_to_mark(
    mesh: bpy.types.Mesh,
    result: Reshaped,
    mask: npt.NDArray[np.float64] | None,
    angle: float,
) -> npt.NDArray[np.bool_]:
    """Tell which edges become sharp: those of creases, or where faces meet at an angle: (e,).

    Parameters
    ----------
    mesh : bpy.types.Mesh
        In Object Mode.
    result : Reshaped
        Where its creases are None, edges between faces that meet at more than the angle.
    mask : (n,) float64 or None
        Edges stay as they are where it is 0 at one of their ends.
    angle : float
        In radians.
    """
    free = None if mask is None else mask > 0.0
    if result.creases is None:
        return steep_edges(mesh, result.positions, free, angle)
    ends = arrays.read_attribute(mesh.attributes[".edge_verts"])
    sharp = result.creases.among(ends)
    return sharp if free is None else sharp & free[ends].all(axis=1)


def mark(mesh: bpy.types.Mesh, sharp: npt.NDArray[np.bool_]) -> None:
    """Mark edges (e,) as sharp; marks that are there stay."""
    if sharp.any():
        set_marks(mesh, read_marks(mesh) | sharp, is_kept=True)


def read_marks(mesh: bpy.types.Mesh) -> npt.NDArray[np.bool_]:
    """Tell which edges are marked as sharp: (e,)."""
    marks = arrays.find_attribute(mesh, MARKS, "BOOLEAN", "EDGE")
    return np.zeros(len(mesh.edges), dtype=bool) if marks is None else arrays.read_attribute(marks)


def set_marks(mesh: bpy.types.Mesh, sharp: npt.NDArray[np.bool_], is_kept: bool) -> None:
    """Mark these edges (e,) as sharp and no others; if there are none, the attribute may go."""
    if is_kept or sharp.any():
        marks = arrays.find_or_add_attribute(mesh, MARKS, "BOOLEAN", "EDGE")
        arrays.write_attribute(marks, sharp)
    elif MARKS in mesh.attributes:
        mesh.attributes.remove(mesh.attributes[MARKS])


def steep_edges(
    mesh: bpy.types.Mesh,
    positions: npt.NDArray[np.float32],
    free: npt.NDArray[np.bool_] | None,
    angle: float,
) -> npt.NDArray[np.bool_]:
    """Tell which edges have faces that meet at more than an angle, in radians: (e,).

    Those with an end that is not free, (n,) bool, are left out.
    """
    none = np.zeros(len(mesh.edges), dtype=bool)
    if free is not None and not free.any():
        return none
    corner_edges = arrays.read_attribute(mesh.attributes[".corner_edge"])
    corner_vertices = read_corner_vertices(mesh)
    starts = arrays.read(mesh.polygons, "loop_start", dtype=np.int32)
    if free is not None:
        near, starts = faces_at(free, corner_vertices, starts)
        corner_edges, corner_vertices = corner_edges[near], corner_vertices[near]
    if len(starts) == 0:
        return none
    normals = face_normals(positions, corner_vertices, starts)
    sharp = sharp_edges(normals, starts, corner_edges, len(mesh.edges), angle)
    if free is not None:
        ends = arrays.read_attribute(mesh.attributes[".edge_verts"])
        sharp &= free[ends].all(axis=1)
    return sharp


def is_flat(mesh: bpy.types.Mesh) -> bool:
    """Whether all faces are shaded flat."""
    return bool(flat_faces(mesh).all())


def flat_faces(mesh: bpy.types.Mesh) -> npt.NDArray[np.bool_]:
    """Tell which faces are shaded flat: (f,)."""
    flat = arrays.find_attribute(mesh, "sharp_face", "BOOLEAN", "FACE")
    return np.zeros(len(mesh.polygons), bool) if flat is None else arrays.read_attribute(flat)


def count_marks(mesh: bpy.types.Mesh) -> int:
    """Count the edges that are marked as sharp."""
    return int(read_marks(mesh).sum())


def read_turns(mesh: bpy.types.Mesh) -> npt.NDArray[np.int16] | None:
    """Read custom normals as they are stored since Blender 4.5, relative to the surface: (c, 2).

    None where there are none, or they are stored in another way.
    """
    layer = arrays.find_attribute(mesh, _TURNS, "INT16_2D", "CORNER")
    return None if layer is None else arrays.read_attribute(layer)


def write_turns(mesh: bpy.types.Mesh, turns: npt.NDArray[np.int16]) -> None:
    """Write them; call ``mesh.update()`` afterwards."""
    arrays.write_attribute(mesh.attributes[_TURNS], turns)


def renew_normals(
    obj: bpy.types.Object, custom_normals: str, mask: npt.NDArray[np.float64] | None
) -> None:
    """Recompute or clear custom normals, if there are any; "KEEP" leaves them alone."""
    if obj.data.has_custom_normals and custom_normals == "RECOMPUTE":
        recompute_normals(obj, mask)
    elif obj.data.has_custom_normals and custom_normals == "CLEAR":
        clear_normals(obj)


def clear_normals(obj: bpy.types.Object) -> None:
    """Remove custom normals; smooth shading then follows the surface and its sharp edges."""
    with bpy.context.temp_override(object=obj, active_object=obj, mesh=obj.data):
        bpy.ops.mesh.customdata_custom_splitnormals_clear()


def recompute_normals(obj: bpy.types.Object, mask: npt.NDArray[np.float64] | None) -> None:
    """Set custom normals to the surface's, which break at sharp edges, where the mask is not 0."""
    mesh = obj.data
    vertices = read_corner_vertices(mesh)
    free = np.ones(len(vertices), dtype=bool) if mask is None else (mask > 0.0)[vertices]
    turns = read_turns(mesh)
    if turns is not None:
        turns[free] = 0
        write_turns(mesh, turns)
        return
    # Before Blender 4.5, and where normals are stored as vectors; slow, but there is no other way.
    normals = arrays.read(mesh.corner_normals, "vector", 3)
    normals[free] = 0.0  # which Blender takes for those of the surface
    clear_normals(obj)
    mesh.normals_split_custom_set(normals)
