# SPDX-License-Identifier: GPL-3.0-or-later
"""What may change: vertex group, selection, sculpt mask, paint mask, hidden parts."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import numpy.typing as npt

from .mesh_data import read_corner_vertices
from .skipped import Skipped


def vertex_mask(
    obj: bpy.types.Object, mode: str, parameters: Any
) -> npt.NDArray[np.float64] | None:
    """Multiply all masks that apply to an object.

    Parameters
    ----------
    obj : bpy.types.Object
        A mesh object in Object Mode.
    mode : str
        The mode that the person works in, as in ``bpy.context.mode``.
    parameters : object
        Has `vertex_group`, `invert_mask` and `selected_only`.

    Returns
    -------
    (n,) float64 or None
        1 changes fully, 0 stays; None if nothing is masked.

    Raises
    ------
    Skipped
        If the vertex group is missing or no vertex may change.
    """
    mesh = obj.data
    masks = []
    if parameters.vertex_group:
        weights = group_weights(obj, parameters.vertex_group)
        masks.append(1.0 - weights if parameters.invert_mask else weights)
    if mode in {"EDIT_MESH", "SCULPT"}:
        masks.append(~_flags(mesh.vertices, "hide"))
    if mode == "EDIT_MESH" and parameters.selected_only:
        masks.append(_flags(mesh.vertices, "select"))
    if mode == "PAINT_VERTEX" and mesh.use_paint_mask_vertex:
        masks.append(_flags(mesh.vertices, "select"))
    if mode == "SCULPT" and ".sculpt_mask" in mesh.attributes:
        masks.append(1.0 - _sculpt_mask(mesh))
    return _product(masks)


def color_mask(
    obj: bpy.types.Object, mode: str, domain: str, parameters: Any
) -> tuple[npt.NDArray[np.float64] | None, npt.NDArray[np.bool_] | None]:
    """Find out which colors may change: as `vertex_mask`, and the selection of faces counts.

    Parameters
    ----------
    obj, mode, parameters
        As in `vertex_mask`.
    domain : str
        "POINT" or "CORNER".

    Returns
    -------
    mask : (n,) float64 or None
        Of the vertices.
    free : (number of face corners,) bool or None
        False for corners in protected faces. None on vertices: those of a free face are free.

    Raises
    ------
    Skipped
        As in `vertex_mask`.
    """
    mesh = obj.data
    mask = vertex_mask(obj, mode, parameters)
    faces = _free_faces(mesh, mode, parameters)
    if faces is None:
        return mask, None
    counts = np.empty(len(mesh.polygons), dtype=np.int32)
    mesh.polygons.foreach_get("loop_total", counts)
    free = np.repeat(faces, counts)
    reached = np.zeros(len(mesh.vertices), dtype=bool)
    reached[read_corner_vertices(mesh)[free]] = True
    both = _product([reached] if mask is None else [mask, reached])
    return (mask, free) if domain == "CORNER" else (both, None)


def _free_faces(mesh: bpy.types.Mesh, mode: str, parameters: Any) -> npt.NDArray[np.bool_] | None:
    flags = []
    if mode in {"EDIT_MESH", "SCULPT", "PAINT_VERTEX", "PAINT_TEXTURE"}:
        flags.append(~_flags(mesh.polygons, "hide"))
    by_face = tuple(bpy.context.tool_settings.mesh_select_mode) == (False, False, True)
    if (mode == "EDIT_MESH" and parameters.selected_only and by_face) or (
        mode in {"PAINT_VERTEX", "PAINT_TEXTURE"} and mesh.use_paint_mask
    ):
        flags.append(_flags(mesh.polygons, "select"))
    free = np.logical_and.reduce(flags) if flags else np.True_
    return None if free.all() else free


def _product(masks: list[npt.NDArray]) -> npt.NDArray[np.float64] | None:
    if not masks:
        return None
    mask = np.clip(np.prod(masks, axis=0, dtype=np.float64), 0.0, 1.0)
    if not mask.any():
        raise Skipped("its mask or selection leaves nothing to change; select or unmask some")
    return None if (mask == 1.0).all() else mask


def group_weights(obj: bpy.types.Object, name: str) -> npt.NDArray[np.float64]:
    """Read a vertex group's weights, 0 for vertices outside it: (n,).

    Raises
    ------
    Skipped
        If the object has no such group.
    """
    group = obj.vertex_groups.get(name)
    if group is None:
        raise Skipped(f"it has no vertex group named {name!r}; add it, or leave the field empty")
    number = group.index
    vertices = obj.data.vertices
    weights = (
        next((element.weight for element in vertex.groups if element.group == number), 0.0)
        for vertex in vertices
    )
    return np.fromiter(weights, dtype=np.float64, count=len(vertices))


def _flags(elements: Any, name: str) -> npt.NDArray[np.bool_]:
    flags = np.empty(len(elements), dtype=bool)
    elements.foreach_get(name, flags)
    return flags


def _sculpt_mask(mesh: bpy.types.Mesh) -> npt.NDArray[np.float32]:
    values = np.empty(len(mesh.vertices), dtype=np.float32)
    mesh.attributes[".sculpt_mask"].data.foreach_get("value", values)
    return values
