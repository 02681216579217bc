# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension's texts in other languages: what Blender finds for each, and how the tab looks."""

from pathlib import Path

import bpy
import scene
from bpy.app.translations import pgettext_iface, pgettext_tip
from harness import (
    DRAWN,
    MODULE,
    Steps,
    addon,
    crop,
    different,
    open_tab,
    park,
    picture,
    region,
    report,
)

PICTURED = {"de_DE": "german", "ja_JP": "japanese", "zh_HANS": "chinese"}
WORDS = "Sharpen Geometry"


def scenario() -> Steps:
    """Show the tab in several languages, look all texts up, and disable the extension."""
    scene.clear()
    scene.add_monkey("Monkey", 1)
    bpy.context.scene.shock_filter.mode = "GEOMETRY"
    yield from open_tab()
    yield from park()
    yield DRAWN
    english = crop(region("VIEW_3D", "UI"))
    translations = addon("ui.translations")
    files = (Path(translations.__file__).parent / "locale").glob("*.json")
    tables = {file.stem: translations.table(file.stem) for file in sorted(files)}
    report["unknown"] = sorted(set(tables) - set(bpy.app.translations.locales))
    report["english"], report["changed_pixels"], report["foreign"] = {}, {}, []
    view = bpy.context.preferences.view
    view.use_translate_interface = view.use_translate_tooltips = True
    for language, table in tables.items():
        view.language = language
        report["english"][language] = _not_found(table)
        report["foreign"] += [
            word
            for (context, english), word in table.items()
            if context == translations.OWN_WORDS and pgettext_iface(english, context) != word
        ]
        if language in PICTURED:
            yield 2 * DRAWN
            picture(f"in-{PICTURED[language]}", region("VIEW_3D", "UI"))
            changed = different(english, crop(region("VIEW_3D", "UI")))
            report["changed_pixels"][language] = changed
    view.language = "en_US"
    yield 2 * DRAWN
    report["left_pixels"] = different(english, crop(region("VIEW_3D", "UI")))
    view.language = "de_DE"
    report["switched"] = []
    for _ in range(2):
        report["switched"].append(pgettext_iface(WORDS, "Operator"))
        bpy.ops.preferences.addon_disable(module=MODULE)
        report["switched"].append(pgettext_iface(WORDS, "Operator"))
        bpy.ops.preferences.addon_enable(module=MODULE)
    yield DRAWN


def _not_found(table: dict[tuple[str, str], str]) -> list[str]:
    """List the texts that Blender shows in English although the table has them."""
    return [
        english
        for (context, english), text in table.items()
        if text != english
        and english in (pgettext_iface(english, context), pgettext_tip(english, context))
    ]
