# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator Sharpen Geometry."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt

from ...core import host as filters
from ...core.settings import GeometrySettings
from .. import data
from .base import MeshOperator, Steps, counted
from .properties import GeometryProperties


class SHOCK_FILTER_OT_sharpen_geometry(MeshOperator, GeometryProperties, bpy.types.Operator):
    """Turn rounded creases into sharp ones: normals flow towards the creases, positions follow"""

    bl_idname = "shock_filter.sharpen_geometry"
    bl_label = "Sharpen Geometry"
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    mode = "geometry"
    settings_type = GeometrySettings

    def steps(self) -> Steps:
        """Sharpen the shape."""
        return Steps(data.read_geometry, filters.sharpen, data.write_geometry)

    def summary(self, written: list[tuple], seconds: float) -> str:
        """Count meshes and vertices."""
        results = [result for _, result in written]
        moved = any(result.moved for result in results)
        text = pgettext_rpt(
            "Sharpened {meshes}: {changes}, {seconds:.1f} s."
            if moved
            else "Found nothing to sharpen in {meshes}: {changes}, {seconds:.1f} s."
        ).format(
            meshes=counted(len(written), "1 mesh", "{:,} meshes"),
            changes=describe_moves(results),
            seconds=seconds,
        )
        if not moved:
            advice = pgettext_rpt("For wide or gentle creases raise Time or lower Threshold.")
            text = f"{text} {advice}"
        return text

    def notes(self, written: list[tuple]) -> str:
        """Say what shapes what is seen beside the vertices."""
        return notes([obj for obj, _ in written], self)


def describe_moves(results: list[filters.Sharpened]) -> str:
    """Count vertices, and say how many moved visibly, and how far."""
    return pgettext_rpt(
        "{vertices:,} vertices, moved {moved:,}, largest move {largest:.2g} edge lengths"
    ).format(
        vertices=sum(len(result.positions) for result in results),
        moved=sum(result.moved for result in results),
        largest=max(result.largest_move for result in results),
    )


def notes(objects: list[bpy.types.Object], parameters: Any) -> str:
    """Say what was left as it is although it shapes what is seen.

    Parameters
    ----------
    objects : list of bpy.types.Object
    parameters : object
        Has `output`, `custom_normals` and `mark_sharp`.
    """
    found = []
    if any(obj.modifiers for obj in objects):
        found.append(pgettext_rpt("Modifiers were left in place and act on the new shape."))
    if parameters.custom_normals == "KEEP" and any(obj.data.has_custom_normals for obj in objects):
        found.append(
            pgettext_rpt(
                "Custom normals were kept; choose Recompute or Clear if the shading looks wrong."
            )
        )
    if parameters.mark_sharp and any(_is_flat(obj.data) for obj in objects):
        found.append(pgettext_rpt("Sharp marks show on smooth faces only; use Shade Smooth."))
    for obj in objects if parameters.output == "MESH" else []:
        key = obj.active_shape_key
        if key is not None and key.value == 0.0 and not _shows_key(obj, key):
            text = pgettext_rpt(
                "The value of the shape key {name} is 0; raise it to see the change."
            )
            found.append(text.format(name=key.name))
    return " ".join(found)


def _is_flat(mesh: bpy.types.Mesh) -> bool:
    import numpy as np

    flags = np.empty(len(mesh.polygons), dtype=bool)
    mesh.polygons.foreach_get("use_smooth", flags)
    return not flags.any()


def _shows_key(obj: bpy.types.Object, key: bpy.types.ShapeKey) -> bool:
    """Whether an object shows its active shape key whatever its value is."""
    keys = obj.data.shape_keys
    alone = obj.show_only_shape_key or obj.mode == "EDIT"
    return key == keys.reference_key or not keys.use_relative or alone


CLASSES = (SHOCK_FILTER_OT_sharpen_geometry,)
