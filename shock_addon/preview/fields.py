# SPDX-License-Identifier: GPL-3.0-or-later
"""Previews of generated images: at a low resolution, drawn on the surface."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import bpy
import numpy as np
import numpy.typing as npt
from bpy.app.translations import pgettext_iface as iface_

from ...core.host.fields import FieldSurface, reduced, reduced_settings
from .. import data
from ..data.skipped import Refused, Skipped
from ..modes import Mode
from .coat import Coat
from .previewing import Preview, parameters_of


class Seen(NamedTuple):
    """Values to draw, (h, w), and remarks on them."""

    values: npt.NDArray[np.float32]
    note: str


class FieldStage:
    """The stage of a `Preview` that draws values on objects.

    Parameters
    ----------
    target : FieldTarget
    is_slow : bool
        Whether the filter is slow.
    """

    def __init__(self, target: data.image.fields.FieldTarget, is_slow: bool) -> None:
        self.chosen, self.note = {}, ""
        self._shape, self._surface = target.surface.shape, reduced(target.surface, is_slow)
        self._uids = list(target.objects)
        self._coat = Coat(target.surface.faces)

    def settings(self, settings: Any) -> Any:
        """Convert lengths to texels of the smaller image."""
        return reduced_settings(settings, self._shape, self._surface.shape)

    def part(self, settings: Any) -> tuple[FieldSurface, Callable[[Any], Seen]]:
        """Return the same surface for all settings."""
        height, width = self._surface.shape
        note = iface_("{width:,} x {height:,} pixels").format(width=width, height=height)
        return self._surface, lambda result: Seen(result.grays, note)

    def show(self, seen: Seen) -> None:
        """Draw the values."""
        self.note = seen.note
        self._coat.show(seen.values)

    def show_before(self) -> None:
        """Draw nothing until the next `show`."""
        self._coat.show(None)

    def lost(self) -> str:
        """Return an error if an object is gone."""
        there = {obj.session_uid for obj in bpy.data.objects}
        return "" if there.issuperset(self._uids) else "an object was removed"

    def end(self) -> None:
        """Stop drawing; no data was changed."""
        self._coat.end()


def begin(context: bpy.types.Context, event: bpy.types.Event, mode: Mode) -> Preview:
    """Start a preview on the chosen objects.

    Raises
    ------
    Refused
        If these or other named data cannot be read.
    """
    parameters = parameters_of(context.scene, mode)
    parameters.into = "IMAGE"
    image = bpy.data.images.get(parameters.image) if parameters.image else None
    target = mode.target(parameters)
    try:
        found, _ = data.image.fields.read_field(context, image, parameters, target.places)
    except Skipped as reason:
        raise Refused("There is nothing to preview: {reason}.", reason=reason) from None
    return Preview(mode, parameters, FieldStage(found, target.row.is_slow))
