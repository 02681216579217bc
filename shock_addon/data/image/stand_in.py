# SPDX-License-Identifier: GPL-3.0-or-later
"""An image that replaces another one in materials during a preview."""

from __future__ import annotations

from contextlib import nullcontext

import bpy
import numpy as np
import numpy.typing as npt

from .. import arrays
from ..materials import image_nodes, live_mix
from ..mesh import meshes
from ..mixes import result_of
from .images import new_like

_NAME = ".shock_filter preview"  # lists leave such names out
_INTERVAL = 0.1
_CALM = 50
"""Number of intervals without an icon being drawn before an image is removed.

If a list or a button shows an icon, Blender waits two seconds and then draws it on a thread, from a
copy of the material made at the start. Blender does not say which icons wait.
"""

_ORIGINAL = "shock_filter_original"
"""Key of the original image, for stand-ins in auto-saved files and after undo."""

_RESULT = "shock_filter_result"
"""Key of the name of the result in the node that holds it: live textures show a stand-in alone."""


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
        self._waiting: npt.NDArray[np.float32] | None = None

    @property
    def is_there(self) -> bool:
        """Whether the image still exists; undo and `put_away` remove it."""
        stand_in = _find(self._stand_in)
        return _find(self._image) is not None and stand_in is not None and _ORIGINAL in stand_in

    def show(self, pixels: npt.NDArray[np.float32]) -> None:
        """Show these pixels, as soon as no icon of a material is drawn, which would read them."""
        self._waiting = pixels
        if self._write() is not None:
            bpy.app.timers.register(self._write, first_interval=_INTERVAL)

    def _write(self) -> float | None:
        image, stand_in = _find(self._image), _find(self._stand_in)
        if self._waiting is None or image is None or stand_in is None:
            return None
        if bpy.app.is_job_running("RENDER_PREVIEW"):
            return _INTERVAL
        arrays.write_pixels(stand_in, self._waiting)
        self._waiting = None
        stand_in.update()
        stand_in.update_tag()
        _replace(image, stand_in)
        return None

    def show_before(self) -> None:
        """Show the image itself."""
        self._waiting = None
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
    """Show the original images in place of all stand-ins, whoever made these."""
    for stand_in in [image for image in bpy.data.images if _ORIGINAL in image]:
        _replace(stand_in, stand_in[_ORIGINAL])
        _remove(stand_in)


def remove_left() -> None:
    """Remove stand-ins that are put away but that undo has brought back."""
    for image in list(bpy.data.images):
        if image.name.startswith(_NAME) and _ORIGINAL not in image:
            _remove(image)


def _remove(stand_in: bpy.types.Image) -> None:
    """Remove a stand-in once no material's icon can need it; Blender would crash without it.

    Until then it has no users, so that it is not saved with a file.
    """
    if _ORIGINAL in stand_in:
        del stand_in[_ORIGINAL]
    stand_in.use_fake_user = False
    if bpy.app.background:  # without icons, and without timers
        bpy.data.images.remove(stand_in)
        return
    uid, calm = stand_in.session_uid, 0

    def remove() -> float | None:
        nonlocal calm
        calm = 0 if bpy.app.is_job_running("RENDER_PREVIEW") else calm + 1
        if calm < _CALM:
            return _INTERVAL
        if (image := _find(uid)) is not None:
            bpy.data.images.remove(image)
        return None

    bpy.app.timers.register(remove, first_interval=_INTERVAL)


def _new(image: bpy.types.Image) -> bpy.types.Image:
    stand_in = new_like(image, _NAME, image.size)
    stand_in[_ORIGINAL] = image
    icon = stand_in.preview_ensure()
    icon.icon_size = icon.image_size = (1, 1)  # else lists of images draw one, on a thread
    return stand_in


def is_shown(obj: bpy.types.Object, image: bpy.types.Image) -> bool:
    """Whether a material of an object shows an image that a stand-in can replace."""
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
            _put(node, new)
    if paint.canvas == old:
        paint.canvas = new


def _put(node: bpy.types.ShaderNodeTexImage, new: bpy.types.Image | None) -> None:
    if _RESULT in node:
        new = bpy.data.images.get(node[_RESULT])
        del node[_RESULT]
    node.image = new
    mix = live_mix(node)
    result = None if mix is None or new is None or _ORIGINAL not in new else result_of(mix)
    if result is not None and result.image is not None:  # else the old result would be mixed in
        result[_RESULT] = result.image.name
        result.image = new


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
