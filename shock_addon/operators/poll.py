# SPDX-License-Identifier: GPL-3.0-or-later
"""Reasons why nothing can be filtered now, with remedies, for buttons and panels."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt

from .. import data
from ..data.skipped import Skipped
from ..modes import Mode


def of_mode(context: bpy.types.Context, mode: Mode, settings: Any) -> str:
    """Return the obstacle for a mode's settings, which the operators' polls do not know.

    Parameters
    ----------
    context : bpy.types.Context
    mode : Mode
    settings : bpy.types.PropertyGroup
        The mode's settings.

    Returns
    -------
    str
        Empty if there is no obstacle.
    """
    handled_as = mode.data.handled_as
    if handled_as == "films":
        return of_flows(context) or _of_flow(context, settings)
    if handled_as == "images":
        return of_images(context) or _of_image(data.chosen.edited_image(context), tiles=False)
    if handled_as == "textures":
        return of_textures(context) or _of_texture(context, settings)
    if handled_as == "fields":
        return of_unwrapped(context)
    obstacle = of_meshes(context)
    seen = [obj for obj in data.chosen.mesh_objects(context) if makes_object(mode, settings, obj)]
    moves = mode.target(settings).data.moves
    if seen or (moves and mode.makes_objects(settings)):  # the evaluated object may have faces
        if context.mode != "OBJECT":
            obstacle = "New objects are made in Object Mode; go there, or choose another output."
    else:
        obstacle = obstacle or _of_links(context) or _of_faces(context)
    if not obstacle and mode.target(settings).data.paints:
        obstacle = _of_colors(context)
    return obstacle


def makes_object(mode: Mode, parameters: Any, obj: bpy.types.Object) -> bool:
    """Whether the visible shape of an object goes into a new one, by choice or by its modifiers.

    A live copy is such a new one, of its source.
    """
    if not mode.target(parameters).data.moves:
        return False  # colors stay where they are
    if mode.makes_objects(parameters):
        return True
    if makes_live(mode, parameters, obj):
        is_copy = data.chosen.live_source(obj) is not None
        return is_copy or data.chosen.modifier_on_top(obj) is not None
    is_auto = mode.makes_objects(parameters, "AUTO") and obj.mode == "OBJECT"
    return is_auto and data.chosen.modifier_on_top(obj) is not None


def makes_live(mode: Mode, parameters: Any, obj: bpy.types.Object) -> bool:
    """Whether a result stays editable, by choice or because an earlier one does."""
    if mode.makes_objects(parameters, "AUTO"):
        if not mode.target(parameters).data.moves:
            return data.chosen.is_live(obj, data.LIVE_COLORS)
        return data.chosen.is_live(obj) and data.chosen.modifier_on_top(obj) is None
    return mode.makes_objects(parameters, "LIVE")


def announcement(context: bpy.types.Context, mode: Mode, settings: Any) -> str:
    """Say before a press that new objects or live copies will be made; empty if none will.

    Parameters
    ----------
    context, mode, settings
        As in `of_mode`.
    """
    is_live = mode.makes_objects(settings, "LIVE")
    if mode.data.handled_as != "meshes" or not (is_live or mode.makes_objects(settings, "AUTO")):
        return ""
    objects = data.chosen.mesh_objects(context) if context.mode == "OBJECT" else []
    objects = [
        obj
        for obj in objects
        if makes_object(mode, settings, obj) and makes_live(mode, settings, obj) == is_live
    ]
    found = [top.name for obj in objects if (top := data.chosen.modifier_on_top(obj)) is not None]
    text = (
        "New Object: {name} is the last modifier, so the visible shape is filtered, and the"
        " original is hidden."
    )
    if is_live:
        text = (
            "Live copy: {name} is the last modifier, so the visible shape is filtered, and the"
            " original is hidden."
        )
    return pgettext_rpt(text).format(name=", ".join(dict.fromkeys(found))) if found else ""


def of_meshes(context: bpy.types.Context) -> str:
    """Return the obstacle for meshes."""
    if data.chosen.mesh_objects(context):
        return ""
    obj = context.object
    if obj is not None and obj.type in data.chosen.CONVERTIBLE:
        return "Convert the object to a mesh first (Object > Convert > Mesh)."
    return "Select a mesh object."


def of_images(context: bpy.types.Context) -> str:
    """Return the obstacle for images."""
    if data.chosen.in_image_editor(context) and context.space_data.image is None:
        return "Open an image in the Image Editor."
    return "" if bpy.data.images else "Open an image."


def of_unwrapped(context: bpy.types.Context) -> str:
    """Return the obstacle for generating an image on a surface."""
    obstacle = of_meshes(context)
    if obstacle:
        return obstacle
    if not any(obj.data.uv_layers for obj in data.chosen.mesh_objects(context)):
        return "Unwrap the mesh in Edit Mode (UV > Unwrap): it has no UV map."
    return ""


def of_textures(context: bpy.types.Context) -> str:
    """Return the obstacle for textures."""
    if not data.chosen.mesh_objects(context) and data.chosen.edited_image(context) is not None:
        return "Select a mesh object that shows this image."
    obstacle = of_unwrapped(context)
    if obstacle:
        return obstacle
    if not bpy.data.images:
        return "Add an Image Texture node with an image to the material."
    return ""


def of_flows(context: bpy.types.Context) -> str:
    """Return the obstacle for flows."""
    if data.chosen.in_image_editor(context):
        return of_images(context)
    return of_unwrapped(context) if not bpy.data.images else ""


def _of_flow(context: bpy.types.Context, settings: Any) -> str:
    image = data.chosen.edited_image(context)
    if image is None and settings.target != "map":
        obstacle = of_unwrapped(context)
        if not obstacle and settings.target == "colors":
            obstacle = _of_colors(context)
        if not obstacle and settings.target == "attribute" and not settings.field:
            obstacle = "Name an attribute of vectors or numbers."
        return obstacle
    if image is None:
        image = bpy.data.images.get(settings.image)
    if image is None:
        return "Choose a flow map, or open one in the Image Editor."
    return _of_image(data.chosen.flow_map_of(image), tiles=False)


def _of_links(context: bpy.types.Context) -> str:
    objects = data.chosen.mesh_objects(context)
    reasons = [data.chosen.mesh_refusal(obj.data) for obj in objects]
    return f"{objects[0].name}: {pgettext_rpt(reasons[0])}." if all(reasons) else ""


def _of_faces(context: bpy.types.Context) -> str:
    # Blender counts what is edited only when Edit Mode is left.
    if context.mode == "EDIT_MESH" or any(
        obj.data.polygons for obj in data.chosen.mesh_objects(context)
    ):
        return ""
    return "The mesh has no faces; add some, or select another object."


def _of_colors(context: bpy.types.Context) -> str:
    if any(obj.data.color_attributes for obj in data.chosen.mesh_objects(context)):
        return ""
    return "The mesh has no colors; paint some in Vertex Paint Mode."


def _of_texture(context: bpy.types.Context, settings: Any) -> str:
    try:
        image = data.chosen.chosen_image(context, settings.image)
    except Skipped as reason:
        return f"{data.chosen.mesh_objects(context)[0].name}: {reason}."
    return _of_image(image, tiles=True)


def _of_image(image: bpy.types.Image, tiles: bool) -> str:
    reason = data.chosen.refusal(image, tiles)
    return f"{image.name}: {pgettext_rpt(reason)}." if reason else ""
