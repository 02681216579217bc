# SPDX-License-Identifier: GPL-3.0-or-later
"""A session after everything was compiled: each button is pressed for the first time."""

import scene
from harness import Steps, addon, finished, open_tab, report
from preparing import add_texture, presses


def scenario() -> Steps:
    """Open the tab, and press each button once."""
    scene.clear()
    add_texture(scene.add_monkey("Monkey", 2))
    yield from open_tab()
    report["fraction"] = addon("running.preparing").fraction()
    yield from finished()
    yield from presses()
