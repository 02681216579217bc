# SPDX-License-Identifier: GPL-3.0-or-later
"""An image that materials show instead of another one, while a preview lasts."""

from __future__ import annotations

from contextlib import nullcontext

import bpy
import numpy as np
import numpy.typing as npt

from . import arrays, meshes
from .images import new_like
from .materials import image_nodes

_NAME = ".shock_filter preview"  # lists leave such names out
_INTERVAL = 0.2

_ORIGINAL = "shock_filter_original"
"""The image that it stands for: files that are saved by themselves, and undo, may hold both."""


class StandIn:
    """Shows pixels in all materials that show an image, until `end`; the image stays as it is.

    Parameters
    ----------
    image : bpy.types.Image
        Without UDIM tiles.
    """

    def __init__(self, image: bpy.types.Image) -> None:
        self._image = image.session_uid
        self._stand_in = _new(image).session_uid

    @property
    def is_there(self) -> bool:
        """Whether it can be shown: undo and `put_away` take it away."""
        stand_in = _find(self._stand_in)
        return _find(self._image) is not None and stand_in is not None and _ORIGINAL in stand_in

    def show(self, pixels: npt.NDArray[np.float32]) -> None:
        """Show these pixels."""
        image, stand_in = _find(self._image), _find(self._stand_in)
        if image is None or stand_in is None:
            return
        arrays.write_pixels(stand_in, pixels)
        stand_in.update()
        stand_in.update_tag()
        _replace(image, stand_in)

    def show_before(self) -> None:
        """Show the image itself."""
        image, stand_in = _find(self._image), _find(self._stand_in)
        if stand_in is not None:
            _replace(stand_in, image)

    def end(self) -> None:
        """Show the image itself from now on."""
        self.show_before()
        stand_in = _find(self._stand_in)
        if stand_in is not None:
            _remove(stand_in)


def put_away() -> None:
    """Show the images themselves instead of all that stands for them, whoever has made it."""
    for stand_in in [image for image in bpy.data.images if _ORIGINAL in image]:
        _replace(stand_in, stand_in[_ORIGINAL])
        _remove(stand_in)


def _remove(stand_in: bpy.types.Image) -> None:
    """Remove it, as soon as no material's icon is drawn: Blender crashes if its image goes."""
    if _ORIGINAL in stand_in:
        del stand_in[_ORIGINAL]
    uid = stand_in.session_uid

    def remove() -> float | None:
        if bpy.app.is_job_running("RENDER_PREVIEW"):
            return _INTERVAL
        if (image := _find(uid)) is not None:
            bpy.data.images.remove(image)
        return None

    if remove() is not None:
        bpy.app.timers.register(remove, first_interval=_INTERVAL)


def _new(image: bpy.types.Image) -> bpy.types.Image:
    stand_in = new_like(image, _NAME, image.size)
    stand_in[_ORIGINAL] = image
    return stand_in


def is_shown(obj: bpy.types.Object, image: bpy.types.Image) -> bool:
    """Whether a material of an object shows an image that a stand-in can be shown for."""
    materials = [slot.material for slot in obj.material_slots if slot.material is not None]
    return image.source != "TILED" and any(_nodes(materials, image))


def _replace(old: bpy.types.Image, new: bpy.types.Image | None) -> None:
    nodes = _nodes(list(bpy.data.materials), old)
    if not nodes:
        return
    # Texture Paint Mode looks for the materials' images when it is entered, if it paints on these.
    paint = bpy.context.tool_settings.image_paint
    is_painting = bpy.context.mode == "PAINT_TEXTURE" and paint.mode == "MATERIAL"
    with meshes.object_mode(bpy.context) if is_painting else nullcontext():
        for node in nodes:
            node.image = new
    if paint.canvas == old:
        paint.canvas = new


def _nodes(
    materials: list[bpy.types.Material], image: bpy.types.Image
) -> list[bpy.types.ShaderNodeTexImage]:
    return [
        node
        for material in materials
        if material.library is None
        for node in image_nodes(material)
        if node.image == image and node.id_data.library is None
    ]


def _find(uid: int) -> bpy.types.Image | None:
    return next((image for image in bpy.data.images if image.session_uid == uid), None)
