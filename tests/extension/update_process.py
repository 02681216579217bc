# SPDX-License-Identifier: GPL-3.0-or-later
"""One Blender process of a person who installs, updates or removes the extension.

Run as ``python update_process.py RESOURCES REPORT WHAT URL``: RESOURCES is Blender's folder for the
user's files, REPORT the JSON file to write, URL that of an extension repository, which WHAT is done
with: install, update, or downgrade; after that the extension is removed.
"""

import hashlib
import json
import os
import sys
from pathlib import Path

RESOURCES, REPORT, WHAT, URL = sys.argv[1:]
os.environ["BLENDER_USER_RESOURCES"] = RESOURCES  # bpy reads it when it is imported

import bpy  # noqa: E402

# isort: split
import addon_utils  # noqa: E402  (found once bpy is imported)
import numpy as np  # noqa: E402

MODULE = "bl_ext.shock_releases.shock_filter"
FILE = Path(RESOURCES) / "work.blend"


def use() -> dict[str, object]:
    """Sharpen random pixels; return the result, and a digest of the pixels."""
    image = bpy.data.images.new("Noise", 32, 24, float_buffer=True)
    image.pixels.foreach_set(np.random.default_rng(0).random(32 * 24 * 4, np.float32))
    result = bpy.ops.shock_filter.sharpen_image(image="Noise", time=64.0, output="REPLACE")
    pixels = np.empty(32 * 24 * 4, np.float32)
    image.pixels.foreach_get(pixels)
    return {"result": sorted(result), "pixels": hashlib.sha256(pixels).hexdigest()}


def stored() -> dict[str, object]:
    """Return what the person has set: in the scene, in a file, as a preset, in the preferences."""
    bpy.ops.wm.open_mainfile(filepath=str(FILE))
    scene = bpy.context.scene
    presets = bpy.utils.preset_paths("shock_filter/image")
    return {
        "mode": scene.shock_filter.mode,
        "time": scene.shock_filter.geometry.time,
        "mark": scene["mark"],
        "presets": sorted(path.name for folder in presets for path in Path(folder).iterdir()),
        "enabled": MODULE in bpy.context.preferences.addons,
    }


def repository() -> int:
    """Return the number of the repository, which is read anew."""
    repos = bpy.context.preferences.extensions.repos
    (number,) = [i for i, repo in enumerate(repos) if repo.module == "shock_releases"]
    bpy.ops.extensions.repo_sync(repo_index=number)
    return number


def version() -> str:
    """Return the version that is at work."""
    return sys.modules[MODULE].__version__


def install() -> None:
    """Install, and keep something of each kind."""
    bpy.ops.extensions.package_install(
        repo_index=repository(), pkg_id="shock_filter", enable_on_install=True
    )
    settings = bpy.context.scene.shock_filter
    settings.mode, settings.geometry.time = "COLORS", 77.0
    bpy.context.scene["mark"] = "kept"
    bpy.ops.shock_filter.image_preset_add(name="Mine")
    bpy.ops.wm.save_as_mainfile(filepath=str(FILE))


def update() -> None:
    """Take the newest version, as the button in the preferences does."""
    repository()
    bpy.ops.extensions.package_upgrade_all(use_active_only=False)


def downgrade() -> None:
    """Install what the repository has, which is older."""
    bpy.ops.extensions.package_install(
        repo_index=repository(), pkg_id="shock_filter", enable_on_install=True
    )


def files() -> list[str]:
    """List all files of the person."""
    found = (path for path in Path(RESOURCES).rglob("*") if path.is_file())
    return sorted(path.relative_to(RESOURCES).as_posix() for path in found)


bpy.ops.wm.read_homefile(use_empty=True)
preferences = bpy.context.preferences
preferences.system.use_online_access = True  # asked for even where files are read
preferences.extensions.repos.new(name="Shock Filter", module="shock_releases", remote_url=URL)
report: dict[str, object] = {}
if WHAT != "install":
    addon_utils.enable(MODULE, default_set=True)  # bpy forgets; 4.2 cannot read them
    report["before"] = version()
{"install": install, "update": update, "downgrade": downgrade}[WHAT]()
report["version"] = version()
report["used"] = use()
report["stored"] = stored()
if WHAT == "downgrade":
    bpy.ops.extensions.package_uninstall(repo_index=repository(), pkg_id="shock_filter")
    report["left"] = files()
else:
    bpy.ops.preferences.addon_disable(module=MODULE)  # classes left at exit crash or hang 4.2, 4.5
Path(REPORT).write_text(json.dumps(report), encoding="utf-8")
