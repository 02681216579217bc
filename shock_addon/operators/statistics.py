# SPDX-License-Identifier: GPL-3.0-or-later
"""Statistics of the input of a run, and the speed of the last run.

They are computed at each redraw, so elements are counted and no data is read.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import bpy

from .. import data
from ..data.skipped import Skipped
from ..modes import Mode
from . import poll


class Counts(NamedTuple):
    """The amount of input; a mesh with several users counts once.

    If visible shapes are filtered, they count with modifiers.
    """

    meshes: int = 0
    vertices: int = 0
    faces: int = 0
    pixels: int = 0

    @property
    def size(self) -> int:
        """Return the number of elements that the time depends on."""
        return self.pixels or self.vertices


class Run(NamedTuple):
    """The size of a run, in vertices or pixels, how many of these were filtered, and its time.

    Texels beside the charts, and what a mask leaves out, are not filtered.
    """

    size: int
    filtered: int
    seconds: float


_last: dict[tuple[str, str], Run] = {}
"""The last run of each operator and target in this session."""


def count(context: bpy.types.Context, mode: Mode, settings: Any) -> Counts:
    """Count the input of a run in this mode.

    Parameters
    ----------
    context : bpy.types.Context
    mode : Mode
    settings : bpy.types.PropertyGroup or bpy.types.Operator
        The mode's settings.
    """
    if not mode.data.on_surface:
        return Counts(pixels=_pixels(data.chosen.edited_image(context)))
    image = data.chosen.edited_image(context)
    is_film = mode.data.handled_as == "films"
    if is_film and image is not None:
        return Counts(pixels=_pixels(image))
    found = _meshes(context, mode, settings).values()
    meshes = [mesh for mesh in found if mesh.polygons or mesh.is_editmode]
    counts = Counts(
        meshes=len(meshes),
        vertices=sum(len(mesh.vertices) for mesh in meshes),
        faces=sum(len(mesh.polygons) for mesh in meshes),
    )
    if mode.data.in_images and meshes and not is_film:
        pixels = _pixels(_texture(context, settings))
        return counts._replace(pixels=pixels) if pixels else Counts()
    return counts


def basis(context: bpy.types.Context, mode: Mode, settings: Any) -> str:
    """Say whether objects with modifiers count with these; empty if there are none."""
    if not mode.data.on_surface:
        return ""
    objects = [obj for obj in data.chosen.mesh_objects(context) if _has_modifiers(obj)]
    seen = [obj for obj in objects if _is_seen(context, mode, settings, obj)]
    if not objects:
        return ""
    if not seen:
        return "Counted without modifiers, as it is filtered."
    if len(seen) == len(objects):
        return "Counted with modifiers, as it is seen and filtered."
    return "Counted with modifiers where new objects are made, else without."


def learn(operator: bpy.types.Operator, filtered: int, seconds: float) -> None:
    """Store the time of an operator's run, its size, and how much was filtered."""
    size = sum(target.surface.size for target in operator.targets)
    _last[operator.bl_idname, operator.row.target(operator).key] = Run(size, filtered, seconds)


def last_run(mode: Mode, settings: Any) -> Run | None:
    """Return the last run of an operator and target in this session, if any."""
    name = f"SHOCK_FILTER_OT_{mode.operator}"
    return _last.get((name, mode.target(settings).key))


def forget() -> None:
    """Forget all runs."""
    _last.clear()


def _meshes(
    context: bpy.types.Context, mode: Mode, settings: Any
) -> dict[tuple[bool, int], bpy.types.Mesh]:
    # Objects with the same mesh may look different.
    found = {}
    for obj in data.chosen.mesh_objects(context):
        if _is_seen(context, mode, settings, obj):
            found[True, obj.session_uid] = _seen(context, obj)
        else:
            found[False, obj.data.session_uid] = obj.data
    return found


def _is_seen(context: bpy.types.Context, mode: Mode, settings: Any, obj: bpy.types.Object) -> bool:
    is_mesh = mode.data.handled_as == "meshes" and context.mode == "OBJECT"
    return is_mesh and len(obj.modifiers) > 0 and poll.makes_object(mode, settings, obj)


def _seen(context: bpy.types.Context, obj: bpy.types.Object) -> bpy.types.Mesh:
    # What was evaluated last: drawing must not evaluate. The mesh of a live copy is its source's.
    graph = context.view_layer.depsgraph
    if graph is None or data.chosen.live_source(obj) is not None:
        return obj.data
    return obj.evaluated_get(graph).data


def _has_modifiers(obj: bpy.types.Object) -> bool:
    live = data.chosen.live_modifiers(obj)
    return any(each.show_viewport and each not in live for each in obj.modifiers)


def _texture(context: bpy.types.Context, settings: Any) -> bpy.types.Image | None:
    try:
        return data.chosen.chosen_image(context, settings.image)
    except Skipped:
        return None


def _pixels(image: bpy.types.Image | None) -> int:
    if image is None:
        return 0
    if image.source == "TILED":
        return sum(math.prod(tile.size) for tile in image.tiles)
    return math.prod(image.size)
