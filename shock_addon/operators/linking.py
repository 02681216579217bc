# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator Link, which puts a generated image into the shader of its material."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt

from .. import data
from ..data.skipped import Refused
from .base import can_run

BUTTON = "shock_filter_link_button"
"""Name of the context pointer by which the button that a panel draws is known.

Scripts give the name of an image instead.
"""

_NONE = "There is no unlinked generated image in the material; press Generate first."


class SHOCK_FILTER_OT_link_map(bpy.types.Operator):
    """Link a generated image to the shader of its material"""

    bl_idname = "shock_filter.link_map"
    bl_label = "Link"
    bl_description = (
        "Link the image that was generated last, whose node is in the material, to the shader."
        " It replaces the existing link, except for Mix Factor"
    )
    bl_options = {"REGISTER", "UNDO"}

    into: bpy.props.EnumProperty(
        name="Into",
        description="What the image sets",
        items=[
            ("COLOR", "Base Color", "It is the color"),
            ("ROUGHNESS", "Roughness", "It is the roughness: black is shiny, white is dull"),
            ("FACTOR", "Mix Factor", "It mixes white into the base color that is there"),
        ],
        default="COLOR",
    )
    image: bpy.props.StringProperty(
        name="Image",
        description="Image to link. If empty, the one that was generated last is used",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether there are mesh objects and no run; for the button, one that waits."""
        obstacle = "" if data.chosen.mesh_objects(context) else "Select a mesh object."
        if not obstacle and hasattr(context, BUTTON) and not is_waiting(context):
            obstacle = _NONE
        return can_run(cls, obstacle)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Link it, and say where."""
        try:
            image = self._find(context)
            names = data.image.linking.link(context, image, self.into)
        except Refused as reason:
            self.report({"ERROR"}, str(reason))
            return {"CANCELLED"}
        text = pgettext_rpt("Linked {image} in {materials}.")
        self.report({"INFO"}, text.format(image=image.name, materials=", ".join(names)))
        return {"FINISHED"}

    def _find(self, context: bpy.types.Context) -> bpy.types.Image:
        if not self.image:
            image = data.image.linking.waiting(context)
            if image is None:
                raise Refused(_NONE)
            self.image = image.name  # redo finds it linked
            return image
        image = bpy.data.images.get(self.image)
        if image is None:
            text = "There is no image named {name!r}; name one of the file's images."
            raise Refused(text, name=self.image)
        return image


def is_waiting(context: bpy.types.Context) -> bool:
    """Whether a material has an unlinked node with a generated image."""
    return data.image.linking.waiting(context) is not None


CLASSES = (SHOCK_FILTER_OT_link_map,)
