# SPDX-License-Identifier: GPL-3.0-or-later
"""The tab in other languages."""

import bpy
import scene
from harness import DRAWN, Steps, crop, different, open_tab, park, picture, region, report

LANGUAGES = {"de": "german", "ja": "japanese", "zh_HANS": "chinese"}


def scenario() -> Steps:
    """Show the tab in each language, and in English again."""
    scene.clear()
    scene.add_monkey("Monkey", 1)
    bpy.context.scene.shock_filter.mode = "GEOMETRY"
    yield from open_tab()
    yield from park()
    yield DRAWN
    english = crop(region("VIEW_3D", "UI"))
    view = bpy.context.preferences.view
    view.use_translate_interface = True
    for language, name in LANGUAGES.items():
        view.language = next(
            code for code in bpy.app.translations.locales if code.startswith(language)
        )
        yield 2 * DRAWN
        picture(f"in-{name}", region("VIEW_3D", "UI"))
        report[language] = {
            "label": bpy.app.translations.pgettext_iface("Sharpen Geometry", "Operator"),
            "changed_pixels": different(english, crop(region("VIEW_3D", "UI"))),
        }
    view.language = "en_US"
    yield 2 * DRAWN
    report["left_pixels"] = different(english, crop(region("VIEW_3D", "UI")))
