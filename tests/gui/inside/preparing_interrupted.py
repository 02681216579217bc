# SPDX-License-Identifier: GPL-3.0-or-later
"""While the kernels are compiled: a press, disabling, enabling again, and quitting."""

import time

import bpy
import scene
from harness import MODULE, Steps, addon, report


def scenario() -> Steps:
    """Press and disable while it runs; Blender quits when the scenario ends."""
    report["began_by_itself"] = yield from begun()
    processes = list(addon("running.preparing")._processes)
    bpy.context.preferences.view.show_splash = False
    scene.clear()
    scene.add_image("Photo")
    report["pressed"] = sorted(bpy.ops.shock_filter.sharpen_image(image="Photo"))
    bpy.ops.preferences.addon_disable(module=MODULE)
    report["ended_by_disabling"] = None not in [process.code for process in processes]
    bpy.ops.preferences.addon_enable(module=MODULE)
    report["began_again"] = yield from begun()
    yield 3.0


def begun() -> Steps:
    """Wait for the process; the generator returns whether it came."""
    end = time.monotonic() + 30.0
    while addon("running.preparing").fraction() is None:
        if time.monotonic() > end:
            return False
        yield 0.1
    return True
