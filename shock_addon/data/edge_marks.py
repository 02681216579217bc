# SPDX-License-Identifier: GPL-3.0-or-later
"""Mark edges as sharp where faces meet at an angle."""

from __future__ import annotations

import bpy
import numpy as np
import numpy.typing as npt

from ...core.host.edge_marks import face_normals, sharp_edges
from .meshes import read_corner_vertices


def mark_sharp(
    mesh: bpy.types.Mesh,
    positions: npt.NDArray[np.float32],
    mask: npt.NDArray[np.float64] | None,
    angle: float,
) -> None:
    """Mark edges between faces that meet at more than an angle; marks that are there stay.

    Parameters
    ----------
    mesh : bpy.types.Mesh
        In Object Mode.
    positions : (n, 3) float32
        Of the shape that counts, which may be a shape key.
    mask : (n,) float64 or None
        Edges stay as they are where it is 0 at one of their ends.
    angle : float
        In radians.
    """
    corner_edges = np.empty(len(mesh.loops), dtype=np.int32)
    mesh.attributes[".corner_edge"].data.foreach_get("value", corner_edges)
    starts = np.empty(len(mesh.polygons), dtype=np.int32)
    mesh.polygons.foreach_get("loop_start", starts)
    normals = face_normals(positions, read_corner_vertices(mesh), starts)
    sharp = sharp_edges(normals, starts, corner_edges, len(mesh.edges), angle)
    if mask is not None:
        ends = np.empty(2 * len(mesh.edges), dtype=np.int32)
        mesh.attributes[".edge_verts"].data.foreach_get("value", ends)
        sharp &= (mask[ends.reshape(-1, 2)] > 0.0).all(axis=1)
    if not sharp.any():
        return
    marks = mesh.attributes.get("sharp_edge") or mesh.attributes.new(
        "sharp_edge", "BOOLEAN", "EDGE"
    )
    old = np.empty(len(mesh.edges), dtype=bool)
    marks.data.foreach_get("value", old)
    marks.data.foreach_set("value", old | sharp)
