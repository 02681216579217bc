# SPDX-License-Identifier: GPL-3.0-or-later
"""Custom normals of a mesh whose shape has changed: set anew, or removed."""

from __future__ import annotations

import bpy
import numpy as np
import numpy.typing as npt

from . import arrays
from .meshes import read_corner_vertices

_LAYER = "custom_normal"


def clear(obj: bpy.types.Object) -> None:
    """Remove them; smooth shading then follows the surface and its sharp edges."""
    with bpy.context.temp_override(object=obj, active_object=obj, mesh=obj.data):
        bpy.ops.mesh.customdata_custom_splitnormals_clear()


def recompute(obj: bpy.types.Object, mask: npt.NDArray[np.float64] | None) -> None:
    """Set them to those of the surface, which break at sharp edges, where the mask is not 0."""
    mesh = obj.data
    vertices = read_corner_vertices(mesh)
    free = np.ones(len(vertices), dtype=bool) if mask is None else (mask > 0.0)[vertices]
    layer = mesh.attributes.get(_LAYER)
    if layer is not None and layer.data_type == "INT16_2D":
        _forget_turns(layer, free)
        return
    # Before Blender 4.5, and where normals are stored as vectors; slow, but there is no other way.
    normals = arrays.read(mesh.corner_normals, "vector", 3)
    normals[free] = 0.0  # which Blender takes for those of the surface
    clear(obj)
    mesh.normals_split_custom_set(normals)


def _forget_turns(layer: bpy.types.Attribute, free: npt.NDArray[np.bool_]) -> None:
    """Set how far normals are turned from those of the surface to nothing."""
    turns = arrays.read_attribute(layer)
    turns[free] = 0
    arrays.write_attribute(layer, turns)
