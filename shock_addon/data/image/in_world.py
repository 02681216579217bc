# SPDX-License-Identifier: GPL-3.0-or-later
"""Read visible shapes in world space, for baking and as occluders."""

from __future__ import annotations

import bpy
import numpy as np
import numpy.typing as npt

from ....core.host.fields import WorldMesh
from .. import arrays
from ..mesh import meshes, visible
from ..skipped import Skipped


def others(context: bpy.types.Context, left: list[bpy.types.Object]) -> list[WorldMesh]:
    """Read all visible and rendered objects except the given ones. Objects in another mode,
    without faces or at NaN cannot be read, and cast no shadow.
    """
    shown = [obj for obj in context.visible_objects if obj.type == "MESH" and not obj.hide_render]
    return read_each([obj for obj in shown if obj not in left])[0]


def read_each(
    objects: list[bpy.types.Object],
) -> tuple[list[WorldMesh], list[tuple[str, str]]]:
    """Read objects as they are seen, with their modifiers.

    Returns
    -------
    meshes : list of WorldMesh
    left : list of (str, str)
        Names, and reasons, of objects that cannot be read.
    """
    found, left = [], []
    for obj in objects:
        try:
            found.append(_read(obj))
        except Skipped as reason:
            left.append((obj.name, str(reason)))
    return found, left


def _read(obj: bpy.types.Object) -> WorldMesh:
    # As it is seen, with its modifiers, which may be what makes its faces.
    meshes.check_in_object_mode(obj)
    matrix = meshes.matrix_in_world(obj)
    with visible.evaluated(obj) as (seen, _):
        mesh = seen.data
        if not mesh.polygons:
            raise Skipped("it has no faces; add some, or select another object")
        triangles = meshes.read_triangles(mesh).astype(np.int64)
        positions = meshes.read_positions(mesh).astype(np.float64)
        meshes.check_finite(positions)
        colors = _colors(mesh)
    if np.linalg.det(matrix[:3, :3]) < 0:
        triangles = triangles[:, ::-1]
    return WorldMesh(positions @ matrix[:3, :3].T + matrix[:3, 3], triangles, colors)


def _colors(mesh: bpy.types.Mesh) -> npt.NDArray[np.float64] | None:
    # The mean of the corners' colors at each vertex.
    attribute = mesh.color_attributes.active_color
    if attribute is None:
        return None
    values = arrays.read(attribute.data, "color", 4).astype(np.float64)[:, :3]  # linear
    if attribute.domain == "POINT" or not np.isfinite(values).all():
        return values if np.isfinite(values).all() else None
    vertices = meshes.read_corner_vertices(mesh)
    count = len(mesh.vertices)
    sums = [np.bincount(vertices, column, minlength=count) for column in values.T]
    number = np.maximum(np.bincount(vertices, minlength=count), 1)
    return np.stack(sums, axis=1) / number[:, None]
