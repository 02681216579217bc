# SPDX-License-Identifier: GPL-3.0-or-later
"""Tangent frames of texture coordinates, for tangent-space normal maps.

They are those of MikkTSpace (Mikkelsen 2008), which Blender and most game engines use: at each
corner the direction in which the first coordinate grows, averaged with angle weights over the faces
around the vertex that are connected in the texture and not mirrored against one another.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..base.checks import Floats
from ..base.progress import ask
from ..sparse.components import connected_components
from .calculus import unit_vectors
from .triangle_mesh import TriangleMesh

_LITTLE = 1e-30


class Frames(NamedTuple):
    """Frames at the corners of faces.

    The third direction is ``signs * cross(normals, tangents)``; between the corners all three are
    interpolated linearly, without normalizing.

    Attributes
    ----------
    normals, tangents : (m, 3, 3) float64
    signs : (m,) float64
        -1 where the texture is mirrored.
    """

    normals: Floats
    tangents: Floats
    signs: Floats


def smooth_normals(mesh: TriangleMesh) -> Floats:
    """Normals for smooth shading at the corners, weighted by corner angles: (m, 3, 3)."""
    weights = _angles(mesh.vertices[mesh.faces])
    sums = np.zeros((mesh.vertex_count, 3))
    for x in range(3):
        weighted = weights * mesh.normals[:, x, None]
        sums[:, x] = np.bincount(mesh.faces.reshape(-1), weighted.reshape(-1), mesh.vertex_count)
    return unit_vectors(sums, _LITTLE)[mesh.faces]


def tangent_frames(mesh: TriangleMesh, uv: Floats, normals: Floats | None = None) -> Frames:
    """Find the frames of texture coordinates.

    Parameters
    ----------
    mesh : TriangleMesh
    uv : (m, 3, 2) float64
        Coordinates at the corners of `mesh.faces`.
    normals : (m, 3, 3) float64, optional
        Unit vectors at the corners; smooth ones if left out.
    """
    normals = np.ascontiguousarray(smooth_normals(mesh) if normals is None else normals)
    corners = mesh.vertices[mesh.faces]
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    s, t = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    area = s[:, 0] * t[:, 1] - s[:, 1] * t[:, 0]
    signs = np.where(area < 0, -1.0, 1.0)
    along = signs[:, None] * (t[:, 1:] * one - s[:, 1:] * two)
    ask()
    flat = along[:, None] - np.einsum("fx,fkx->fk", along, normals)[..., None] * normals
    weights = np.where(area == 0, 0.0, 1.0)[:, None] * _angles_about(corners, normals)
    rows = (weights[..., None] * unit_vectors(flat, _LITTLE)).reshape(-1, 3)
    groups = _groups(mesh, uv, normals, signs)
    ask()
    sums: Floats = np.stack([np.bincount(groups, column) for column in rows.T], axis=1)
    tangents = unit_vectors(sums, _LITTLE)[groups].reshape(-1, 3, 3)
    # If no face of a group has area in the texture, any direction will do.
    lost = ~tangents.any(axis=2)
    axis = np.eye(3)[np.argmin(np.abs(normals[lost]), axis=1)]
    tangents[lost] = unit_vectors(np.cross(normals[lost], axis), _LITTLE)
    return Frames(normals, tangents, signs)


def _groups(
    mesh: TriangleMesh, uv: Floats, normals: Floats, signs: Floats
) -> np.ndarray[tuple[int], np.dtype[np.int32]]:
    # Number the frames: corners of two faces at an edge share a frame if coordinates and normals
    # agree.
    half = np.flatnonzero(mesh.twins.reshape(-1) > np.arange(3 * mesh.face_count))
    f, k = np.divmod(half, 3)
    g, j = np.divmod(mesh.twins.reshape(-1)[half], 3)
    k_next, j_next = (k + 1) % 3, (j + 1) % 3
    same = signs[f] == signs[g]
    for values in (uv, normals):
        same &= (values[f, k] == values[g, j_next]).all(axis=1)
        same &= (values[f, k_next] == values[g, j]).all(axis=1)
    f, k, g, j = f[same], k[same], g[same], j[same]
    one = np.concatenate([3 * f + k, 3 * f + k_next[same]])
    other = np.concatenate([3 * g + j_next[same], 3 * g + j])
    return connected_components(3 * mesh.face_count, one, other)[1]


def _angles(corners: Floats) -> Floats:
    # The angles at the corners of triangles: (m, 3).
    ahead = unit_vectors(np.roll(corners, -1, axis=1) - corners, _LITTLE)
    back = unit_vectors(np.roll(corners, 1, axis=1) - corners, _LITTLE)
    return np.arccos(np.clip(np.einsum("fkx,fkx->fk", ahead, back), -1.0, 1.0))


def _angles_about(corners: Floats, normals: Floats) -> Floats:
    # The angles at the corners, projected along the normals.
    sides = []
    for shift in (-1, 1):
        side = np.roll(corners, shift, axis=1) - corners
        along = np.einsum("fkx,fkx->fk", side, normals)
        sides.append(unit_vectors(side - along[..., None] * normals, _LITTLE))
    return np.arccos(np.clip(np.einsum("fkx,fkx->fk", *sides), -1.0, 1.0))
