# SPDX-License-Identifier: GPL-3.0-or-later
"""Values that runs chose for automatic settings, and the operator that keeps them."""

from __future__ import annotations

from typing import NamedTuple

import bpy
from bpy.app.translations import pgettext_iface, pgettext_rpt

from .. import data

subjects: dict[str, set[int]] = {}
"""The uids of the objects and images of the last run of each mode."""


class Found(NamedTuple):
    """The value that a run chose for a setting, also in words.

    Attributes
    ----------
    value : float or str
        The identifier of a choice, or a number.
    text : str
        In the scene's units, for the field.
    said : str
        As reports say it, also in the units that the field has.
    """

    value: float | str
    text: str
    said: str


found: dict[str, dict[str, Found]] = {}
"""The values that the last filtering runs chose for automatic settings, by mode and property."""

owners: dict[str, set[int]] = {}
"""The uids of the objects and images of these runs; showing or marking creases does not count."""


def found_by(context: bpy.types.Context, key: str, name: str) -> Found | None:
    """Return the value that the last run of a mode on the selection chose for a setting."""
    same = data.chosen.subjects(context) & owners.get(key, set())
    return found.get(key, {}).get(name) if same else None


class SHOCK_FILTER_OT_keep_auto(bpy.types.Operator):
    """Copy the value that the last run chose into the field, so that the next runs use the same"""

    bl_idname = "shock_filter.keep_auto"
    bl_label = "Keep"
    bl_options = {"UNDO", "INTERNAL"}

    mode: bpy.props.StringProperty()
    name: bpy.props.StringProperty()

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Set the value."""
        chosen = found_by(context, self.mode, self.name)
        if chosen is None:
            self.report(
                {"ERROR"},
                "No run on the selection has chosen this value yet; run the filter first.",
            )
            return {"CANCELLED"}
        settings = getattr(context.scene.shock_filter, self.mode)
        setattr(settings, self.name, chosen.value)
        name = pgettext_iface(settings.bl_rna.properties[self.name].name)
        text = pgettext_rpt("{name} is {value} from now on.")
        self.report({"INFO"}, text.format(name=name, value=chosen.said))
        return {"FINISHED"}


CLASSES = (SHOCK_FILTER_OT_keep_auto,)
