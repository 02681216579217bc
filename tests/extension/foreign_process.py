# SPDX-License-Identifier: GPL-3.0-or-later
"""One Blender process that sharpens an image with the installed extension.

Run as ``python foreign_process.py RESOURCES REPORT [--install ZIP | --before FOLDER]``: RESOURCES
is Blender's folder for the user's files, REPORT the JSON file to write. With --install, the
extension is installed and not used; with --before, Python looks for modules in FOLDER first.
"""

import argparse
import importlib
import json
import os
import sys
from pathlib import Path

parser = argparse.ArgumentParser()
parser.add_argument("resources")
parser.add_argument("report", type=Path)
parser.add_argument("--install")
parser.add_argument("--before")
arguments = parser.parse_args()
os.environ["BLENDER_USER_RESOURCES"] = arguments.resources  # read when bpy is imported

import bpy  # noqa: E402

# isort: split
import addon_utils  # noqa: E402  (found once bpy is imported)
import numpy as np  # noqa: E402

MODULE = "bl_ext.user_default.shock_filter"


def sharpen() -> dict[str, object]:
    """Sharpen random pixels; return the result, or what the operator says."""
    image = bpy.data.images.new("Noise", 32, 24, float_buffer=True)
    image.pixels.foreach_set(np.random.default_rng(0).random(32 * 24 * 4, np.float32))
    try:
        result = bpy.ops.shock_filter.sharpen_image(image="Noise", output="REPLACE", time=16.0)
    except RuntimeError as error:
        return {"result": [], "said": str(error)}
    return {"result": sorted(result), "said": ""}


report: dict[str, object] = {}
bpy.ops.wm.read_homefile(use_empty=True)
if arguments.install:
    bpy.ops.extensions.package_install_files(
        repo="user_default", filepath=arguments.install, enable_on_install=True
    )
else:
    addon_utils.enable(MODULE, default_set=True)
    kernels = importlib.import_module(f"{MODULE}.shock_addon.running.kernels")
    if arguments.before:
        sys.path.insert(0, arguments.before)
    report = sharpen()
    report["problem"] = kernels.problem()
# Classes left at exit crash or hang old versions. Were the extension taken out of the preferences,
# too, Blender would remove its libraries, under the feet of a process at work.
addon_utils.disable(MODULE)
arguments.report.write_text(json.dumps(report), encoding="utf-8")
if bpy.app.version < (4, 5):  # see blender_process.py
    sys.stdout.flush()
    os._exit(0)
