# SPDX-License-Identifier: GPL-3.0-or-later
"""Mark edges as sharp where faces meet at an angle."""

from __future__ import annotations

import bpy
import numpy as np
import numpy.typing as npt

from ...core.host.edge_marks import face_normals, sharp_edges
from . import arrays
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
    corner_edges = arrays.read_attribute(mesh.attributes[".corner_edge"])
    starts = arrays.read(mesh.polygons, "loop_start", dtype=np.int32)
    normals = face_normals(positions, read_corner_vertices(mesh), starts)
    sharp = sharp_edges(normals, starts, corner_edges, len(mesh.edges), angle)
    if mask is not None:
        ends = arrays.read_attribute(mesh.attributes[".edge_verts"])
        sharp &= (mask[ends] > 0.0).all(axis=1)
    if not sharp.any():
        return
    marks = mesh.attributes.get("sharp_edge") or mesh.attributes.new(
        "sharp_edge", "BOOLEAN", "EDGE"
    )
    old = arrays.read(marks.data, "value", dtype=bool)
    arrays.write(marks.data, "value", old | sharp, bool)
