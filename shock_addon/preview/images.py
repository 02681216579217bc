# SPDX-License-Identifier: GPL-3.0-or-later
"""Previews on images, drawn over them in Image Editors, and on textures, also on the model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import bpy
import numpy as np
import numpy.typing as npt
from bpy.app.translations import pgettext_iface as iface_

from ...core.host.inputs import HostImage
from ...core.preview.crop import Crop, crop_around, filtered_at_once
from ...core.preview.screen_colors import is_transparent, screen_colors
from .. import data
from ..data.skipped import Refused, Skipped
from ..modes import Mode
from .overlay import Overlay, Piece
from .pointing import editors_of, pointed_at
from .previewing import Preview, parameters_of

_QUICK, _SLOW = 500_000, 25_000
"""Most pixels to sharpen, or to denoise, for an update, which then takes 0.25 s."""

_FIRST_TILE = 1001
"""The number of the first UDIM tile, and the place of images without tiles."""


class Seen(NamedTuple):
    """A result: a piece to draw over the image in editors, and pixels for materials."""

    pieces: list[Piece]
    pixels: npt.NDArray[np.float32] | None = None


class ImageStage:
    """The stage of a `Preview` that draws the result over an image.

    Parameters
    ----------
    image : bpy.types.Image
    part : callable
        As in `Preview`; `show` takes a `Seen`.
    on_model : bool
        Whether materials that show the image show the result.
    whole : HostImage, optional
        The image that parts are cut out of, whose noise is that of all parts.
    """

    def __init__(
        self,
        image: bpy.types.Image,
        part: Callable[[Any], tuple],
        on_model: bool = False,
        whole: HostImage | None = None,
    ) -> None:
        self.part, self.note, self._whole = part, "", whole
        self.chosen = {"image": image.name}
        self._uid, self._size = image.session_uid, tuple(image.size)
        self._overlay = Overlay(image)
        self._on_model = data.image.stand_in.StandIn(image) if on_model else None

    def settings(self, settings: Any) -> Any:
        """Return them with the noise of the whole image; a patch has pixels of the same size."""
        if self._whole is None:
            return settings
        from ...core.host.images import with_beta_of

        return with_beta_of(self._whole, settings)

    def show(self, seen: Seen) -> None:
        """Draw the result."""
        if seen.pieces:
            height, width = seen.pieces[0].colors.shape[:2]
            words = iface_("patch of {width:,} x {height:,} pixels")
            self.note = words.format(width=width, height=height) if seen.pieces[0].framed else ""
        self._overlay.show(seen.pieces)
        if self._on_model is not None:
            self._on_model.show(seen.pixels)

    def show_before(self) -> None:
        """Draw nothing until the next `show`."""
        self._overlay.show([])
        if self._on_model is not None:
            self._on_model.show_before()

    def lost(self) -> str:
        """Return an error if the image is gone, or no Image Editor shows it."""
        image = next((i for i in bpy.data.images if i.session_uid == self._uid), None)
        if image is None or tuple(image.size) != self._size:
            return "the image was removed or changed"
        if self._on_model is None and not any(editors_of(self._uid)):
            return "the image is not shown any more"
        return ""

    def end(self) -> None:
        """Stop drawing; the image was not changed."""
        self._overlay.end()
        if self._on_model is not None:
            self._on_model.end()


def begin(context: bpy.types.Context, event: bpy.types.Event, mode: Mode) -> Preview:
    """Start a preview on the image in the Image Editor, or on the active object's texture.

    Raises
    ------
    Refused
        If the image cannot be read.
    """
    parameters = parameters_of(context.scene, mode)
    try:
        if mode.data.on_surface:
            stage = _read_texture(context, mode, parameters)
        else:
            stage = _read_image(context, event, _SLOW if mode.targets[0].row.is_slow else _QUICK)
    except Skipped as reason:
        raise Refused("There is nothing to preview: {reason}.", reason=reason) from None
    return Preview(mode, parameters, stage)


def _read_image(context: bpy.types.Context, event: bpy.types.Event, size: int) -> ImageStage:
    image = data.chosen.shown_image(context)
    whole = data.image.images.read_image(image).surface
    place = _place(context, event)
    crop = crop_around(whole, place, size)
    colors = _colors_of(image)

    def part(settings: Any) -> tuple[HostImage, Callable[[Any], Seen]]:
        smaller = crop.shrunk(place, filtered_at_once(settings))
        from ...core.host.images import with_measures

        return with_measures(smaller.image, whole, settings), partial(_seen, smaller, colors)

    return ImageStage(image, part, whole=whole)


def _read_texture(context: bpy.types.Context, mode: Mode, parameters: Any) -> ImageStage:
    image = data.chosen.chosen_image(context, parameters.image)
    takes_normals = mode.targets[0].row.takes_normals
    target, _ = data.image.textures.read_texture(context, image, parameters, takes_normals)
    surface = replace(target.surface, is_tried=True)
    colors = _colors_of(image)
    obj = context.object
    on_model = obj is not None and data.image.stand_in.is_shown(obj, image)
    in_editors = any(editors_of(image.session_uid))

    def seen(result: Any) -> Seen:
        whole = result.recolored.colors
        if on_model and not in_editors:
            return Seen([], whole)
        tiles = {_FIRST_TILE: whole} if target.mosaic is None else target.mosaic.cut(whole)
        pictures = {n: replace(target.surface.picture, pixels=tiles[n]) for n in tiles}
        pieces = [
            Piece(_tile_box(number), colors(picture), False, is_transparent(picture))
            for number, picture in pictures.items()
        ]
        return Seen(pieces, whole)

    return ImageStage(image, lambda settings: (surface, seen), on_model)


def _tile_box(number: int) -> tuple[float, float, float, float]:
    row, column = divmod(number - _FIRST_TILE, 10)
    return column, row, column + 1, row + 1


def _place(context: bpy.types.Context, event: bpy.types.Event) -> tuple[float, float]:
    view, mouse = pointed_at(context, event)
    return view.view2d.region_to_view(*mouse)


def _seen(crop: Crop, colors: Callable[[HostImage], Any], result: Any) -> Seen:
    part = replace(crop.image, pixels=crop.shown(result.colors))
    return Seen([Piece(crop.box, colors(part), not crop.is_all, is_transparent(part))])


def _colors_of(image: bpy.types.Image) -> Callable[[HostImage], Any]:
    space = image.colorspace_settings
    linear = image.is_float or space.is_data or space.name.startswith("Linear")
    return partial(screen_colors, encoded=not linear, multiply_encoded=bpy.app.version < (5, 0, 0))
