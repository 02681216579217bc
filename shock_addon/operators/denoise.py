# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators Denoise, for meshes and their colors, and Denoise Image."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt

from ...core import host as filters
from ...core.settings import BeltramiGeometrySettings, BeltramiMeshSettings, BeltramiSettings
from .. import data
from .base import Filter, MeshOperator, Steps, counted, describe_colors
from .geometry import describe_moves, notes
from .images import ImageOperator
from .properties import (
    COLOR_PREFIX,
    DenoiseImageProperties,
    DenoiseProperties,
    settings_from,
    shortest,
)

_ADVICE = "for more noise raise Time or lower Keep Edges"


def read_both(
    obj: bpy.types.Object, mode: str, parameters: Any
) -> tuple[tuple[data.Place, str], filters.PaintedSurface]:
    """Read shape and colors; parameters are those of `read_geometry` and `read_colors`."""
    place, shape = data.read_geometry(obj, mode, parameters)
    attribute, paint = data.read_colors(obj, mode, parameters)
    return (place, attribute), filters.PaintedSurface(shape, paint)


def write_both(target: data.Target, result: filters.Both) -> bpy.types.Object:
    """Write shape and colors, or raise `Skipped` before either is written."""
    place, attribute = target.place
    paint = replace(target, place=attribute, surface=target.surface.paint)
    data.check_unchanged(data.find(target), paint)
    _write_shape(replace(target, place=place, surface=target.surface.shape), result.shape)
    return data.write_colors(paint, result.paint)


def _write_shape(target: data.Target, result: filters.Sharpened) -> bpy.types.Object:
    return data.write_geometry(target, result, key_name="Denoised")


SETTINGS = {
    "geometry": (BeltramiGeometrySettings, ""),
    "colors": (BeltramiMeshSettings, COLOR_PREFIX),
    "both": (BeltramiMeshSettings, COLOR_PREFIX),
}
"""The settings of each target, and what the names of their properties begin with."""


def steps_of(target: str) -> Steps:
    """Choose by the target how an object is read, filtered and written."""
    if target == "geometry":
        return Steps(data.read_geometry, filters.denoise_shape, _write_shape)
    if target == "colors":
        return Steps(data.read_colors, filters.denoise_colors, data.write_colors)
    return Steps(read_both, filters.denoise_both, write_both)


class SHOCK_FILTER_OT_denoise(MeshOperator, DenoiseProperties, bpy.types.Operator):
    """Remove noise from meshes and their colors; creases and edges between colors stay"""

    bl_idname = "shock_filter.denoise"
    bl_label = "Denoise"
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    mode = "denoise"

    def steps(self) -> Steps:
        """Denoise what the target asks for."""
        return steps_of(self.target)

    def read_settings(self) -> filters.Denoising:
        """Read those of the target."""
        return denoise_settings(self)

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

    def read_settings(self) -> filters.Denoising:
        """Read the kernel's settings, and the sharpening's time."""
        return denoising(super().read_settings(), self)

    def filter(self, settings: filters.Denoising) -> Filter:
        """Denoise one image."""
        return lambda picture, progress: filters.denoise_picture(picture, settings, progress)

    def done(self) -> str:
        """Say what was done."""
        return _done(self)

    def changes(self, result: filters.Recolored) -> str:
        """Say how much has changed."""
        return describe_colors([result], "pixels", _ADVICE)


def denoise_settings(parameters: Any) -> filters.Denoising:
    """Read the target's settings from the properties of the operator or of the panel."""
    kind, prefix = SETTINGS[parameters.target]
    return denoising(settings_from(kind, parameters, prefix), parameters)


def denoising(kernel: Any, parameters: Any) -> filters.Denoising:
    """Add to the kernel's settings those of the sharpening that may follow."""
    time = shortest(parameters.sharpen_time) if parameters.then_sharpen else None
    return filters.Denoising(kernel, time)


def _done(operator: bpy.types.Operator) -> str:
    return pgettext_rpt("Denoised and sharpened" if operator.then_sharpen else "Denoised")


CLASSES = (SHOCK_FILTER_OT_denoise, SHOCK_FILTER_OT_denoise_image)
