# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the main button is in each mode, with and without a selection; and how the tab looks."""

import bpy
import scene
from harness import (
    DRAWN,
    Steps,
    buttons,
    click_header,
    open_own_panel,
    open_tab,
    over,
    park,
    picture,
    region,
    report,
    tallest,
)

MODES = ("GEOMETRY", "DENOISE", "DENOISE_TEXTURE", "COLORS", "TEXTURE", "DETAIL", "DILATE")
LANGUAGES = {"en_US": "english", "de_DE": "german", "fr_FR": "french", "es": "spanish",
             "ja_JP": "japanese", "zh_HANS": "chinese"}  # fmt: skip


def scenario() -> Steps:
    """Go through all modes; then look at the tab in all languages."""
    scene.clear()
    monkey = scene.add_monkey("Monkey", 1)
    scene.add_texture(monkey)
    yield from open_tab()
    tops = report["tops"] = {}
    for mode in MODES:
        bpy.context.scene.shock_filter.mode = mode
        yield DRAWN
        tops[mode] = tallest((yield from buttons()))[1::2]
        yield from park()
        picture(f"rows-{mode.lower()}", region("VIEW_3D", "UI"))
    view = bpy.context.preferences.view
    view.use_translate_interface = True
    for mode in ("GEOMETRY", "DENOISE"):
        bpy.context.scene.shock_filter.mode = mode
        for language, name in LANGUAGES.items():
            view.language = language
            yield 2 * DRAWN
            picture(f"rows-{mode.lower()}-{name}", region("VIEW_3D", "UI"))
    view.language = "en_US"
    bpy.context.scene.shock_filter.mode = "GEOMETRY"
    with over():
        bpy.ops.object.select_all(action="DESELECT")
    yield 2 * DRAWN
    report["unselected"] = bool((yield from buttons()))
    picture("rows-nothing-selected", region("VIEW_3D", "UI"))
    monkey.select_set(True)
    yield from open_own_panel(-3)
    picture("rows-generate", region("VIEW_3D", "UI"))
    report["generate"] = len((yield from buttons()))
    yield from click_header(-3)
    yield from click_header(-1)
    picture("rows-flow", region("VIEW_3D", "UI"))
    report["flow"] = len((yield from buttons()))
