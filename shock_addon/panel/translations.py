# SPDX-License-Identifier: GPL-3.0-or-later
"""What is shown, in other languages than English.

Each file in ``locale/`` is named after Blender's code of a language and maps the English texts
of the interface to those of the language. Texts that Blender knows itself are shown in Blender's
words, where it has them.
"""

from __future__ import annotations

import json
from pathlib import Path

import bpy

_FOLDER = Path(__file__).parent / "locale"


def tables() -> dict[str, dict[tuple[str, str], str]]:
    """Read all languages, as Blender wants them.

    Returns
    -------
    dict
        For each code of a language, what ``(context, English)`` means. Blender looks up the
        words on buttons in another context than all other words.
    """
    contexts = bpy.app.translations.contexts
    return {
        path.stem: {
            (context, english): text
            for english, text in json.loads(path.read_text(encoding="utf-8")).items()
            for context in (contexts.default, contexts.operator_default)
        }
        for path in sorted(_FOLDER.glob("*.json"))
    }


def register() -> None:
    """Hand the texts to Blender."""
    bpy.app.translations.register(__package__, tables())


def unregister() -> None:
    """Take them back."""
    bpy.app.translations.unregister(__package__)
