# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators Denoise, for meshes and their colors, and Denoise Image."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt

from ..core.settings import BeltramiGeometrySettings, BeltramiMeshSettings, BeltramiSettings
from .data.color_data import check_unchanged, read_colors, write_colors
from .data.geometry_data import Place, read_geometry, write_geometry
from .data.mesh_data import Target, find
from .filters.denoising import (
    Both,
    Denoising,
    PaintedSurface,
    denoise_both,
    denoise_colors,
    denoise_picture,
    denoise_shape,
)
from .filters.recolored import Recolored
from .geometry_operator import describe_moves, notes
from .image_operator import ImageOperator
from .operators import Filter, MeshOperator, counted, describe_colors
from .properties import (
    COLOR_PREFIX,
    DenoiseImageProperties,
    DenoiseProperties,
    denoise_names,
    settings_from,
)

_ADVICE = "for more noise raise Time or lower Keep Edges"


def read_both(
    obj: bpy.types.Object, mode: str, parameters: Any
) -> tuple[tuple[Place, str], PaintedSurface]:
    """Read shape and colors; parameters are those of `read_geometry` and `read_colors`."""
    place, shape = read_geometry(obj, mode, parameters)
    attribute, paint = read_colors(obj, mode, parameters)
    return (place, attribute), PaintedSurface(shape, paint)


def write_both(target: Target, result: Both) -> bpy.types.Object:
    """Write shape and colors, or raise `Skipped` before either is written."""
    place, attribute = target.place
    paint = replace(target, place=attribute, surface=target.surface.paint)
    check_unchanged(find(target), paint)
    _write_shape(replace(target, place=place, surface=target.surface.shape), result.shape)
    return write_colors(paint, result.paint)


_write_shape = partial(write_geometry, key_name="Denoised")


@dataclass(frozen=True)
class Work:
    """What differs between the targets; `settings` have names that begin with `prefix`."""

    settings: type
    prefix: str
    read: Callable[[bpy.types.Object, str, Any], tuple]
    filter: Callable[..., Any]
    write: Callable[[Target, Any], bpy.types.Object]


WORK = {
    "geometry": Work(BeltramiGeometrySettings, "", read_geometry, denoise_shape, _write_shape),
    "colors": Work(BeltramiMeshSettings, COLOR_PREFIX, read_colors, denoise_colors, write_colors),
    "both": Work(BeltramiMeshSettings, COLOR_PREFIX, read_both, denoise_both, write_both),
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
        return WORK[self.target].read

    @property
    def filter_surface(self) -> Callable[..., Any]:
        """Denoise what the target asks for."""
        return WORK[self.target].filter

    @property
    def write_object(self) -> Callable[[Target, Any], bpy.types.Object]:
        """Write what the target asks for."""
        return WORK[self.target].write

    def read_settings(self) -> Denoising:
        """Read those of the target."""
        return denoise_settings(self)

    def draw(self, context: bpy.types.Context) -> None:
        """Show the target's parameters after the run."""
        column = self.layout.column()
        column.use_property_split = True
        for name in denoise_names(self.target):
            column.prop(self, name)

    def summary(self, written: list[tuple], seconds: float) -> str:
        """Count meshes, and what has changed of them."""
        results = [result for _, result in written]
        meshes = counted(len(written), "1 mesh", "{:,} meshes")
        if self.target == "geometry":
            changes = describe_moves(results)
        elif self.target == "colors":
            meshes = pgettext_rpt("the colors of {meshes}").format(meshes=meshes)
            changes = describe_colors(results, "colors", _ADVICE)
        else:
            meshes = counted(len(written), "1 mesh and its colors", "{:,} meshes and their colors")
            paints = describe_colors([result.paint for result in results], "colors", _ADVICE)
            changes = f"{describe_moves([result.shape for result in results])}; {paints}"
        return pgettext_rpt("{done} {meshes}: {changes}, {seconds:.1f} s.").format(
            done=_done(self), meshes=meshes, changes=changes, seconds=seconds
        )

    def notes(self, written: list[tuple]) -> str:
        """Say what shapes what is seen beside the vertices, where these have moved."""
        return "" if self.target == "colors" else notes([obj for obj, _ in written], self)


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
        return describe_colors([result], "pixels", _ADVICE)


def denoise_settings(parameters: Any) -> Denoising:
    """Read the target's settings from the properties of the operator or of the panel."""
    work = WORK[parameters.target]
    return _denoising(settings_from(work.settings, parameters, work.prefix), parameters)


def _denoising(kernel: Any, operator: bpy.types.Operator) -> Denoising:
    return Denoising(kernel, operator.sharpen_time if operator.then_sharpen else None)


def _done(operator: bpy.types.Operator) -> str:
    return pgettext_rpt("Denoised and sharpened" if operator.then_sharpen else "Denoised")


CLASSES = (SHOCK_FILTER_OT_denoise, SHOCK_FILTER_OT_denoise_image)
