# SPDX-License-Identifier: GPL-3.0-or-later
"""Read and write the shape and the colors of mesh objects together."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import bpy

from ....core.host.inputs import PaintedSurface
from .colors import check_unchanged, read_colors, write_colors
from .geometry import Place, read_geometry, write_geometry
from .targets import MeshTarget, find


def read_painted(
    obj: bpy.types.Object, object_mode: str, parameters: Any
) -> tuple[tuple[Place, str], PaintedSurface]:
    """Read shape and colors; parameters are those of `read_geometry` and `read_colors`."""
    place, shape = read_geometry(obj, object_mode, parameters)
    attribute, paint = read_colors(obj, object_mode, parameters)
    return (place, attribute), PaintedSurface(shape, paint)


def split(target: MeshTarget) -> tuple[MeshTarget, MeshTarget]:
    """Return the targets of the shape and of the colors."""
    place, attribute = target.place
    return (
        replace(target, place=place, surface=target.surface.shape),
        replace(target, place=attribute, surface=target.surface.paint),
    )


def write_painted(target: MeshTarget, result: Any, key_name: str) -> bpy.types.Object:
    """Write shape and colors, or raise `Skipped` before either is written."""
    shape, paint = split(target)
    check_unchanged(find(target), paint)
    write_geometry(shape, result.shape, key_name)
    return write_colors(paint, result.paint)
