# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender quits while a run is under way."""

import scene
from harness import Steps, report, run, running


def scenario() -> Steps:
    """Start a long run; Blender quits when the scenario ends."""
    scene.clear()
    scene.add_bumpy_grid("Grid", 500)
    report["started"] = run("sharpen_geometry", where="everywhere", time=4096.0)
    yield 0.5
    report["running"] = running()
