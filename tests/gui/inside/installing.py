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
FROM_REPOSITORY, DROPPED = "shock_releases", "user_default"


def scenario() -> Steps:
    """Add the repository, install, use, update, use, remove, and drop the zip."""
    preferences = bpy.context.preferences
    preferences.system.use_online_access = True  # asked for even where files are read
    url = (RELEASES / "index.json").as_uri()
    preferences.extensions.repos.new(name="Shock Filter", module=FROM_REPOSITORY, remote_url=url)
    yield from from_repository("package_install", pkg_id="shock_filter", enable_on_install=True)
    yield from until(lambda: version(FROM_REPOSITORY))
    report["installed"] = version(FROM_REPOSITORY), largest_change()
    bpy.context.scene.shock_filter.geometry.time = 77.0

    RELEASES.rename(RELEASES.with_name("older"))
    RELEASES.with_name("newer").rename(RELEASES)
    with over():
        bpy.ops.extensions.repo_sync_all("INVOKE_DEFAULT")
    yield 5 * DRAWN
    with over():
        bpy.ops.extensions.package_upgrade_all("INVOKE_DEFAULT")
    yield from until(lambda: version(FROM_REPOSITORY) != report["installed"][0])
    report["updated"] = version(FROM_REPOSITORY), largest_change()
    report["time"] = bpy.context.scene.shock_filter.geometry.time

    yield from from_repository("package_uninstall", pkg_id="shock_filter")
    yield from until(lambda: not hasattr(bpy.types, "SHOCK_FILTER_OT_sharpen_image"))

    with over():  # as Blender does with a file that is dropped; it asks
        zip_file = str(Path.home() / "extension.zip")
        bpy.ops.extensions.package_install_files("INVOKE_DEFAULT", url=zip_file)
    yield DRAWN
    yield from press("Return")
    yield from until(lambda: version(DROPPED))
    report["dropped"] = version(DROPPED), largest_change()


def from_repository(operator: str, **settings: object) -> Steps:
    """Refresh the repository, and run an operator on it, as the buttons of the preferences do."""
    repos = bpy.context.preferences.extensions.repos
    (number,) = [i for i, repo in enumerate(repos) if repo.module == FROM_REPOSITORY]
    bpy.ops.extensions.repo_sync(repo_index=number)
    with over():
        getattr(bpy.ops.extensions, operator)("INVOKE_DEFAULT", repo_index=number, **settings)
    yield DRAWN


def version(repository: str) -> str:
    """Return the version that is at work out of a repository; empty where there is none."""
    module = f"bl_ext.{repository}.shock_filter"
    there = module in bpy.context.preferences.addons and module in sys.modules
    return sys.modules[module].__version__ if there else ""


def until(reached: Callable[[], object], limit: float = 120.0) -> Steps:
    """Wait for what a job in the background does."""
    end = time.monotonic() + limit
    while not reached():
        if time.monotonic() > end:
            raise TimeoutError("Blender has not done it.")
        yield 0.2
    yield DRAWN


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
