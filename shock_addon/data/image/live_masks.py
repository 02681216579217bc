# SPDX-License-Identifier: GPL-3.0-or-later
"""Mask images of live textures, which set where the result is shown."""

from __future__ import annotations

import bpy
import numpy as np
import numpy.typing as npt

from .. import LIVE_TEXTURE
from ..materials import MASK, live_mask
from ..mixes import mixed
from ..skipped import Refused
from . import images, mixing
from .textures import grays_of
from .tiles import Tiles, new_tiled_like

_SUFFIX = "mask"


def of_gain(
    names: list[str], old: bpy.types.Image, gain_map: bpy.types.Image
) -> tuple[bpy.types.Image, bool]:
    """Return a mask that is white where a gain map is painted.

    It is the updated mask of an earlier run, if nobody has painted on it since.

    Parameters
    ----------
    names : list of str
        Names of the objects whose materials show the image.
    old : bpy.types.Image
    gain_map : bpy.types.Image
        With the parts of the image.

    Returns
    -------
    mask : bpy.types.Image
    is_kept : bool
        Whether it was painted on, and so left as it is.
    """
    from ....core.host.textures import mask_of_gain

    parts = {
        number: _opaque(mask_of_gain(grays_of(pixels)))
        for number, pixels in images.read_parts(gain_map).items()
    }
    for mask in _masks(names, old):
        if LIVE_TEXTURE not in mask:
            return mask, False  # the artist's own
        if mask[LIVE_TEXTURE] != images.digest_of(mask).hex():
            return mask, True
        if images.part_sizes(mask) == images.sizes_of(parts):
            images.write_parts(mask, parts, pack=True)
            _note_written(mask)
            return mask, False
    return _add(old, parts), False


def to_paint(
    names: list[str], old: bpy.types.Image, gain_map: bpy.types.Image | None
) -> tuple[bpy.types.Image, bool]:
    """Return the mask of a live texture; a new one is black, so that the result is not shown.

    Parameters
    ----------
    names : list of str
        Names of the objects whose materials mix the image with its result.
    old : bpy.types.Image
    gain_map : bpy.types.Image or None
        Where it is painted, a new mask is white.

    Returns
    -------
    mask : bpy.types.Image
    is_inverted : bool
        Whether the result is seen where it is black.

    Raises
    ------
    Refused
        If other nodes say where the result is seen.
    """
    pairs = mixed(names, old)
    for _, mix in pairs:
        if mix.inputs[MASK].is_linked and live_mask(mix)[0] is None:
            text = "Nodes without an image go into Mask of {name}; unlink them to paint a mask."
            raise Refused(text, name=mix.name)
    found = [live_mask(mix) for _, mix in pairs]
    masks = [(node.image, is_inverted) for node, is_inverted in found if node is not None]
    mask, is_inverted = masks[0] if masks else (None, False)
    if mask is None and gain_map is not None:
        mask, _ = of_gain(names, old, gain_map)
    if mask is None:
        shown = [node.image for node in mixing.results(names, old) if node.image is not None]
        sizes = images.part_sizes([*shown, old][0])  # the result may be larger
        mask = _add(old, {key: _opaque(np.zeros(size, np.float32)) for key, size in sizes.items()})
    for node, mix in pairs:
        if not mix.inputs[MASK].is_linked:
            mixing.link_mask(node, mask, is_inverted)
    return mask, is_inverted


def _masks(names: list[str], old: bpy.types.Image) -> list[bpy.types.Image]:
    found = [live_mask(mix)[0] for _, mix in mixed(names, old)]
    return [node.image for node in found if node is not None]


def _opaque(grays: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    pixels = np.ones((*grays.shape, 4), np.float32)
    pixels[..., :3] = grays[..., None]
    return pixels


def _add(old: bpy.types.Image, parts: Tiles) -> bpy.types.Image:
    """Add a mask named after an image, packed, with colors as they are stored."""
    name = images.name_with(old.name, _SUFFIX)
    if old.source == "TILED":
        mask = new_tiled_like(old, name, parts)
        mask.colorspace_settings.is_data = True
    else:
        height, width = parts[images.UNTILED].shape[:2]
        mask = bpy.data.images.new(name, width, height, is_data=True)
        images.write_parts(mask, parts, pack=True)
    _note_written(mask)
    return mask


def _note_written(mask: bpy.types.Image) -> None:
    mask[LIVE_TEXTURE] = images.digest_of(mask).hex()
