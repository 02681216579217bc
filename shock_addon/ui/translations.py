# SPDX-License-Identifier: GPL-3.0-or-later
"""Translations of the interface.

Each file in ``locale/`` is named after Blender's code of a language and maps the English texts
of the interface to those of the language. Texts that Blender knows itself are shown in Blender's
words, where it has them, but for properties whose translation context is `OWN_WORDS`. Only the
language in use is read.
"""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.app.handlers import persistent

from ..operators.properties import OWN_WORDS

_FOLDER = Path(__file__).parent / "locale"


def table(language: str) -> dict[tuple[str, str], str]:
    """Read a language in the form that Blender expects.

    Parameters
    ----------
    language : str
        Blender's code of the language.

    Returns
    -------
    dict
        Texts by ``(context, English)``; empty if there is no file for the language. Blender looks
        up labels of buttons in another context than all other texts, and never finds its own words
        in that of `OWN_WORDS`.
    """
    path = _FOLDER / f"{language}.json"
    if not path.is_file():
        return {}
    import json

    contexts = bpy.app.translations.contexts
    return {
        (context, english): text
        for english, text in json.loads(path.read_text(encoding="utf-8")).items()
        for context in (contexts.default, contexts.operator_default, OWN_WORDS)
    }


def register() -> None:
    """Register the texts in Blender, now and whenever another language is chosen."""
    bpy.app.handlers.translation_update_post.append(_hand_over)
    _hand_over()


def unregister() -> None:
    """Unregister the texts."""
    handlers = bpy.app.handlers.translation_update_post
    if _hand_over in handlers:  # other add-ons may clear such lists
        handlers.remove(_hand_over)
    bpy.app.translations.unregister(__package__)


@persistent
def _hand_over(*_: object) -> None:
    bpy.app.translations.unregister(__package__)  # what was there in another language, if any
    language = bpy.app.translations.locale
    bpy.app.translations.register(__package__, {language: table(language)})
