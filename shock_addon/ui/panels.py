# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar tab "Shock Filter" in the 3D view and the Image Editor.

The contents of the panels are imported when these are first drawn.
"""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from .panel import Panel


class _ImagePanel(Panel):
    """A panel of the mode that is chosen in the Image Editor."""

    choice = "image_mode"
    job = "image_job"
    bl_space_type = "IMAGE_EDITOR"


class _MainPanel(Panel):
    bl_label = "Shock Filter"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the choices, the buttons, the main settings, and what was last done."""
        from . import contents

        contents.draw_main(self, context)


class SHOCK_FILTER_PT_main(_MainPanel, bpy.types.Panel):
    """What to work on, the buttons, the main settings, and what was last done."""


class SHOCK_FILTER_PT_image_main(_MainPanel, _ImagePanel, bpy.types.Panel):
    """What to work on, the buttons, the main settings, and what was last done."""


class _OwnPanel:
    """A mode that has a panel of its own, closed at first."""

    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw all of it, with advanced settings folded."""
        from . import contents

        contents.draw_own(self, context)


class SHOCK_FILTER_PT_generate(_OwnPanel, Panel, bpy.types.Panel):
    """An image made from the shape."""

    bl_label = "Generate"
    own = "generate"


class SHOCK_FILTER_PT_maps(Panel, bpy.types.Panel):
    """Several maps of the shape in one run."""

    bl_label = "Bake Maps"
    bl_options = {"DEFAULT_CLOSED"}
    own = "generate"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the buttons."""
        from . import contents

        contents.draw_maps(self, context)


class SHOCK_FILTER_PT_flow(_OwnPanel, Panel, bpy.types.Panel):
    """A moving texture of a flow."""

    bl_label = "Flow"
    own = "visualize"


class SHOCK_FILTER_PT_image_flow(_OwnPanel, _ImagePanel, bpy.types.Panel):
    """A moving texture of a flow map."""

    bl_label = "Flow"
    own = "visualize"


class _MaskPanel:
    """What may change."""

    bl_label = "Mask"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether the mode has masks."""
        return "vertex_group" in cls.mode(context).names

    def draw(self, context: bpy.types.Context) -> None:
        """Draw what may change."""
        from ..operators import drawing

        drawing.draw_mask(self.layout, context, self.settings(context), self.mode(context))


class _OutputPanel:
    """Where the new shape or the new image goes."""

    bl_label = "Output"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Colors stay where they are."""
        from ..operators import drawing

        return drawing.has_output(cls.settings(context), cls.mode(context))

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the choice."""
        from ..operators import drawing

        drawing.draw_output(self.layout, context, self.settings(context), self.mode(context))


class _AdvancedPanel:
    """Settings that few need."""

    bl_label = "Advanced"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the advanced settings."""
        from ..operators import drawing

        mode = self.mode(context)
        drawing.draw_advanced(self.layout, self.settings(context), mode)
        from . import contents

        contents.draw_flow(self.layout, context, mode, self.settings(context))


class _StatisticsPanel:
    """What a run would work on, and how fast the last one was."""

    bl_label = "Statistics"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw what a run would work on, and how fast the last one was."""
        from . import contents

        contents.draw_statistics(self.layout, context, self.mode(context), self.settings(context))


def _sub_panels(parent: type, editor: type) -> Iterator[type]:
    """Make those that stand below a main panel."""
    name = parent.__name__.removesuffix("main")
    common = {"bl_parent_id": parent.__name__, "bl_options": {"DEFAULT_CLOSED"}}
    for panel in (_MaskPanel, _OutputPanel, _AdvancedPanel, _StatisticsPanel):
        parts = (panel, editor, bpy.types.Panel)
        yield type(f"{name}{panel.bl_label.lower()}", parts, {"__doc__": panel.__doc__, **common})


CLASSES = (
    SHOCK_FILTER_PT_main,
    SHOCK_FILTER_PT_image_main,
    *_sub_panels(SHOCK_FILTER_PT_main, Panel),
    *_sub_panels(SHOCK_FILTER_PT_image_main, _ImagePanel),
    SHOCK_FILTER_PT_generate,
    SHOCK_FILTER_PT_maps,
    SHOCK_FILTER_PT_flow,
    SHOCK_FILTER_PT_image_flow,
)
