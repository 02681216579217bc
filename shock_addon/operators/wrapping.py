# SPDX-License-Identifier: GPL-3.0-or-later
"""Line breaks for sentences in panels, as Blender's labels do not wrap."""

from __future__ import annotations

import re

import bpy
from bpy.app.translations import pgettext_iface

_PIXELS_PER_LETTER = 6.4
_WIDE_LETTER = 1.8  # letters
_SIDES = 45.0  # pixels of a sidebar beside what is drawn
_EDGES = 7.7  # pixels of a button beside its words
_ICON = 40.0  # pixels, with some to spare for wide letters

# Chinese and Japanese may break after each letter, but not before closing marks.
_WIDE = "\u2e80-\u9fff\uf900-\ufaff\uff00-\uffef"
_CLOSING = "\u3001\u3002\u300d\u201d\uff09\uff0c\uff1a\uff1b"
_UNIT = rf"(?:[{_WIDE}]|[^\s{_WIDE}]+(?:(?<=\d) (?:s\b|秒)[^\s{_WIDE}]*)?)[{_CLOSING}]*\s*"
"""Pattern of text to keep on one line: a word, or a number of seconds with its unit."""


def draw_text(
    layout: bpy.types.UILayout, context: bpy.types.Context, text: str, icon: str = "NONE"
) -> None:
    """Draw a text, in the language of the interface, on as many lines as the width needs.

    The icon is on the first line. What stands on lines of its own, stays there.
    """
    column = layout.column(align=True)
    column.scale_y = 0.8
    room = _room(context) - (0.0 if icon == "NONE" else _ICON)
    letters = int(room / _PIXELS_PER_LETTER)
    lines = [
        line for part in pgettext_iface(text).split("\n") for line in wrap(part, max(letters, 16))
    ]
    for number, line in enumerate(lines):
        blank = "NONE" if icon == "NONE" else "BLANK1"
        column.label(text=line, icon=icon if number == 0 else blank, translate=False)


def fit(context: bpy.types.Context, words: list[str], in_row: int = 0) -> bool:
    """Whether words fit into rows of equal buttons, of so many or all in a row."""
    button = _room(context) / (in_row or len(words)) - _EDGES
    return max(map(_width, words)) * _PIXELS_PER_LETTER <= button


def wrap(text: str, letters: int) -> list[str]:
    """Break a text into lines; Chinese and Japanese letters are wider."""
    lines = [""]
    for unit in re.findall(_UNIT, text):
        if lines[-1] and _width(lines[-1] + unit.rstrip()) > letters:
            lines.append("")
        lines[-1] += unit
    return [line.rstrip() for line in lines]


def _room(context: bpy.types.Context) -> float:
    return context.region.width / context.preferences.system.ui_scale - _SIDES


def _width(text: str) -> float:
    import unicodedata

    wide = sum(unicodedata.east_asian_width(letter) in "WF" for letter in text)
    return len(text) + (_WIDE_LETTER - 1.0) * wide
