# SPDX-License-Identifier: GPL-3.0-or-later
"""Painting on an image in Texture Paint Mode."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any

import bpy

from .textures import uv_layer


def paint_on(
    context: bpy.types.Context,
    image: bpy.types.Image,
    texture: bpy.types.Image,
    undo: ExitStack | None = None,
) -> None:
    """Let brushes paint on an image, on the model, and show the materials.

    Parameters
    ----------
    context : bpy.types.Context
    image : bpy.types.Image
    texture : bpy.types.Image
        The image whose texels it shares. Its UV map in the materials becomes the active one, which
        brushes use.
    undo : ExitStack, optional
        Collects callbacks that restore everything.
    """
    undo = ExitStack() if undo is None else undo  # which is not closed
    paint = context.tool_settings.image_paint
    keep(undo, paint, "canvas", "mode")
    paint.mode, paint.canvas = "IMAGE", image
    layer, layers = uv_layer(context.object, texture), context.object.data.uv_layers
    if layer is not None and layer != layers.active:
        keep(undo, layers, "active_index")
        layers.active = layer
    mode = context.object.mode
    if mode != "TEXTURE_PAINT":
        undo.callback(lambda: bpy.ops.object.mode_set(mode=mode))
        bpy.ops.object.mode_set(mode="TEXTURE_PAINT")
    shading = getattr(context.space_data, "shading", None)
    if shading is None or shading.type not in {"SOLID", "WIREFRAME"}:
        return
    keep(undo, shading, "color_type", "type")
    try:
        shading.type = "MATERIAL"
    except TypeError:  # Workbench has none, nor have other engines
        shading.type, shading.color_type = "SOLID", "TEXTURE"


def keep(undo: ExitStack, owner: Any, *names: str) -> None:
    """Let `undo` set properties back."""
    for name in names:
        undo.callback(setattr, owner, name, getattr(owner, name))
