# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators Denoise, for meshes and their colors, and Denoise Image."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import bpy

from ..core.settings import BeltramiGeometrySettings, BeltramiMeshSettings, BeltramiSettings
from .color_data import check_unchanged, read_colors, write_colors
from .denoising import (
    Both,
    Denoising,
    PaintedSurface,
    denoise_both,
    denoise_colors,
    denoise_picture,
    denoise_shape,
)
from .geometry_data import read_geometry, write_geometry
from .geometry_operator import describe_moves, notes
from .image_operator import ImageOperator
from .masks import color_mask
from .mesh_data import Target, find
from .operators import Filter, MeshOperator, counted
from .properties import (
    COLOR_PREFIX,
    DenoiseImageProperties,
    DenoiseProperties,
    denoise_names,
    settings_from,
)
from .recolored import Recolored, describe

_ADVICE = "for more noise raise Time or lower Beta"


def read_both(
    obj: bpy.types.Object, mode: str, parameters: Any
) -> tuple[tuple[str, str], PaintedSurface]:
    """Read shape and colors; parameters are those of `read_geometry` and `read_colors`."""
    output, shape = read_geometry(obj, mode, parameters)
    attribute, paint = read_colors(obj, mode, parameters)
    mask, _ = color_mask(obj, mode, "POINT", parameters)
    return (output, attribute), PaintedSurface(replace(shape, mask=mask), paint)


def write_both(target: Target, result: Both) -> bpy.types.Object:
    """Write shape and colors, or raise `Skipped` before either is written."""
    output, attribute = target.place
    paint = replace(target, place=attribute, surface=target.surface.paint)
    check_unchanged(find(target), paint)
    _write_shape(replace(target, place=output, surface=target.surface.shape), result.shape)
    return write_colors(paint, result.paint)


_write_shape = partial(write_geometry, key_name="Denoised")


@dataclass(frozen=True)
class _Work:
    """What differs between the targets; `settings` have names that begin with `prefix`."""

    settings: type
    prefix: str
    read: Callable[[bpy.types.Object, str, Any], tuple]
    filter: Callable[..., Any]
    write: Callable[[Target, Any], bpy.types.Object]


_WORK = {
    "geometry": _Work(BeltramiGeometrySettings, "", read_geometry, denoise_shape, _write_shape),
    "colors": _Work(BeltramiMeshSettings, COLOR_PREFIX, read_colors, denoise_colors, write_colors),
    "both": _Work(BeltramiMeshSettings, COLOR_PREFIX, read_both, denoise_both, write_both),
}


class SHOCK_FILTER_OT_denoise(MeshOperator, DenoiseProperties, bpy.types.Operator):
    """Remove noise from meshes and their colors; creases and edges between colors stay"""

    bl_idname = "shock_filter.denoise"
    bl_label = "Denoise"
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    mode = "denoise"

    @property
    def read_object(self) -> Callable[[bpy.types.Object, str, Any], tuple]:
        """Read what the target asks for."""
        return _WORK[self.target].read

    @property
    def filter_surface(self) -> Callable[..., Any]:
        """Denoise what the target asks for."""
        return _WORK[self.target].filter

    @property
    def write_object(self) -> Callable[[Target, Any], bpy.types.Object]:
        """Write what the target asks for."""
        return _WORK[self.target].write

    def read_settings(self) -> Denoising:
        """Read those of the target."""
        work = _WORK[self.target]
        return _denoising(settings_from(work.settings, self, work.prefix), self)

    def draw(self, context: bpy.types.Context) -> None:
        """Show the target's parameters after the run."""
        column = self.layout.column()
        column.use_property_split = True
        for name in denoise_names(self.target):
            column.prop(self, name)

    def summary(self, written: list[tuple], seconds: float) -> str:
        """Count meshes, and what has changed of them."""
        results = [result for _, result in written]
        meshes, things = counted(len(written), "mesh", "meshes"), "colors"
        if self.target == "geometry":
            changes = describe_moves(results)
        elif self.target == "colors":
            meshes, changes = f"the colors of {meshes}", describe(results, things, _ADVICE)
        else:
            meshes = f"{meshes} and {'its' if len(written) == 1 else 'their'} colors"
            paints = describe([result.paint for result in results], things, _ADVICE)
            changes = f"{describe_moves([result.shape for result in results])}; {paints}"
        return f"{_done(self)} {meshes}: {changes}, {seconds:.1f} s."

    def notes(self, written: list[tuple]) -> str:
        """Name modifiers and custom normals, where vertices have moved."""
        return "" if self.target == "colors" else notes([obj for obj, _ in written])


class SHOCK_FILTER_OT_denoise_image(ImageOperator, DenoiseImageProperties, bpy.types.Operator):
    """Remove noise from an image; edges stay"""

    bl_idname = "shock_filter.denoise_image"
    bl_label = "Denoise Image"
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    __annotations__ = {**DenoiseImageProperties.__annotations__, **ImageOperator.of_one_run}

    mode = "denoise_image"
    settings_type = BeltramiSettings
    suffix = "denoised"

    def read_settings(self) -> Denoising:
        """Read the kernel's settings, and the sharpening's time."""
        return _denoising(super().read_settings(), self)

    def filter(self, settings: Denoising) -> Filter:
        """Denoise one image."""
        return lambda picture, progress: denoise_picture(picture, settings, progress)

    def done(self) -> str:
        """Say what was done."""
        return _done(self)

    def changes(self, result: Recolored) -> str:
        """Say how much has changed."""
        return describe([result], "pixels", _ADVICE)


def _denoising(kernel: Any, operator: bpy.types.Operator) -> Denoising:
    return Denoising(kernel, operator.sharpen_time if operator.then_sharpen else None)


def _done(operator: bpy.types.Operator) -> str:
    return "Denoised and sharpened" if operator.then_sharpen else "Denoised"


CLASSES = (SHOCK_FILTER_OT_denoise, SHOCK_FILTER_OT_denoise_image)
