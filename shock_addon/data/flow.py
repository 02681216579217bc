# SPDX-License-Identifier: GPL-3.0-or-later
"""Between a mesh's attributes and the flow: what Show Flow writes and the overlay reads."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
import numpy as np
import numpy.typing as npt

from . import arrays
from .meshes import Target, find
from .skipped import Skipped

if TYPE_CHECKING:
    from ...core.host.flow import Flow

POTENTIAL = ".shock_potential"  # Blender exports no attributes that begin with a dot
FLOW = ".shock_flow"

_POTENTIAL = POTENTIAL, "FLOAT", "POINT"
_FLOW = FLOW, "FLOAT_VECTOR", "FACE"


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
    faces = arrays.read(mesh.loop_triangles, "polygon_index", dtype=np.int32)
    counts = np.bincount(faces, minlength=len(mesh.polygons))
    means = [
        np.bincount(faces, column, minlength=len(mesh.polygons)) / counts
        for column in result.flow.T
    ]
    for about, values in ((_POTENTIAL, result.potential), (_FLOW, np.stack(means, axis=1))):
        arrays.write_attribute(arrays.find_or_add_attribute(mesh, *about), values)
    mesh.update()
    return obj


def read_flow(mesh: bpy.types.Mesh) -> tuple[npt.NDArray, npt.NDArray] | None:
    """Read the potential (n,) and the flow of the faces (k, 3); None if they are not there."""
    potential = arrays.find_attribute(mesh, *_POTENTIAL)
    flow = arrays.find_attribute(mesh, *_FLOW)
    if potential is None or flow is None:
        return None
    return arrays.read_attribute(potential), arrays.read_attribute(flow)


def remove_flow(mesh: bpy.types.Mesh) -> None:
    """Remove both attributes, in any mode."""
    for name in (POTENTIAL, FLOW):
        if name in mesh.attributes:
            mesh.attributes.remove(mesh.attributes[name])
    mesh.update()


def read_faces(mesh: bpy.types.Mesh) -> tuple[npt.NDArray, npt.NDArray, npt.NDArray]:
    """Read the centers (k, 3), normals (k, 3) and areas (k,) of the faces."""
    faces = mesh.polygons
    return (
        arrays.read(faces, "center", 3),
        arrays.read(faces, "normal", 3),
        arrays.read(faces, "area"),
    )
