# SPDX-License-Identifier: GPL-3.0-or-later
"""Between a mesh object's shape and arrays: the mesh itself or its shape keys."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import numpy.typing as npt

from . import shape_keys
from .masks import vertex_mask
from .mesh_data import (
    Target,
    find,
    lengths_in_world,
    read_corner_vertices,
    read_positions,
    read_triangle_corners,
    write_positions,
)
from .sharpening import MirroredSurface, Sharpened
from .skipped import Skipped


def read_geometry(obj: bpy.types.Object, mode: str, parameters: Any) -> tuple[str, MirroredSurface]:
    """Read what is sharpened; parameters are those of `vertex_mask` and `output`."""
    mesh = obj.data
    surface = MirroredSurface(
        positions=_source(obj, parameters.output),
        triangles=read_corner_vertices(mesh)[read_triangle_corners(mesh)],
        mask=vertex_mask(obj, mode, parameters),
        to_world=lengths_in_world(obj),
        mirror=(mesh.use_mirror_x, mesh.use_mirror_y, mesh.use_mirror_z),
    )
    return parameters.output, surface


def write_geometry(
    target: Target, result: Sharpened, key_name: str = "Sharpened"
) -> bpy.types.Object:
    """Write new positions, in Object Mode; returns the object.

    Parameters
    ----------
    target : Target
    result : Sharpened
    key_name : str
        What a new shape key is called.

    Raises
    ------
    Skipped
        If the object was removed or its shape has changed since it was read.
    """
    obj = find(target)
    old = target.surface.positions
    if not np.array_equal(_source(obj, target.place), old):
        raise Skipped("it was changed meanwhile; run again")
    if target.place == "SHAPE_KEY":
        shape_keys.add(obj, key_name, result.positions - old)
    elif obj.data.shape_keys is None:
        write_positions(obj.data, result.positions)
    else:
        shape_keys.write_active(obj, result.positions)
        write_positions(obj.data, shape_keys.read(obj.data.shape_keys.reference_key))
    obj.data.update()
    return obj


def _source(obj: bpy.types.Object, output: str) -> npt.NDArray[np.float32]:
    if obj.data.shape_keys is None:
        return read_positions(obj.data)
    if output == "SHAPE_KEY":
        return shape_keys.visible_shape(obj)
    return shape_keys.read(shape_keys.active_key(obj))
