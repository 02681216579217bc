# SPDX-License-Identifier: GPL-3.0-or-later
"""Mark edges as sharp where faces meet at an angle."""

from __future__ import annotations

import bpy
import numpy as np
import numpy.typing as npt

from .meshes import read_corner_vertices

_ROUNDING = 1e-12


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


def face_normals(
    positions: npt.NDArray[np.float32], corner_vertices: npt.NDArray, starts: npt.NDArray
) -> npt.NDArray[np.float64]:
    """Return the faces' unit normals, 0 for faces without area: (number of faces, 3)."""
    sizes = np.diff(np.append(starts, len(corner_vertices)))
    following = np.arange(1, len(corner_vertices) + 1)
    following[starts + sizes - 1] = starts
    # Seen from each face's first corner, so that places far from the origin lose no digits.
    points = positions[corner_vertices].astype(np.float64)
    points -= np.repeat(points[starts], sizes, axis=0)
    normals = np.add.reduceat(np.cross(points, points[following]), starts, axis=0)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0.0)


def sharp_edges(
    normals: npt.NDArray[np.float64],
    starts: npt.NDArray,
    corner_edges: npt.NDArray,
    edges: int,
    angle: float,
) -> npt.NDArray[np.bool_]:
    """Tell which edges have exactly two faces, which meet at more than an angle: (edges,)."""
    faces = np.repeat(np.arange(len(starts)), np.diff(np.append(starts, len(corner_edges))))
    one, other = np.zeros((2, edges), dtype=faces.dtype)
    one[corner_edges[::-1]] = faces[::-1]  # the first face of each edge
    other[corner_edges] = faces  # and the last
    paired = np.flatnonzero(np.bincount(corner_edges, minlength=edges) == 2)
    one, other = one[paired], other[paired]
    solid = normals.any(axis=1)  # faces that have an area
    cosine = np.einsum("ij,ij->i", normals[one], normals[other])
    sharp = np.zeros(edges, dtype=bool)
    sharp[paired] = solid[one] & solid[other] & (cosine < np.cos(angle) - _ROUNDING)
    return sharp
