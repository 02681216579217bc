# SPDX-License-Identifier: GPL-3.0-or-later
"""What a run would work on, how long it would take, and how long the last one took.

All of this is asked for at each redraw, so it only counts: nothing is read from meshes or images.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import bpy

from ...core.base.cores import thread_count
from ...core.errors import InvalidSettings
from ...core.estimate import Estimate, estimate, wall_seconds
from ...core.settings import (
    BeltramiGeometrySettings,
    BeltramiMeshSettings,
    BeltramiSettings,
    GeometrySettings,
    ImageSettings,
    ShockSettings,
    TextureSettings,
)
from .. import data
from ..data.skipped import Skipped
from . import kernels
from .properties import COLOR_PREFIX, settings_from

_MODES = {
    "SHOCK_FILTER_OT_denoise": "denoise",
    "SHOCK_FILTER_OT_denoise_image": "denoise_image",
    "SHOCK_FILTER_OT_sharpen_colors": "colors",
    "SHOCK_FILTER_OT_sharpen_geometry": "geometry",
    "SHOCK_FILTER_OT_sharpen_image": "image",
    "SHOCK_FILTER_OT_sharpen_texture": "texture",
}
"""The operators whose time is estimated."""

_SHORTEST = 0.2
"""Seconds below which a run says nothing about the machine's speed."""


class Counts(NamedTuple):
    """What would be filtered; a mesh with several users counts once."""

    meshes: int = 0
    vertices: int = 0
    faces: int = 0
    pixels: int = 0

    @property
    def size(self) -> int:
        """What the time depends on."""
        return self.pixels or self.vertices


class _History(NamedTuple):
    """The runs of one kind in this session."""

    seconds: float
    slowness: float | None = None  # how many times longer than estimated


_history: dict[str, _History] = {}


def count(context: bpy.types.Context, mode: str, settings: Any) -> Counts:
    """Count what a run in this mode would work on.

    Parameters
    ----------
    context : bpy.types.Context
    mode : str
        A key of `properties.NAMES`.
    settings : bpy.types.PropertyGroup or bpy.types.Operator
        The mode's settings.
    """
    if mode in {"image", "denoise_image"}:
        return Counts(pixels=_pixels(data.edited_image(context)))
    found = {obj.data.session_uid: obj.data for obj in data.mesh_objects(context)}.values()
    meshes = [mesh for mesh in found if mesh.polygons or mesh.is_editmode]
    counts = Counts(
        meshes=len(meshes),
        vertices=sum(len(mesh.vertices) for mesh in meshes),
        faces=sum(len(mesh.polygons) for mesh in meshes),
    )
    if mode == "texture" and meshes:
        pixels = _pixels(_texture(context, settings))
        return counts._replace(pixels=pixels) if pixels else Counts()
    return counts


def expected(mode: str, settings: Any, size: int) -> Estimate | None:
    """Estimate a run on this machine, in seconds on the clock.

    None if there is nothing to do or the settings clash.

    Parameters
    ----------
    mode, settings
        As for `count`.
    size : int
        Number of pixels or vertices, as `Counts.size` says.
    """
    if not size:
        return None
    try:
        parts = [estimate(part, size) for part in _parts(mode, settings)]
    except InvalidSettings:
        return None
    seconds = wall_seconds(sum(part.seconds for part in parts), thread_count())
    return Estimate(seconds, max(part.memory for part in parts))


def corrected(mode: str, settings: Any, seconds: float) -> float:
    """Correct an estimate by the last such run in this session."""
    known = _history.get(_kind(mode, settings))
    return seconds * known.slowness if known and known.slowness else seconds


def last_seconds(mode: str, settings: Any) -> float | None:
    """Return how long the last such run in this session took, if there was one."""
    known = _history.get(_kind(mode, settings))
    return known.seconds if known else None


def compiles(mode: str, settings: Any) -> bool:
    """Whether the next such run has to compile its kernels, as far as is known."""
    return not kernels.has_run(_kind(mode, settings))


def learn(operator: bpy.types.Operator, seconds: float) -> None:
    """Remember how long an operator's run took, beside what was expected.

    The first run of a kind corrects nothing: it may have compiled the kernels.
    """
    mode = _MODES.get(operator.bl_idname)
    if mode is None:
        return
    kind = _kind(mode, operator)
    kernels.remember_run(kind)
    if kind not in _history:
        _history[kind] = _History(seconds)
        return
    slowness = _history[kind].slowness
    guess = expected(mode, operator, sum(target.surface.size for target in operator.targets))
    if guess is not None and seconds > _SHORTEST:
        slowness = seconds / guess.seconds
    _history[kind] = _History(seconds, slowness)


def forget() -> None:
    """Forget all runs."""
    _history.clear()


def _kind(mode: str, settings: Any) -> str:
    """Tell runs apart that take times of their own."""
    return f"{mode} {settings.target}" if mode == "denoise" else mode


def _parts(mode: str, settings: Any) -> list[Any]:
    if mode == "geometry":
        return [settings_from(GeometrySettings, settings)]
    if mode == "colors":
        return [settings_from(ShockSettings, settings)]
    if mode == "texture":
        return [settings_from(TextureSettings, settings)]
    if mode == "image":
        return [settings_from(ImageSettings, settings)]
    parts: list[Any]
    if mode == "denoise_image":
        parts, sharpening = [settings_from(BeltramiSettings, settings)], [ImageSettings]
    elif settings.target == "geometry":
        parts, sharpening = [settings_from(BeltramiGeometrySettings, settings)], [GeometrySettings]
    else:
        parts = [settings_from(BeltramiMeshSettings, settings, COLOR_PREFIX)]
        sharpening = [ShockSettings] + [GeometrySettings] * (settings.target == "both")
    if settings.then_sharpen:
        parts += [sharpen(time=settings.sharpen_time) for sharpen in sharpening]
    return parts


def _texture(context: bpy.types.Context, settings: Any) -> bpy.types.Image | None:
    try:
        return data.chosen_image(context, settings.image)
    except Skipped:
        return None


def _pixels(image: bpy.types.Image | None) -> int:
    if image is None:
        return 0
    if image.source == "TILED":
        return sum(math.prod(tile.size) for tile in image.tiles)
    return math.prod(image.size)
