# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator Sharpen Geometry."""

from __future__ import annotations

import bpy

from ..core.settings import GeometrySettings
from .geometry_data import read_geometry, write_geometry
from .operators import MeshOperator, counted
from .properties import GeometryProperties
from .sharpening import Sharpened, sharpen

_HARDLY_SEEN = 0.02  # mean edge lengths


class SHOCK_FILTER_OT_sharpen_geometry(MeshOperator, GeometryProperties, bpy.types.Operator):
    """Turn rounded creases into sharp ones: normals flow towards the creases, positions follow"""

    bl_idname = "shock_filter.sharpen_geometry"
    bl_label = "Sharpen Geometry"
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    mode = "geometry"
    settings_type = GeometrySettings
    read_object = staticmethod(read_geometry)
    filter_surface = staticmethod(sharpen)
    write_object = staticmethod(write_geometry)

    def summary(self, written: list[tuple], seconds: float) -> str:
        """Count meshes and vertices."""
        results = [result for _, result in written]
        text = (
            f"Sharpened {counted(len(written), 'mesh', 'meshes')}: {describe_moves(results)},"
            f" {seconds:.1f} s."
        )
        if max(result.largest_move for result in results) < _HARDLY_SEEN:
            text += " For wide or gentle creases raise Time or lower Feature Threshold."
        return text

    def notes(self, written: list[tuple]) -> str:
        """Name modifiers and custom normals."""
        return notes([obj for obj, _ in written])


def describe_moves(results: list[Sharpened]) -> str:
    """Count vertices, and say how many moved and how far."""
    vertices = sum(len(result.positions) for result in results)
    moved = sum(result.moved for result in results)
    largest = max(result.largest_move for result in results)
    return f"{vertices:,} vertices, moved {moved:,}, largest move {largest:.2g} edge lengths"


def notes(objects: list[bpy.types.Object]) -> str:
    """Say what was left as it is although it shapes what is seen."""
    found = []
    if any(obj.modifiers for obj in objects):
        found.append("Modifiers were left in place and act on the new shape.")
    if any(obj.data.has_custom_normals for obj in objects):
        found.append("Custom normals were kept; clear them if the shading looks wrong.")
    return " ".join(found)


CLASSES = (SHOCK_FILTER_OT_sharpen_geometry,)
