# SPDX-License-Identifier: GPL-3.0-or-later
"""What Blender finds for each of the extension's texts, in each language."""

import bpy
from bpy.app.translations import pgettext_iface, pgettext_tip
from harness import DRAWN, MODULE, Steps, addon, report

WORDS = "Sharpen Geometry"


def scenario() -> Steps:
    """Look all texts up, then disable and enable the extension twice."""
    tables = addon("panel.translations").tables()
    view = bpy.context.preferences.view
    view.use_translate_interface = view.use_translate_tooltips = True
    report["unknown"] = sorted(set(tables) - set(bpy.app.translations.locales))
    report["english"] = {}
    for language, table in tables.items():
        view.language = language
        report["english"][language] = [
            english
            for (context, english), text in table.items()
            if text != english
            and english in (pgettext_iface(english, context), pgettext_tip(english, context))
        ]
    view.language = "de_DE"
    report["switched"] = []
    for _ in range(2):
        report["switched"].append(pgettext_iface(WORDS, "Operator"))
        bpy.ops.preferences.addon_disable(module=MODULE)
        report["switched"].append(pgettext_iface(WORDS, "Operator"))
        bpy.ops.preferences.addon_enable(module=MODULE)
    yield DRAWN
