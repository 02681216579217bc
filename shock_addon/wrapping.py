# SPDX-License-Identifier: GPL-3.0-or-later
"""Sentences in panels: Blender's labels do not wrap by themselves."""

from __future__ import annotations

import textwrap

import bpy

_PIXELS_PER_LETTER = 7.0


def draw_text(
    layout: bpy.types.UILayout, context: bpy.types.Context, text: str, icon: str = "NONE"
) -> None:
    """Draw a text over as many lines as the region's width needs; the icon is on the first."""
    scale = context.preferences.system.ui_scale
    letters = int(context.region.width / (scale * _PIXELS_PER_LETTER)) - 4
    column = layout.column(align=True)
    column.scale_y = 0.8
    for number, line in enumerate(textwrap.wrap(text, max(letters, 16))):
        blank = "NONE" if icon == "NONE" else "BLANK1"
        column.label(text=line, icon=icon if number == 0 else blank)
