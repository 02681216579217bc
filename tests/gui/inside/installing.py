# SPDX-License-Identifier: GPL-3.0-or-later
"""From a release to a sharpened image: by a repository with an update, and by dropping the zip."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
from harness import DRAWN, Steps, over, press, report

RELEASES = Path.home() / "releases"
REPOSITORY = "shock_releases"


def scenario() -> Steps:
    """Add the repository, install, use, update, use, remove, and drop the zip."""
    preferences = bpy.context.preferences
    preferences.system.use_online_access = True  # asked for even where files are read
    url = (RELEASES / "index.json").as_uri()
    preferences.extensions.repos.new(name="Shock Filter", module=REPOSITORY, remote_url=url)
    one = {"repo_index": refreshed(), "pkg_id": "shock_filter"}
    with over():
        bpy.ops.extensions.package_install("INVOKE_DEFAULT", enable_on_install=True, **one)
    yield from until(version)
    report["installed"] = version(), largest_change()
    bpy.context.scene.shock_filter.geometry.time = 77.0

    RELEASES.rename(RELEASES.with_name("older"))
    RELEASES.with_name("newer").rename(RELEASES)
    refreshed()
    with over():
        bpy.ops.extensions.package_upgrade_all("INVOKE_DEFAULT")
    yield from until(lambda: version() not in ("", report["installed"][0]))
    report["updated"] = version(), largest_change()
    report["time"] = bpy.context.scene.shock_filter.geometry.time

    with over():
        bpy.ops.extensions.package_uninstall("INVOKE_DEFAULT", **one)
    yield from until(lambda: not version())

    with over():  # as Blender does with a file that is dropped: it asks
        zip_file = str(Path.home() / "extension.zip")
        bpy.ops.extensions.package_install_files("INVOKE_DEFAULT", url=zip_file)
    yield DRAWN
    began = time.perf_counter()
    yield from press("Return")
    yield from until(version)
    installed = time.perf_counter()
    report["sharpened"] = sharpened_mesh()
    report["seconds"] = installed - began, time.perf_counter() - installed
    report["dropped"] = version(), largest_change()

    (module,) = [each.module for each in preferences.addons if each.module.endswith("shock_filter")]
    report["again"] = []
    for _ in range(2):
        bpy.ops.preferences.addon_disable(module=module)
        yield DRAWN
        bpy.ops.preferences.addon_enable(module=module)
        yield DRAWN
        report["again"].append((version(), largest_change()))


def refreshed() -> int:
    """Have Blender read the repository; return its number."""
    repos = bpy.context.preferences.extensions.repos
    (number,) = [i for i, repo in enumerate(repos) if repo.module == REPOSITORY]
    bpy.ops.extensions.repo_sync(repo_index=number)
    return number


def version() -> str:
    """Return the version that is at work, out of any repository; empty where there is none."""
    for addon in bpy.context.preferences.addons:
        if addon.module.endswith(".shock_filter") and addon.module in sys.modules:
            return sys.modules[addon.module].__version__
    return ""


def until(reached: Callable[[], object], limit: float = 120.0) -> Steps:
    """Wait for what a job in the background does."""
    end = time.monotonic() + limit
    while not reached():
        if time.monotonic() > end:
            raise TimeoutError("Blender has not done it.")
        yield 0.2
    yield DRAWN


def sharpened_mesh() -> list[str]:
    """Sharpen a mesh; return what Blender says of it."""
    bpy.ops.mesh.primitive_monkey_add()
    return sorted(bpy.ops.shock_filter.sharpen_geometry())


def largest_change() -> float:
    """Sharpen a soft edge in an image; return how much a value changes at most."""
    image = bpy.data.images.new("Edge", 32, 8, float_buffer=True)
    values = np.ones((8, 32, 4), np.float32)
    values[..., :3] = (1 / (1 + np.exp(-(np.arange(32) - 15.5) / 3)))[:, None]
    image.pixels.foreach_set(values.ravel())
    bpy.ops.shock_filter.sharpen_image(image=image.name, time=1024.0, output="REPLACE")
    found = np.empty(values.size, np.float32)
    image.pixels.foreach_get(found)
    return float(np.abs(found - values.ravel()).max())
