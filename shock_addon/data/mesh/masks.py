# SPDX-License-Identifier: GPL-3.0-or-later
"""Masks: vertex group, selection, sculpt mask, paint mask, hidden parts."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import numpy.typing as npt

from .. import arrays
from ..skipped import Skipped
from .meshes import read_corner_vertices
from .vertex_groups import group_weights

_PAINTING = {"PAINT_VERTEX", "PAINT_TEXTURE", "PAINT_WEIGHT"}
"""Modes where a paint mask of selected faces can be turned on."""


def color_mask(
    obj: bpy.types.Object, mode: str, domain: str, parameters: Any
) -> tuple[npt.NDArray[np.float64] | None, npt.NDArray[np.bool_] | None]:
    """Find out which vertices or colors may change, from all masks; those of a free face are free.

    Parameters
    ----------
    obj : bpy.types.Object
        A mesh object in Object Mode.
    mode : str
        The mode that the person works in, as in ``bpy.context.mode``.
    domain : str
        "POINT" or "CORNER".
    parameters : object
        Has `vertex_group`, `invert_mask` and `selected_only`, unless the filter takes no mask.

    Returns
    -------
    mask : (n,) float64 or None
        Of the vertices: 1 changes fully, 0 stays; None if nothing is masked.
    free : (number of face corners,) bool or None
        False for corners in protected faces; None on vertices.

    Raises
    ------
    Skipped
        If the vertex group is missing or no vertex may change.
    """
    masks = _vertex_masks(obj, mode, parameters)
    free = _free_corners(obj.data, mode, parameters)
    if free is None:
        return _product(masks), None
    reached = np.zeros(len(obj.data.vertices), dtype=bool)
    reached[read_corner_vertices(obj.data)[free]] = True
    whole = _product([*masks, reached])  # also says if nothing is left
    return (whole, None) if domain == "POINT" else (_product(masks), free)


def is_limited(obj: bpy.types.Object, mode: str, parameters: Any) -> bool:
    """Whether the mode, by its selection, mask or hidden parts, leaves something out.

    Parameters
    ----------
    obj, mode, parameters
        As in `color_mask`.
    """
    selected_only = getattr(parameters, "selected_only", False)
    own = SimpleNamespace(vertex_group="", selected_only=selected_only)
    return any(each is not None for each in color_mask(obj, mode, "CORNER", own))


def _vertex_masks(obj: bpy.types.Object, mode: str, parameters: Any) -> list[npt.NDArray]:
    mesh = obj.data
    masks: list[npt.NDArray] = []
    if getattr(parameters, "vertex_group", ""):
        weights = group_weights(obj, parameters.vertex_group)
        masks.append(1.0 - weights if parameters.invert_mask else weights)
    if mode in {"EDIT_MESH", "SCULPT"}:
        masks.append(~_flags(mesh.vertices, "hide"))
    if mode == "EDIT_MESH" and getattr(parameters, "selected_only", False):
        masks.append(_flags(mesh.vertices, "select"))
    if mode in {"PAINT_VERTEX", "PAINT_WEIGHT"} and mesh.use_paint_mask_vertex:
        masks.append(_flags(mesh.vertices, "select"))
    # One of another kind may have come from a file; Blender does not sculpt with it.
    sculpted = arrays.find_attribute(mesh, ".sculpt_mask", "FLOAT", "POINT")
    if mode == "SCULPT" and sculpted is not None:
        masks.append(1.0 - arrays.read_attribute(sculpted))
    return masks


def _free_corners(mesh: bpy.types.Mesh, mode: str, parameters: Any) -> npt.NDArray[np.bool_] | None:
    """Say which face corners lie in free faces; None if all do."""
    flags = []
    if mode in {"EDIT_MESH", "SCULPT", *_PAINTING}:
        flags.append(~_flags(mesh.polygons, "hide"))
    by_face = tuple(bpy.context.tool_settings.mesh_select_mode) == (False, False, True)
    selected_only = mode == "EDIT_MESH" and getattr(parameters, "selected_only", False)
    if (selected_only and by_face) or (mode in _PAINTING and mesh.use_paint_mask):
        flags.append(_flags(mesh.polygons, "select"))
    free = np.logical_and.reduce(flags) if flags else np.True_
    if free.all():
        return None
    return np.repeat(free, arrays.read(mesh.polygons, "loop_total", dtype=np.int32))


def _product(masks: list[npt.NDArray]) -> npt.NDArray[np.float64] | None:
    if not masks:
        return None
    mask = np.clip(np.prod(masks, axis=0, dtype=np.float64), 0.0, 1.0)
    if not mask.any():
        raise Skipped("its mask or selection leaves nothing to change; select or unmask some")
    return None if (mask == 1.0).all() else mask


def _flags(elements: Any, name: str) -> npt.NDArray[np.bool_]:
    return arrays.read(elements, name, dtype=bool)
