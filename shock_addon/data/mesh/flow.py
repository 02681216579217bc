# SPDX-License-Identifier: GPL-3.0-or-later
"""Conversion of a flow to the faces of a mesh and, on request, to its attributes."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import bpy
import numpy as np
import numpy.typing as npt

from .. import arrays
from ..skipped import Skipped
from .targets import MeshTarget, find

if TYPE_CHECKING:
    from ....core.preview.flow import Flow

POTENTIAL = ".shock_potential"  # Blender exports no attributes that begin with a dot
FLOW = ".shock_flow"

_POTENTIAL = POTENTIAL, "FLOAT", "POINT"
_FLOW = FLOW, "FLOAT_VECTOR", "FACE"


class FlowOfMesh(NamedTuple):
    """The flow of a mesh.

    Attributes
    ----------
    potential : (n,) float32
        Of the vertices.
    flow : (k, 3) float32
        Of the faces: the mean of their triangles'.
    """

    potential: npt.NDArray[np.float32]
    flow: npt.NDArray[np.float32]

    @property
    def kind(self) -> str:
        """What is shown."""
        return "flow"

    def fits(self, mesh: bpy.types.Mesh) -> bool:
        """Whether a mesh has as many vertices and faces."""
        return (len(mesh.vertices), len(mesh.polygons)) == (len(self.potential), len(self.flow))


def flow_of(target: MeshTarget, result: Flow) -> tuple[bpy.types.Object, FlowOfMesh]:
    """Find the object, and convert its flow to the faces, in Object Mode.

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
    return obj, FlowOfMesh(result.potential, np.stack(means, axis=1).astype(np.float32))


def write_flow(mesh: bpy.types.Mesh, found: FlowOfMesh) -> None:
    """Write it into attributes, in Object Mode."""
    for about, values in ((_POTENTIAL, found.potential), (_FLOW, found.flow)):
        arrays.write_attribute(arrays.find_or_add_attribute(mesh, *about), values)
    mesh.update()


def read_faces(mesh: bpy.types.Mesh) -> tuple[npt.NDArray, npt.NDArray]:
    """Read the centers (k, 3) and normals (k, 3) of the faces."""
    faces = mesh.polygons
    return arrays.read(faces, "center", 3), arrays.read(faces, "normal", 3)
