# SPDX-License-Identifier: GPL-3.0-or-later
"""Which mode the panel shows: the one that was chosen, or one that fits the selection."""

from __future__ import annotations

import bpy

from .. import data
from ..modes import Mode, find, job_of

_FITTING = {"PAINT_VERTEX": "colors", "PAINT_TEXTURE": "texture"}
"""The modes that fit object modes, before one is chosen."""

_asked = False
"""Whether a mode was chosen that no panel has shown yet."""

_objects: frozenset[int] = frozenset()
"""The uids of the mesh objects that were selected then."""

_object_mode = ""
"""The object mode then."""


def was_chosen(settings: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    """Note that a mode was chosen, with the current selection."""
    global _asked
    _asked = True


def mode(context: bpy.types.Context, choice: str) -> Mode:
    """Return the mode that the panel shows.

    It is the chosen one. A texture without a UV map, and a mode that has a panel of its own, give
    way to what fits the object mode, and so does a texture while vertices are painted, or another
    mode while a texture is; but what is chosen now is shown.

    Parameters
    ----------
    context : bpy.types.Context
    choice : str
        ``"mode"`` in the 3D view, ``"image_mode"`` in the Image Editor.
    """
    global _asked, _objects, _object_mode
    objects = data.chosen.mesh_objects(context)
    if _asked:
        _asked, _objects = False, frozenset(obj.session_uid for obj in objects)
        _object_mode = context.mode
    settings = context.scene.shock_filter
    chosen = find(getattr(settings, choice).lower())
    is_unwrapped = any(obj.data.uv_layers for obj in objects)
    if job_of(choice, chosen) is None or not settings.is_property_set(choice):
        return _fitting(context, choice, is_unwrapped)
    is_known = _objects == {obj.session_uid for obj in objects}
    if chosen.data.handled_as == "textures" and not is_unwrapped and not is_known:
        return _fitting(context, choice, is_unwrapped)
    is_painted = choice == "mode" and context.mode in _FITTING and context.mode != _object_mode
    if is_painted and (chosen.data.handled_as == "textures") != (context.mode == "PAINT_TEXTURE"):
        return _fitting(context, choice, is_unwrapped)
    return chosen


def _fitting(context: bpy.types.Context, choice: str, is_unwrapped: bool) -> Mode:
    if choice == "image_mode":
        return find("image")
    found = find(_FITTING.get(context.mode, "geometry"))
    return found if is_unwrapped or found.key != "texture" else find("geometry")
