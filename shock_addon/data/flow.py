# SPDX-License-Identifier: GPL-3.0-or-later
"""Between a mesh's attributes and the flow: what Show Flow writes and the overlay reads."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
import numpy as np
import numpy.typing as npt

from .meshes import Target, find
from .skipped import Skipped

if TYPE_CHECKING:
    from ...core.host.flow import Flow

POTENTIAL = "shock_potential"
FLOW = "shock_flow"


def write_flow(target: Target, result: Flow) -> bpy.types.Object:
    """Write both attributes, in Object Mode; a face's flow is the mean of its triangles'.

    Raises
    ------
    Skipped
        If the object was removed, or its mesh has more or fewer vertices or triangles by now.
    """
    obj = find(target)
    mesh = obj.data
    mesh.calc_loop_triangles()
    sizes = len(mesh.vertices), len(mesh.loop_triangles)
    if sizes != (len(result.potential), len(result.flow)):
        raise Skipped("it was changed meanwhile; run again")
    faces = np.empty(len(mesh.loop_triangles), dtype=np.int32)
    mesh.loop_triangles.foreach_get("polygon_index", faces)
    counts = np.bincount(faces, minlength=len(mesh.polygons))
    means = [
        np.bincount(faces, column, minlength=len(mesh.polygons)) / counts
        for column in result.flow.T
    ]
    _write(mesh, POTENTIAL, "FLOAT", "POINT", "value", result.potential)
    _write(mesh, FLOW, "FLOAT_VECTOR", "FACE", "vector", np.stack(means, axis=1))
    mesh.update()
    return obj


def read_flow(mesh: bpy.types.Mesh) -> tuple[npt.NDArray, npt.NDArray] | None:
    """Read the potential (n,) and the flow of the faces (k, 3); None if they are not there."""
    potential = _find(mesh, POTENTIAL, "FLOAT", "POINT")
    flow = _find(mesh, FLOW, "FLOAT_VECTOR", "FACE")
    if potential is None or flow is None:
        return None
    values = np.empty(len(mesh.vertices), dtype=np.float32)
    vectors = np.empty(3 * len(mesh.polygons), dtype=np.float32)
    potential.data.foreach_get("value", values)
    flow.data.foreach_get("vector", vectors)
    return values, vectors.reshape(-1, 3)


def read_faces(mesh: bpy.types.Mesh) -> tuple[npt.NDArray, npt.NDArray, npt.NDArray]:
    """Read the centers (k, 3), normals (k, 3) and areas (k,) of the faces."""
    count = len(mesh.polygons)
    centers, normals = np.empty((2, 3 * count), dtype=np.float32)
    areas = np.empty(count, dtype=np.float32)
    mesh.polygons.foreach_get("center", centers)
    mesh.polygons.foreach_get("normal", normals)
    mesh.polygons.foreach_get("area", areas)
    return centers.reshape(-1, 3), normals.reshape(-1, 3), areas


def _find(
    mesh: bpy.types.Mesh, name: str, data_type: str, domain: str
) -> bpy.types.Attribute | None:
    attribute = mesh.attributes.get(name)
    if attribute is None or (attribute.data_type, attribute.domain) != (data_type, domain):
        return None
    return attribute


def _write(
    mesh: bpy.types.Mesh, name: str, data_type: str, domain: str, key: str, values: npt.NDArray
) -> None:
    attribute = _find(mesh, name, data_type, domain)
    if attribute is None:
        if name in mesh.attributes:
            mesh.attributes.remove(mesh.attributes[name])
        attribute = mesh.attributes.new(name, data_type, domain)
    attribute.data.foreach_set(key, np.ascontiguousarray(values, dtype=np.float32).reshape(-1))
