# SPDX-License-Identifier: GPL-3.0-or-later
"""The place under the mouse or in the middle of a view, and editors that show an image."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from ..running.jobs import holds


def pointed_at(
    context: bpy.types.Context, event: bpy.types.Event
) -> tuple[bpy.types.Region, tuple[float, float]]:
    """Find the place under the mouse, in the main region of an area.

    Returns
    -------
    region : bpy.types.Region
    place : tuple of float
        In pixels from its lower left corner; its middle if the mouse is on a panel.
    """
    view = next(region for region in context.area.regions if region.type == "WINDOW")
    if holds(view, event.mouse_x, event.mouse_y) and is_over_view(context.area, event):
        return view, (event.mouse_x - view.x, event.mouse_y - view.y)
    return view, (view.width / 2, view.height / 2)


def is_over_view(area: bpy.types.Area | None, event: bpy.types.Event) -> bool:
    """Whether the mouse is over an area's main regions, and not on a panel; True without one."""
    if area is None:
        return True
    # Not by the context's region: Blender runs a sidebar's buttons as if the mouse were outside.
    # A mouse that is held in the area comes in again at the other side, and is counted on.
    x = area.x + (event.mouse_x - area.x) % area.width
    held = [region.type for region in area.regions if holds(region, x, event.mouse_y)]
    return bool(held) and all(kind == "WINDOW" for kind in held)


def editors_of(image_uid: int) -> Iterator[bpy.types.Area]:
    """List the Image Editors that show an image."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "IMAGE_EDITOR" and is_shown_in(image_uid, area.spaces.active):
                yield area


def views_with_textures() -> Iterator[bpy.types.Area]:
    """List the 3D views whose shading shows textures."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D" and _shows_textures(area.spaces.active.shading):
                yield area


def _shows_textures(shading: bpy.types.View3DShading) -> bool:
    is_solid = shading.type == "SOLID" and shading.color_type == "TEXTURE"
    # In Texture Paint Mode, plain shading does, too.
    is_painted = shading.type == "SOLID" and bpy.context.mode == "PAINT_TEXTURE"
    return is_solid or is_painted or shading.type in {"MATERIAL", "RENDERED"}


def is_shown_in(image_uid: int, space: bpy.types.SpaceImageEditor) -> bool:
    """Whether an Image Editor shows an image."""
    return space.image is not None and space.image.session_uid == image_uid
