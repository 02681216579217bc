# SPDX-License-Identifier: GPL-3.0-or-later
"""Which vertices may move: vertex group, selection, sculpt mask, hidden parts."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import numpy.typing as npt

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
        1 moves fully, 0 stays; None if nothing is masked.

    Raises
    ------
    Skipped
        If the vertex group is missing or no vertex may move.
    """
    mesh = obj.data
    masks = []
    if parameters.vertex_group:
        weights = group_weights(obj, parameters.vertex_group)
        masks.append(1.0 - weights if parameters.invert_mask else weights)
    if mode in {"EDIT_MESH", "SCULPT"}:
        masks.append(~_flags(mesh, "hide"))
    if mode == "EDIT_MESH" and parameters.selected_only:
        masks.append(_flags(mesh, "select"))
    if mode == "SCULPT" and ".sculpt_mask" in mesh.attributes:
        masks.append(1.0 - _sculpt_mask(mesh))
    if not masks:
        return None
    mask = np.clip(np.prod(masks, axis=0, dtype=np.float64), 0.0, 1.0)
    if not mask.any():
        raise Skipped("its mask or selection leaves no vertex to move; select or unmask some")
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


def _flags(mesh: bpy.types.Mesh, name: str) -> npt.NDArray[np.bool_]:
    flags = np.empty(len(mesh.vertices), dtype=bool)
    mesh.vertices.foreach_get(name, flags)
    return flags


def _sculpt_mask(mesh: bpy.types.Mesh) -> npt.NDArray[np.float32]:
    values = np.empty(len(mesh.vertices), dtype=np.float32)
    mesh.attributes[".sculpt_mask"].data.foreach_get("value", values)
    return values
